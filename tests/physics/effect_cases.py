"""Mechanisms with effects, and values for them, that the tests of effects share."""

from __future__ import annotations

import functools

import numpy as np
import pytest
import sympy as sp
from short_paths import ALL, LAW_VALUES, PATHS, T

from frictionpinn.numerics.paths import InputPath
from frictionpinn.numerics.simulate import Simulator
from frictionpinn.physics import EFFECTS, SYSTEMS
from frictionpinn.physics.effects import applicable
from frictionpinn.physics.friction import CONTACT_LAWS
from frictionpinn.physics.mechanism import Mechanism

every_effect = pytest.mark.parametrize("name", EFFECTS)
every_pair = pytest.mark.parametrize(("system", "law"), ALL)


def beside(law: str) -> tuple[str, ...]:
    """What a gap needs beside it where the law has no bristle."""
    return () if CONTACT_LAWS[law].memory else ("presliding",)


@functools.cache
def plain(system: str, law: str) -> Mechanism:
    return Mechanism(SYSTEMS[system](), CONTACT_LAWS[law]())


@functools.cache
def everything(system: str, law: str) -> Mechanism:
    base = plain(system, law)
    return Mechanism(base.system, base.law, applicable(base.system, base.law, beside(law)))


@functools.cache
def alone(name: str, system: str, law: str) -> Mechanism | None:
    """The mechanism with one effect, and what it needs; None where it cannot act."""
    base = plain(system, law)
    effect = EFFECTS[name]()
    if effect.applies(base.system, base.law):
        return Mechanism(base.system, base.law, (effect,))
    if effect.applies(base.system, base.law, beside(law)):
        return Mechanism(base.system, base.law, (effect, *beside(law)))
    return None


def cases(name: str) -> list[tuple[str, str]]:
    """Systems and laws with which it can act; those without friction where it can act beside no law."""
    acting = [pair for pair in ALL if alone(name, *pair) is not None]
    return acting or [(system, "none") for system in dict(ALL) if alone(name, system, "none") is not None]


def strengths(mechanism: Mechanism, name: str) -> list[str]:
    effect = next(e for e in mechanism.effects if e.name == name)
    return [par.name for par in effect.parameters_on(mechanism.system, mechanism.law) if not par.hidden]


@functools.cache
def function(mechanism: Mechanism, *more: sp.Expr):
    """(values by symbol name) -> residuals, contact, friction and ``more`` as a flat array."""
    contact = [expr for symbol, expr in mechanism.contact.items() if symbol.name in ("v_slip", "N")]
    expressions = [*mechanism.residuals, *contact, mechanism.friction, *more]
    symbols = sorted({s for e in expressions for s in sp.sympify(e).free_symbols}, key=str)
    compiled = sp.lambdify(symbols, [sp.sympify(e) for e in expressions], modules="math", cse=True)
    return lambda values: np.array(compiled(*(values[s.name] for s in symbols)), float)


def random_values(mechanism: Mechanism, seed: int) -> dict[str, float]:
    """A random state, loaded contact and parameters; strengths neutral."""
    rng, system = np.random.default_rng(seed), mechanism.system
    values = {s.name: rng.uniform(-0.1, 0.1) for c in system.coordinates for s in c.symbols}
    values |= {item.symbol.name: rng.uniform(-3, 3) for item in system.inputs}
    values |= {"z": rng.uniform(-1e-4, 1e-4), "zdot": rng.uniform(-1, 1), "t": rng.uniform(0.1, 2)}
    values |= {"t_session": values["t"], "trial": 1.0}
    values |= {"age": rng.uniform(0, 1e-4), "age_dot": rng.uniform(-1, 1)}
    for par in mechanism.parameters:
        own = system.values.get(par.name, LAW_VALUES.get(par.name, par.value))
        values[par.name] = par.value if par.neutral is not None else own * rng.uniform(0.8, 1.2)
    return values


@functools.cache
def simulator(system: str, law: str) -> Simulator:
    return Simulator(everything(system, law))


def path(mechanism: Mechanism, t: np.ndarray = T) -> InputPath:
    return InputPath.from_expressions(mechanism, t, PATHS[mechanism.system.name])


def law_values(law: str) -> dict[str, float]:
    return {par.name: LAW_VALUES[par.name] for par in CONTACT_LAWS[law].parameters}
