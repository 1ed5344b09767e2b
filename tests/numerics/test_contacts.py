"""Mechanisms with several contacts, simulated: against Radau, conserved energy, and mechanisms of one contact."""

from __future__ import annotations

import functools
from pathlib import Path

import numpy as np
import pytest
import sympy as sp
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from motions import radau

from frictionpinn.data.excitation import parse_expression
from frictionpinn.numerics.paths import InputPath
from frictionpinn.numerics.simulate import Simulator, Steps
from frictionpinn.physics import EFFECTS, LAWS, SYSTEMS
from frictionpinn.physics.contacts import by_parameter, laws_of
from frictionpinn.physics.effects import applicable
from frictionpinn.physics.friction import NoFriction
from frictionpinn.physics.mechanism import Mechanism

NAMES = [name for name, kind in SYSTEMS.items() if kind.contacts]
CONF = Path(__file__).resolve().parents[2] / "conf" / "system"
T = np.arange(241) / 400
few = settings(max_examples=15, deadline=None, derandomize=True)


@functools.cache
def declared(name):
    return yaml.safe_load((CONF / f"{name}.yaml").read_text(encoding="utf-8"))


@functools.cache
def simulator(name, law="lugre", effects=()):
    return Simulator(Mechanism(SYSTEMS[name](), LAWS[law](), effects))


def trial(name, k):
    """Expressions of the inputs and initial state of a trial of the system's own file."""
    spec = declared(name)["simulate"]["trials"][k]
    known = {item.name for item in SYSTEMS[name].inputs}
    return {key: parse_expression(text, key, {}) for key, text in spec.items() if key in known}, spec.get("initial", {})


def truth(sim):
    values = by_parameter(declared(sim.mechanism.system.name)["simulate"]["truth"], sim.mechanism.law)
    return dict(zip(sim.parameter_names, sim.parameters(values).tolist(), strict=True))


@pytest.mark.parametrize("k", [0, 1])
@pytest.mark.parametrize("name", NAMES)
def test_agrees_with_radau(name, k):
    sim, (expressions, initial) = simulator(name), trial(name, k)
    p, start = truth(sim), [initial.get(state, 0.0) for state in sim.state_names]
    reference = radau(sim.mechanism, p, expressions, T, start)
    rtol = 3e-6 if name == "two_mass" else 1e-5  # the coupling rings on, and errors in its phase add up
    result = sim.simulate(T, InputPath.from_expressions(sim.mechanism, T, expressions), p, initial, rtol=rtol)
    m = len(sim.mechanism.free)
    for j in range(2 * m):
        scale = max(np.abs(reference[j]).max(), 1.0)
        assert np.abs(result.states[:, j] - reference[j]).max() < 2e-5 * scale, sim.state_names[j]


@few
@given(
    name=st.sampled_from(NAMES),
    first=st.floats(-1.5, 1.5),
    second=st.floats(-1, 1),
    rate=st.floats(-2, 2),
)
def test_energy_is_kept_without_friction(name, first, second, rate):
    system = SYSTEMS[name](**({"c": 0.0} if name == "two_mass" else {}))
    sim = Simulator(Mechanism(system, {contact.name: NoFriction() for contact in system.contacts}))
    a, b = sim.mechanism.free
    hanging = np.pi if "theta" in (a.name, b.name) else 0.0
    y0 = {a.signals[0]: second, b.signals[0]: hanging + 0.6 * first, a.signals[1]: 0.2 * rate, b.signals[1]: rate}
    still = {item.name: sp.Integer(0) for item in system.inputs}
    path = InputPath.from_expressions(sim.mechanism, T, still)
    result = sim.simulate(T, path, {}, y0, rtol=1e-9, atol=1e-9)
    symbols = [s for c in (a, b) for s in c.symbols[:2]]
    holds = {s: 0 for c in system.coordinates if c.constrained for s in c.symbols}
    numbers = {par.symbol: system.values[par.name] for par in system.parameters} | holds
    kinetic, potential = (f(system.s, system.p).subs(numbers) for f in (system.kinetic, system.potential))
    energy, moving = (sp.lambdify(symbols, e, "numpy") for e in (kinetic + potential, kinetic))
    columns = [result.signals[name] for c in (a, b) for name in c.signals[:2]]
    assert np.ptp(energy(*columns)) < 1e-6 * max(moving(*columns).max(), 1e-3)


# ---- two drives without a coupling are two joints with one contact each


def apart(effects=(), laws=("lugre", "lugre")):
    """The two-mass drive without its coupling, and a joint for each side with the same law and effects."""
    system = SYSTEMS["two_mass"](k=0.0, c=0.0)
    sides = dict(zip(("motor", "load"), laws, strict=True))
    both = [f"{name}@{side}" for side in sides for name in effects]
    whole = Simulator(Mechanism(system, {side: LAWS[law]() for side, law in sides.items()}, tuple(both)))
    joints = {
        side: Simulator(Mechanism(SYSTEMS["joint"](J=system.values[f"J_{side[0]}"]), LAWS[law](), tuple(effects)))
        for side, law in sides.items()
    }
    return whole, joints


def one_side(values, side):
    return {name.removeprefix(f"{side}."): value for name, value in values.items() if name.startswith(f"{side}.")}


SIGNALS = {"motor": ("theta_m", "omega_m", "alpha_m"), "load": ("theta_l", "omega_l", "alpha_l")}
STRENGTHS = {"asymmetry": 0.2, "dwell": 0.5, "stribeck_rise": 0.5, "constant_force": 0.03, "presliding": 0.7,
             "backlash_gap": 1e-4, "drag": 0.02, "position_gradient": 0.1, "viscous": 0.01}  # fmt: skip
LAWS_AND_EFFECTS = [
    (("lugre", "lugre"), ()),
    (("lugre", "dahl"), ("asymmetry", "dwell", "backlash")),
    (("dahl", "coulomb"), ("constant_force", "stribeck", "position_friction")),
    (("coulomb", "stribeck"), ("presliding", "drag")),
]


@pytest.mark.parametrize(("laws", "effects"), LAWS_AND_EFFECTS, ids=str)
def test_contacts_that_nothing_couples_are_mechanisms_of_one_contact(laws, effects):
    whole, joints = apart(effects, laws)
    values = {"sigma_0": 500.0, "sigma_1": 1.0, "sigma_2": 0.01, "mu_c": 0.1, "mu_s": 0.16, "v_s": 0.05, "v_t": 1e-3}
    names = [par.name for par in whole.mechanism.parameters if "." in par.name]
    plain = {name: name.partition(".")[2] for name in names}
    p = {name: values[own] for name, own in plain.items() if own in values}
    p |= {name: STRENGTHS[own] for name, own in plain.items() if own in STRENGTHS}
    y0, torque = {"omega_l": 3.0, "theta_l": 0.2}, 0.8 * sp.sin(9 * sp.Symbol("t", real=True))
    run = whole.simulate(
        T, InputPath.from_expressions(whole.mechanism, T, {"tau": torque}), p, y0, z0="steady", sensitivities=names
    )
    for side, joint in joints.items():
        given_ = {"tau": torque if side == "motor" else sp.Integer(0)}
        start = dict(zip(("theta", "omega"), (y0.get(name, 0.0) for name in SIGNALS[side][:2]), strict=True))
        own = [name for name in names if name.startswith(f"{side}.")]
        path = InputPath.from_expressions(joint.mechanism, T, given_)
        # The other side's errors choose its steps: compared along the steps of both.
        alone = joint.simulate(T, path, one_side(p, side), start, z0="steady", steps=steps_of(run, joint, side),
                               sensitivities=[plain[name] for name in own])  # fmt: skip
        there = run.at(side)
        columns = [names.index(name) for name in own]
        for name, shown in zip(SIGNALS[side], ("theta", "omega", "alpha"), strict=True):
            close(run.signals[name], alone.signals[shown])
            close(run.sensitivities[name][:, columns], alone.sensitivities[shown])
            others = np.delete(run.sensitivities[name], columns, axis=1)
            assert not np.any(others), f"{name} depends on the other contact"
        for name in ("F", "z", "zdot", "v_slip", "N"):
            close(getattr(there, name), getattr(alone, name))
            close(there.sensitivities[name][:, columns], alone.sensitivities[name])


def close(found, expected):
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-7 * np.abs(expected).max() + 1e-12)


def steps_of(run, joint, side):
    """The steps of both sides as a guide for one of them: only their places and sizes count."""
    n_w = joint.kernels.sizes[1]
    return Steps(run.steps.interval, run.steps.size, np.zeros((len(run.steps), run.steps.unknowns.shape[1], n_w)))


# ---- the start


def test_contacts_that_can_hold_stay_at_rest_from_a_steady_start():
    sim = simulator("double_pendulum")
    p = truth(sim)
    torques = {"tau_1": sp.Rational(12, 100), "tau_2": sp.Rational(-6, 100)}
    run = sim.simulate(T, InputPath.from_expressions(sim.mechanism, T, torques), p, z0="steady")
    assert np.abs(run.v).max() < 1e-10
    np.testing.assert_allclose(run.at("shoulder").F, 0.12, rtol=1e-8)
    np.testing.assert_allclose(run.at("elbow").F, -0.06, rtol=1e-8)


def test_a_contact_beyond_its_limit_starts_there_and_the_other_holds_what_is_left():
    sim = simulator("two_mass")
    p = truth(sim)
    run = sim.simulate(T[:2], InputPath.from_expressions(sim.mechanism, T[:2], {"tau": sp.Integer(1)}), p, z0="steady")
    assert run.at("motor").F[0] == pytest.approx(p["motor.mu_s"], rel=0.05)
    assert run.at("load").F[0] == pytest.approx(0.0, abs=1e-9)  # nothing pulls it before the coupling twists


def test_a_sliding_contact_starts_at_its_steady_force_while_the_other_rests():
    sim = simulator("two_mass")
    p = truth(sim)
    path = InputPath.from_expressions(sim.mechanism, T, {"tau": sp.Rational(1, 20)})
    run = sim.simulate(T, path, p, {"omega_l": -2.0}, z0="steady")
    assert run.at("load").F[0] == pytest.approx(-(p["load.mu_c"] + 2 * p["load.sigma_2"]), rel=1e-6)
    assert run.at("motor").F[0] == pytest.approx(0.05 - 0.01 * 2, rel=1e-6)  # less the coupling's damping


def test_sensitivities_follow_a_steady_start_of_two_contacts():
    sim = simulator("double_pendulum")
    p, names = truth(sim), ["shoulder.sigma_0", "elbow.sigma_0", "elbow.mu_c", "m_2"]
    torques = {"tau_1": sp.Rational(5, 100), "tau_2": sp.Rational(2, 100)}
    path = InputPath.from_expressions(sim.mechanism, T[:5], torques)
    y0 = {"theta_1": 0.01, "theta_2": 0.02}
    run = sim.simulate(T[:5], path, p, y0, z0="steady", sensitivities=names)
    values = dict(zip(sim.parameter_names, sim.parameters(p), strict=True))
    for j, name in enumerate(names):
        h = 1e-5 * values[name]
        up, down = (sim.simulate(T[:5], path, values | {name: values[name] + d}, y0, z0="steady") for d in (h, -h))
        for contact in ("shoulder", "elbow"):
            slope = (up.at(contact).z - down.at(contact).z) / (2 * h)
            found = run.sensitivities[f"{contact}.z"][:, j]
            assert np.abs(found - slope).max() <= 1e-5 * np.abs(slope).max() + 1e-12, (name, contact)


# ---- names and effects


@pytest.mark.parametrize("name", NAMES)
def test_every_effect_acts_at_every_contact_and_does_nothing_at_its_neutral_value(name):
    plain = simulator(name).mechanism
    effects = applicable(plain.system, plain.law)
    mechanism = Mechanism(plain.system, plain.law, effects)
    contacts = {contact.name for contact in plain.system.contacts}
    located = {tuple(effect.name.split("@")) for effect in effects if "@" in effect.name}
    kinds = {kind for kind, _ in located}
    if all(at.N.free_symbols <= {par.symbol for par in plain.system.parameters} for at in plain.system.each):
        assert located == {(kind, contact) for kind in kinds for contact in contacts}
    assert {effect.name for effect in effects if "@" not in effect.name} == {
        effect.name for effect in effects if EFFECTS[effect.name.partition("@")[0]].whole
    }
    neutral = {par.symbol: par.neutral for par in mechanism.parameters if par.neutral is not None}
    numbers = {par.symbol: 0.3 + 0.1 * k for k, par in enumerate(plain.parameters)}
    numbers |= {s: 0.11 * (k + 1) for k, s in enumerate(s for c in plain.system.moving for s in c.symbols)}
    numbers |= {item.symbol: 0.7 for item in plain.system.inputs}
    numbers |= {s: 1e-3 * (k + 1) for k, contact in enumerate(plain.contacts) for s in (contact.z, contact.zdot)}
    for with_effects, without in zip(mechanism.residuals, plain.residuals, strict=False):
        if with_effects.free_symbols & {s for state in mechanism.states for s in (state.rate,)}:
            break  # rows of the effects' own states
        hidden = {par.symbol: 0.5 for par in mechanism.parameters if par.hidden} | {
            state.symbol: 0.1 for state in mechanism.states
        }
        difference = with_effects.xreplace(neutral).xreplace(hidden | numbers) - without.xreplace(numbers)
        clocks = dict.fromkeys(difference.free_symbols, 1.0)
        assert abs(float(difference.xreplace(clocks))) < 1e-9


def test_a_law_for_all_contacts_is_that_law_at_each():
    system = SYSTEMS["cartpole"]()
    assert laws_of(system, LAWS["dahl"]()).name == "dahl"
    mixed = Mechanism(system, {"bearing": NoFriction(), "rail": LAWS["coulomb"]()})
    assert mixed.name == "cartpole+coulomb@rail+none@bearing"
    assert [par.name for par in mixed.parameters if "." in par.name] == ["rail.mu_c", "rail.v_t"]
    assert mixed.units["rail.mu_c"] == "1" and mixed.units["rail.v_t"] == "m/s"
    assert simulator("cartpole").mechanism.units["bearing.sigma_0"] == "N*m/rad"
