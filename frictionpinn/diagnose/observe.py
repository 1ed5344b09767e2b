"""Where a fitted model was during the recording: the variables on which a missing force may depend."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import sympy as sp

from ..numerics.simulate import Simulation
from ..physics.base import CONTACT
from ..physics.scan import data_scales
from ..physics.system import System
from .bench import Bench
from .fit import Fit
from .remainder import Remainder


def simulations(bench: Bench, fit: Fit) -> list[Simulation]:
    """One of each trial, at the fit."""
    return [
        model.simulate(fit.values, local) for model, local in zip(fit.models, fit.locals, strict=True)
    ]  # fmt: skip


def samples(system: System, run: Simulation, symbol: sp.Expr) -> np.ndarray:
    """A variable of the contact, or a measured signal, at the samples of a simulation, shape (n,)."""
    table = {s: n for c in system.moving for s, n in zip(c.symbols, c.signals, strict=True)}
    table |= {item.symbol: item.name for item in system.inputs}
    known = {CONTACT.t: run.t, CONTACT.v: run.v_slip, CONTACT.N: run.N}
    if symbol in known:
        return known[symbol]
    own = {CONTACT.s: system.slip_position, CONTACT.a: system.a_slip}
    expr = sp.sympify(own.get(symbol, symbol))
    values = {par.symbol: system.values[par.name] for par in system.parameters}
    expr = expr.subs(values)
    symbols = sorted(expr.free_symbols, key=str)
    columns = [run.signals.get(table[s], np.zeros(len(run.t))) for s in symbols]
    value = sp.lambdify(symbols, expr, "numpy")(*columns)
    return np.broadcast_to(np.asarray(value, dtype=float), run.t.shape).copy()


def scales(system: System, runs: Sequence[Simulation]) -> dict[str, tuple[float, float]]:
    """What the values of hidden parameters are tried relative to."""
    has_position = system.slip_position is not None
    position = [samples(system, run, CONTACT.s) if has_position else np.cumsum(run.v_slip) for run in runs]
    return data_scales([run.t for run in runs], position, [run.v_slip for run in runs], [run.N for run in runs])


def ranges(system: System, remainders: Sequence[Remainder], runs: Sequence[Simulation]) -> dict[str, np.ndarray]:
    """Samples of each remainder's variable, all trials together."""
    return {r.variable: np.concatenate([samples(system, run, r.symbol) for run in runs]) for r in remainders}
