"""Expressions in a contact's variables and in measured signals, along a simulation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import sympy as sp
from scipy.integrate import cumulative_trapezoid

from ..physics.base import CONTACT
from ..physics.system import System
from .simulate import Simulation

POWER = 0.95  # share of the slip velocity's power below the frequency of the fastest motion: beyond is noise


def signal_symbols(system: System) -> dict[str, sp.Symbol]:
    """Measured signal -> its symbol in the equations of motion."""
    motion = {n: s for c in system.moving for n, s in zip(c.signals, c.symbols, strict=True)}
    return motion | {item.name: item.symbol for item in system.inputs}


def samples(system: System, run: Simulation, expression: sp.Expr) -> np.ndarray:
    """An expression in a contact's variables and measured signals at the samples of a simulation, shape (n,).

    ``system`` is as the contact sees it. A slip position that no expression gives is the integral of the slip velocity.
    """
    run = run.at(system.contacts[0].name)
    if expression is CONTACT.s and system.slip_position is None:
        return cumulative_trapezoid(run.v_slip, run.t, initial=0.0)
    known = {CONTACT.t: run.t, CONTACT.v: run.v_slip, CONTACT.N: run.N}
    known |= {s: run.signals.get(n, np.zeros(len(run.t))) for n, s in signal_symbols(system).items()}
    expression = sp.sympify({CONTACT.s: system.slip_position, CONTACT.a: system.a_slip}.get(expression, expression))
    expression = expression.subs({par.symbol: system.values[par.name] for par in system.parameters})
    symbols = sorted(expression.free_symbols, key=str)
    value = sp.lambdify(symbols, expression, "numpy")(*(known[s] for s in symbols))
    return np.broadcast_to(np.asarray(value, dtype=float), run.t.shape).copy()


def fastest_period(runs: Sequence[Simulation]) -> float:
    """Period of the fastest motion, s: of each trial the frequency below which most of the slip velocity's power lies,
    the largest of all trials."""
    fastest = 0.0
    for run in runs:
        t = np.linspace(run.t[0], run.t[-1], len(run.t))
        for v_slip in (run.at(name).v_slip for name in run.contacts):
            power = np.abs(np.fft.rfft(np.interp(t, run.t, v_slip))[1:]) ** 2
            if power.sum() > 0:
                k = int(np.searchsorted(np.cumsum(power), POWER * power.sum()))
                fastest = max(fastest, (k + 1) / float(t[-1] - t[0]))
    return 1 / fastest if fastest > 0 else np.inf


def moving_mass(system: System, runs: Sequence[Simulation]) -> float:
    """Least force per slip acceleration of a contact along the motion, in its unit of mass or inertia.

    Infinite where the equation of motion has none. ``system`` is as the contact sees it.
    """
    slipping = [c for c in system.free if system.jacobian[c.name] != 0]
    if system.massless or len(slipping) != 1:
        return np.inf
    (c,) = slipping
    slope = sp.diff(system.residual(c), c.symbols[2]) / system.jacobian[c.name] ** 2
    return min(float(samples(system, run, slope).min()) for run in runs)
