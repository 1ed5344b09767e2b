"""Every system in SYSTEMS: equations against independent derivations, and balances."""

from __future__ import annotations

import functools
import math

import numpy as np
import pytest
import sympy as sp
from hypothesis import given
from hypothesis import strategies as st
from system_cases import (
    at,
    balance,
    built,
    by_contact,
    every_form,
    every_kind,
    forced,
    kinds,
    lagrangian,
    moved,
    random_state,
    rate_of,
    residuals,
    seeds,
    some,
    value,
)

from frictionpinn.errors import UserError
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.mechanism import Mechanism

near = functools.partial(pytest.approx, rel=1e-6, abs=1e-6)


# ---- the equations


def pob_rows(s: dict[str, float]) -> tuple[dict[str, float], float]:
    sine, cosine, lever = math.sin(s["theta"]), math.cos(s["theta"]), s["m_L"] * s["d"]
    omega, alpha, a = s["theta_dot"], s["theta_ddot"], s["x_ddot"]
    x = (s["m_b"] + s["m_L"]) * a + lever * (alpha * cosine - omega**2 * sine)
    theta = (s["J_L"] + lever * s["d"]) * alpha + lever * a * cosine - lever * s["g"] * sine - s["tau_in"]
    return {"x": x, "theta": theta}, (s["m_b"] + s["m_L"]) * s["g"] - lever * (alpha * sine + omega**2 * cosine)


def sdob_rows(s: dict[str, float]) -> tuple[dict[str, float], float]:
    spring = s["k"] * (s["rest"] - s["y"]) - s["c"] * s["y_dot"]
    x = (s["m_1"] + s["m_2"]) * s["x_ddot"] - s["force_in"]
    return {"x": x, "y": s["m_2"] * (s["y_ddot"] + s["g"]) - spring}, s["m_1"] * s["g"] + spring


def drive_rows(s: dict[str, float]) -> tuple[dict[str, float], float]:
    return {"x": s["M"] * s["x_ddot"] - s["force_in"]}, s["preload"]


def pendulum_rows(s: dict[str, float]) -> tuple[dict[str, float], float]:
    inertia, weight = s["J"] + s["m"] * s["l"] ** 2, s["m"] * s["g"] * s["l"]
    return {"theta": inertia * s["theta_ddot"] - weight * math.sin(s["theta"]) - s["tau_in"]}, s["preload"]


def damper_rows(s: dict[str, float]) -> tuple[dict[str, float], float]:
    return {"x": -s["force_in"]}, s["preload"]


BY_HAND = {"pob": pob_rows, "sdob": sdob_rows, "drive": drive_rows, "pendulum": pendulum_rows, "damper": damper_rows}


@pytest.mark.parametrize("name", BY_HAND)
@some
@given(seed=seeds)
def test_the_equations_and_the_normal_force_are_those_derived_by_hand(name, seed):
    system = built(SYSTEMS[name])
    state = random_state(system, seed)
    rows, normal = BY_HAND[name](state)
    assert {name: value(system, row, state) for name, row in residuals(system).items()} == near(rows, rel=1e-9)
    assert value(system, system.N, state) == near(normal, rel=1e-9)


@every_kind
@some
@given(seed=seeds)
def test_the_equations_follow_from_the_energies_by_finite_differences(kind, seed):
    system, h = built(kind), 1e-4
    state, s, p = random_state(system, seed), system.s, system.p
    kinetic, potential, dissipation = system.kinetic(s, p), system.potential(s, p), system.dissipation(s, p)

    def slope(expr: sp.Expr, name: str, at: dict[str, float]) -> float:
        up, down = at | {name: at[name] + h}, at | {name: at[name] - h}
        return (value(system, expr, up) - value(system, expr, down)) / (2 * h)

    for coordinate in system.coordinates:
        q, qd, _ = (symbol.name for symbol in coordinate.symbols)
        momentum = [slope(kinetic, qd, moved(system, state, k * h)) for k in (-1, 1)]
        expected = (momentum[1] - momentum[0]) / (2 * h) - slope(kinetic, q, state) + slope(potential, q, state)
        expected += slope(dissipation, qd, state) - value(system, system.applied(s, p).get(coordinate.name, 0), state)
        assert value(system, lagrangian(system)[coordinate.name], state) == near(expected, rel=1e-4, abs=1e-4)


@some
@given(seed=seeds)
def test_the_published_pendulum_on_a_box_differs_in_inertia_velocity_term_and_normal_force(seed):
    derived, published = built(SYSTEMS["pob"]), built(SYSTEMS["pob"], "published")
    s = random_state(derived, seed)

    def difference(name: str) -> float:
        return value(published, residuals(published)[name], s) - value(derived, residuals(derived)[name], s)

    lever, sine, alpha = s["m_L"] * s["d"], math.sin(s["theta"]), s["theta_ddot"]
    assert difference("x") == 0
    assert difference("theta") == near(lever * (1 - s["d"]) * alpha - lever * s["x_dot"] * s["theta_dot"] * sine)
    assert value(published, published.N, s) - value(derived, derived.N, s) == near(lever * alpha * sine)


# ---- friction in the equations


@every_form
@some
@given(seed=seeds, friction=st.floats(-20, 20))
def test_the_implied_friction_inverts_the_equations_of_motion(kind, form, driven, seed, friction):
    system = built(kind, form, driven)
    forces = by_contact(system, friction)
    state = forced(system, random_state(system, seed), forces)
    if len(system.contacts) > len(system.free):
        with pytest.raises(UserError, match="do not tell the friction forces apart"):
            _ = system.each[0].friction_implied
        return
    for view in system.each:
        assert value(system, view.friction_implied, state) == near(at(forces, view))


@every_form
@some
@given(seed=seeds)
def test_the_frictionless_acceleration_is_that_of_no_friction(kind, form, driven, seed):
    system = built(kind, form, driven)
    state = forced(system, random_state(system, seed), 0.0)
    for view in system.each:
        assert value(system, view.a_frictionless, state) == near(value(system, view.a_slip, state))


@every_kind
@some
@given(seed=seeds)
def test_the_slip_acceleration_is_the_rate_of_the_slip_velocity(kind, seed):
    system = built(kind)
    state = random_state(system, seed)
    for view in system.each:
        assert value(system, view.a_slip, state) == near(rate_of(system, view.v_slip, state), abs=1e-5)


@pytest.mark.parametrize(
    ("name", "law"), [*((name, "lugre") for name in SYSTEMS), *(("drive", law) for law in LAWS if law != "lugre")]
)
@some
@given(seed=seeds)
def test_a_mechanism_s_residuals_hold_the_law_s_force(name, law, seed):
    mechanism = Mechanism(built(SYSTEMS[name]), LAWS[law]())
    rng, system = np.random.default_rng(seed), mechanism.system
    state = random_state(system, seed)
    state |= {s.name: rng.uniform(-1, 1) for contact in mechanism.contacts for s in (contact.z, contact.zdot)}
    state |= {par.name: rng.uniform(0.5, 1.5) for par in mechanism.law.parameters}
    forces = {contact.name: value(system, contact.friction, state) for contact in mechanism.contacts}
    rows = [balance(system, c, state, forces) for c in mechanism.free]
    for contact in mechanism.bristles:
        rows.append(state[contact.zdot.name] - value(system, contact.bristle_rate, state))
    assert [value(system, row, state) for row in mechanism.residuals] == near(rows, rel=1e-9)


# ---- balances


@pytest.mark.parametrize("kind", [kind for kind in kinds if not kind.massless], ids=lambda kind: kind.name)
@some
@given(seed=seeds, friction=st.floats(-20, 20))
def test_energy_changes_by_what_friction_dampers_and_inputs_do(kind, seed, friction):
    system = built(kind, "lagrange", ())
    forces = by_contact(system, friction)
    state, s, p = forced(system, random_state(system, seed), forces), system.s, system.p
    applied = system.applied(s, p)
    power = sum(value(system, sp.sympify(applied.get(c.name, 0)) * c.symbols[1], state) for c in system.moving)
    power -= sum(at(forces, view) * value(system, view.v_slip, state) for view in system.each)
    power -= 2 * value(system, system.dissipation(s, p), state)
    energy = system.kinetic(s, p) + system.potential(s, p)
    assert rate_of(system, energy, state) == near(power, rel=1e-5, abs=1e-4)


def test_the_published_pendulum_on_a_box_breaks_the_energy_balance():
    system = built(SYSTEMS["pob"], "published", ())
    state, s, p = forced(system, random_state(system, 1) | {"tau_in": 0.0}, 0.0), system.s, system.p
    assert abs(rate_of(system, system.kinetic(s, p) + system.potential(s, p), state)) > 0.1


@some
@given(seed=seeds, friction=st.floats(-20, 20))
def test_friction_alone_changes_the_horizontal_momentum_of_the_pendulum_on_a_box(seed, friction):
    system = built(SYSTEMS["pob"])
    s, p = system.s, system.p
    momentum = p.m_b * s.x_dot + p.m_L * (s.x_dot + p.d * sp.cos(s.theta) * s.theta_dot)
    state = forced(system, random_state(system, seed), friction)
    assert rate_of(system, momentum, state) == near(-friction, rel=1e-5, abs=1e-4)


@pytest.mark.parametrize(("name", "masses"), [("pob", ("m_b", "m_L")), ("sdob", ("m_1", "m_2"))])
@some
@given(seed=seeds)
def test_the_ground_carries_the_whole_weight_at_rest(name, masses, seed):
    system = built(SYSTEMS[name])
    state = random_state(system, seed)
    state |= {symbol.name: 0.0 for c in system.moving for symbol in c.symbols[1:]}
    if name == "sdob":
        state["y"] = state["rest"] - state["m_2"] * state["g"] / state["k"]
    assert value(system, system.N, state) == near(sum(state[m] for m in masses) * state["g"], rel=1e-9)


@pytest.mark.parametrize("name", ["drive", "pendulum", "damper"])
def test_the_preload_is_the_normal_force_where_no_weight_rests_on_the_contact(name):
    system = built(SYSTEMS[name])
    assert system.p.preload == system.N
