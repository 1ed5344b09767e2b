"""Friction that is not proportional to the normal force."""

import math

import sympy as sp

from ..effect import Effect, hidden, load_varies, strength
from ..scan import Scan


class LoadExponent(Effect):
    """The law sees N (N / load_reference)^load_exponent.

    Units: load_exponent dimensionless, load_reference in the system's unit of force.
    Neutral: load_exponent = 0.
    Occurs: with soft, rough or adhesive surfaces (-1/3 for one elastic sphere), rubber, textiles.
    Experiment: the same motion under several loads, or a load that swings.
    """

    name = "load_exponent"
    parameters = (
        strength("load_exponent", "1", "exponent of the normal force beyond 1", -1.0, 2.0),
        hidden("load_reference", "{F}", "normal force where nothing changes", 1.0, Scan("load", 1, 1, 1)),
    )

    def applies(self, system, law, others=()):
        return load_varies(system)

    def make_parameters(self, system, law):
        exponent, reference = self.parameters
        return exponent, hidden(reference.name, reference.unit, reference.text, _at_rest(system), reference.scan)

    def load(self, N, c, p):
        return N * (N / p.load_reference) ** p.load_exponent


def _at_rest(system) -> float:
    """Normal force with every coordinate and input at 0; 1 where that is none."""
    values = {par.symbol: system.values[par.name] for par in system.parameters}
    N = float(sp.sympify(system.N).subs(values).subs(dict.fromkeys(system.N.free_symbols, 0)))
    return N if math.isfinite(N) and N > 0 else 1.0
