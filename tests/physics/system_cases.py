"""Every system, its equations compiled and random states of it, for the tests of systems."""

from __future__ import annotations

import functools
from collections.abc import Callable

import numpy as np
import pytest
import sympy as sp
from hypothesis import settings
from hypothesis import strategies as st

from frictionpinn.physics import SYSTEMS, Coordinate, System

kinds = list(SYSTEMS.values())
every_kind = pytest.mark.parametrize("kind", kinds, ids=SYSTEMS.keys())
every_form = pytest.mark.parametrize(
    ("kind", "form", "driven"),
    [(kind, form, driven) for kind in kinds for form in kind.equations_allowed for driven in sorted({kind.driven, ()})],
    ids=lambda item: (" ".join(item) or "none driven") if isinstance(item, tuple) else getattr(item, "name", item),
)
some = settings(max_examples=25, deadline=None, derandomize=True)
seeds = st.integers(0, 2**32 - 1)


@functools.cache
def built(kind: type[System], form: str = "lagrange", driven: tuple[str, ...] | None = None) -> System:
    return kind(equations=form, driven=driven)


@functools.cache
def compiled(system: System, expr: sp.Expr) -> Callable:
    """A function of a state: a value for each symbol by name."""
    symbols = sorted(expr.free_symbols, key=str)
    function = sp.lambdify(symbols, expr, modules="math")
    return lambda state: function(*(state[symbol.name] for symbol in symbols))


@functools.cache
def residuals(system: System) -> dict[str, sp.Expr]:
    """The equation of every moving coordinate: kept, since deriving one takes a good part of a second."""
    return {c.name: system.residual(c) for c in system.moving}


@functools.cache
def lagrangian(system: System) -> dict[str, sp.Expr]:
    return {c.name: system.euler_lagrange(c) for c in system.coordinates}


def value(system: System, expr: sp.Expr, state: dict[str, float]) -> float:
    return compiled(system, sp.sympify(expr))(state)


def random_state(system: System, seed: int) -> dict[str, float]:
    """A random motion of the moving coordinates, random inputs, and parameters around the system's own."""
    rng = np.random.default_rng(seed)
    names = [s.name for c in system.moving for s in c.symbols] + [item.symbol.name for item in system.inputs]
    state = {name: rng.uniform(-3, 3) for name in names}
    state |= {s.name: 0.0 for c in system.coordinates if c.constrained for s in c.symbols}
    return state | {name: own * rng.uniform(0.5, 1.5) for name, own in system.values.items()}


Forces = float | dict[str, float]  # of friction at the only contact, or by contact


def by_contact(system: System, friction: float) -> Forces:
    """A friction force at the only contact; with several, one that differs from contact to contact."""
    if len(system.contacts) == 1:
        return friction
    return {contact.name: friction * (1 - 0.7 * k) + k for k, contact in enumerate(system.contacts)}


def at(friction: Forces, view: System) -> float:
    return friction[view.contacts[0].name] if isinstance(friction, dict) else friction


def balance(system: System, coordinate: Coordinate, state: dict[str, float], friction: Forces) -> float:
    """E + sum_k J_k F_k of a coordinate."""
    jacobians = [(value(system, view.jacobian[coordinate.name], state), at(friction, view)) for view in system.each]
    return value(system, residuals(system)[coordinate.name], state) + sum(J * F for J, F in jacobians)


def forced(system: System, state: dict[str, float], friction: Forces) -> dict[str, float]:
    """The state with the accelerations of the free coordinates (or the measured force) that this friction gives."""
    names = [system.inputs[0].symbol.name] if system.massless else [c.symbols[2].name for c in system.free]

    def rows(unknowns: np.ndarray) -> np.ndarray:
        trial = state | dict(zip(names, unknowns, strict=True))
        return np.array([balance(system, c, trial, friction) for c in system.free])

    zero, eye = np.zeros(len(names)), np.eye(len(names))
    slopes = np.column_stack([rows(column) - rows(zero) for column in eye])
    return state | dict(zip(names, np.linalg.solve(slopes, -rows(zero)), strict=True))


def moved(system: System, state: dict[str, float], h: float) -> dict[str, float]:
    """The state h seconds later, at constant acceleration."""
    later = dict(state)
    for q, qd, qdd in (c.symbols for c in system.coordinates):
        later[q.name] += h * state[qd.name] + h * h * state[qdd.name] / 2
        later[qd.name] += h * state[qdd.name]
    return later


def rate_of(system: System, expr: sp.Expr, state: dict[str, float], h: float = 1e-5) -> float:
    """Time derivative along the motion, by central differences of fourth order."""
    at = [value(system, expr, moved(system, state, k * h)) for k in (-2, -1, 1, 2)]
    return (at[0] - 8 * at[1] + 8 * at[2] - at[3]) / (12 * h)
