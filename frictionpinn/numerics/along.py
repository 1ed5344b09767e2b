"""Expressions in a contact's variables and in measured signals, along a simulation."""

from __future__ import annotations

import numpy as np
import sympy as sp

from ..physics.base import CONTACT
from ..physics.system import System
from .simulate import Simulation


def signal_symbols(system: System) -> dict[str, sp.Symbol]:
    """Measured signal -> its symbol in the equations of motion."""
    motion = {n: s for c in system.moving for n, s in zip(c.signals, c.symbols, strict=True)}
    return motion | {item.name: item.symbol for item in system.inputs}


def samples(system: System, run: Simulation, expression: sp.Expr) -> np.ndarray:
    """An expression in a contact's variables and measured signals at the samples of a simulation, shape (n,).

    ``system`` is as the contact sees it.
    """
    run = run.at(system.contacts[0].name)
    known = {CONTACT.t: run.t, CONTACT.v: run.v_slip, CONTACT.N: run.N}
    known |= {s: run.signals.get(n, np.zeros(len(run.t))) for n, s in signal_symbols(system).items()}
    expression = sp.sympify({CONTACT.s: system.slip_position, CONTACT.a: system.a_slip}.get(expression, expression))
    expression = expression.subs({par.symbol: system.values[par.name] for par in system.parameters})
    symbols = sorted(expression.free_symbols, key=str)
    value = sp.lambdify(symbols, expression, "numpy")(*(known[s] for s in symbols))
    return np.broadcast_to(np.asarray(value, dtype=float), run.t.shape).copy()
