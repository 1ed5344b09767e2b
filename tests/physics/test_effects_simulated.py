"""Mechanisms with effects, simulated: neutral values, sensitivities, speed, and what single effects do."""

from __future__ import annotations

import pickle
import time

import numpy as np
import pytest
import sympy as sp
from effect_cases import law_values, path, plain, simulator
from short_paths import PATHS, T

from frictionpinn.numerics.delay import shift_pieces, shift_samples, slopes
from frictionpinn.numerics.jumps import find_stops
from frictionpinn.numerics.paths import InputPath
from frictionpinn.numerics.simulate import Simulator
from frictionpinn.physics import EFFECTS, LAWS, SYSTEMS
from frictionpinn.physics.mechanism import Mechanism
from frictionpinn.physics.system import TIME

DEGREES = (35, 42.5, 50, 57.5, 65)
SIZES = {"delay_force": 3e-3, "delay_tau": 3e-3, "backlash_gap": 1e-6, "presliding": 0.5, "adhesion": 0.3}
SIZES |= {f"sensor_delay_{y}": 2e-3 for y in ("x", "v", "a", "theta", "omega", "alpha", "force", "x_v_a")}
SCALE = {"backlash_gap": 1e-6}  # strengths that matter at sizes far below 1


@pytest.mark.parametrize(("system", "law"), [("pob", "lugre"), ("drive", "coulomb"), ("damper", "coulomb_viscous")])
def test_neutral_values_give_the_same_trajectory(system, law):
    base, sim = Simulator(plain(system, law)), simulator(system, law)
    inputs, p = path(base.mechanism), law_values(law)
    steps = base.simulate(T, inputs, p).steps if base.mechanism.free or base.mechanism.memory else None
    expected = base.simulate(T, inputs, p, steps=steps)
    own = sim.simulate(T, inputs, p, steps=steps)
    for name in ("v_slip", "N", "F"):
        np.testing.assert_allclose(getattr(own, name), getattr(expected, name), atol=1e-9)
    for name in (n for c in base.mechanism.free for n in c.signals):
        np.testing.assert_allclose(own.signals[name], expected.signals[name], atol=1e-9)


def differences(sim: Simulator, inputs: InputPath, p: dict, name: str, steps, h: float, **options) -> dict:
    runs = [sim.simulate(inputs.t, inputs, p | {name: p[name] + s * h}, steps=steps, **options) for s in (1, -1)]
    return {key: (runs[0].signals[key] - runs[1].signals[key]) / (2 * h) for key in sim.mechanism.outputs}


@pytest.mark.parametrize(
    ("system", "law", "neutral"),
    [
        ("pob", "lugre", True),
        ("pob", "lugre", False),
        ("drive", "coulomb", True),
        ("drive", "coulomb_viscous", False),
        ("damper", "coulomb", False),
        ("pendulum", "dahl", False),
        ("sdob", "stribeck", False),
    ],
)
def test_sensitivities_to_every_parameter_of_every_effect(system, law, neutral):
    sim = simulator(system, law)
    own = {par.name: par for par in sim.mechanism.parameters}
    names = [name for name in own if name not in {par.name for par in plain(system, law).parameters}]
    p = law_values(law) | {name: own[name].value for name in names}
    if not neutral:
        p |= {name: size for name, size in SIZES.items() if name in own}
        p |= {name: 0.01 for name in names if own[name].neutral is not None and name not in SIZES}
    y0 = {c.signals[1]: 0.1 for c in sim.mechanism.free}
    inputs = path(sim.mechanism)
    found = sim.simulate(T, inputs, p, y0, sensitivities=names)
    for j, name in enumerate(names):
        tables = []
        for relative in (3e-2, 1e-3, 1e-4, 1e-5, 1e-6):
            h = relative * (abs(p[name]) or SCALE.get(name, 1e-1))
            tables.append(differences(sim, inputs, p, name, found.steps, h, y0=y0))
        for signal in sim.mechanism.outputs:
            slope = found.sensitivities[signal][:, j]
            limit = 1e-4 * max(np.abs(slope).max(), 1e-9)
            assert min(np.abs(slope - table[signal]).max() for table in tables) <= limit, (name, signal)


def test_all_sensitivities_of_six_trials_take_less_than_a_second():
    start = time.perf_counter()
    sim = Simulator(simulator("pob", "lugre").mechanism)
    assert sim.kernels.plain and sim.kernels.sensitivity
    assert time.perf_counter() - start < 30
    w, durations = 2 * sp.pi * sp.Rational(9, 10), [2.0] * 5 + [4.5]
    swings = [sp.rad(degrees) * sp.sin(2 * sp.pi * TIME) for degrees in DEGREES]
    swings.append(sp.rad(45) * sp.sin(w * TIME + 0.45 * sp.sin(w * TIME)))
    trials = []
    for swing, duration in zip(swings, durations, strict=True):
        t = np.arange(round(duration * 400) + 1) / 400
        trials.append(InputPath.from_expressions(sim.mechanism, t, {"theta": swing}))
    names = [par.name for par in sim.mechanism.parameters]
    sim.simulate(trials[0].t, trials[0], law_values("lugre"), sensitivities=names)
    spent = []
    for _ in range(3):
        start = time.perf_counter()
        for trial in trials:
            sim.simulate(trial.t, trial, law_values("lugre"), sensitivities=names)
        spent.append(time.perf_counter() - start)
    assert min(spent) < 1.0


# ---- what effects do


def with_effect(system: str, law: str, name: str, **values):
    sim = Simulator(Mechanism(SYSTEMS[system](), LAWS[law](), (name,)))
    return sim.simulate(T, path(sim.mechanism), law_values(law) | values), sim


def test_a_delayed_force_gives_the_motion_of_the_shifted_force():
    found, sim = with_effect("drive", "coulomb_viscous", "delay", delay_force=0.0123)
    late = {"force": PATHS["drive"]["force"].subs(TIME, TIME - sp.Rational(123, 10000))}
    base = Simulator(plain("drive", "coulomb_viscous"))
    expected = base.simulate(T, InputPath.from_expressions(base.mechanism, T, late), law_values("coulomb_viscous"))
    np.testing.assert_allclose(found.signals["v"], expected.signals["v"], atol=2e-3 * np.abs(expected.v).max())
    np.testing.assert_array_equal(found.signals["force"], path(sim.mechanism).signals["force"])


def test_a_late_sensor_shows_the_past():
    found, _ = with_effect("pob", "lugre", "sensor_delay", sensor_delay_x_v_a=0.01)
    steps = 4  # of 2.5 ms
    for j, name in enumerate(("x", "v", "a")):
        true = np.stack([found.q, found.v, found.a])[j, :, 0]
        np.testing.assert_allclose(found.signals[name][steps:], true[:-steps], atol=1e-9 * np.abs(true).max())


def test_told_as_sensors_show_it_a_motion_that_all_of_them_show_late_is_that_of_late_inputs():
    law = "coulomb_viscous"
    mechanism = Mechanism(SYSTEMS["drive"](), LAWS[law](), ("sensor_delay", "delay"))
    sim = Simulator(mechanism, as_shown=True)
    late, acts_late = (
        sim.simulate(T, path(mechanism), law_values(law) | {name: 0.0123}, sensitivities=[name, "mu_c"])
        for name in ("sensor_delay_x_v_a", "delay_force")
    )
    for name in ("x", "v", "a"):
        np.testing.assert_array_equal(late.signals[name], acts_late.signals[name])
        np.testing.assert_array_equal(late.sensitivities[name], acts_late.sensitivities[name])
    one = sim.simulate(T, path(mechanism), law_values(law) | {"sensor_delay_x": 0.01})  # the others show it at once
    np.testing.assert_allclose(one.signals["x"][4:], one.q[:-4, 0], atol=1e-9 * np.abs(one.q).max())


def test_a_late_sensor_of_a_driven_coordinate_means_that_the_truth_is_ahead():
    found, _ = with_effect("pob", "lugre", "sensor_delay", sensor_delay_theta_omega_alpha=0.005)
    ahead = {"theta": PATHS["pob"]["theta"].subs(TIME, TIME + sp.Rational(5, 1000))}
    base = Simulator(plain("pob", "lugre"))
    expected = base.simulate(T, InputPath.from_expressions(base.mechanism, T, ahead), law_values("lugre"))
    np.testing.assert_allclose(found.N[:-3], expected.N[:-3], atol=1e-6)
    np.testing.assert_allclose(found.v[:-3], expected.v[:-3], atol=1e-4)


@pytest.mark.parametrize(("system", "count"), [("pob", 1), ("drive", 1), ("pendulum", 1), ("sdob", 0), ("damper", 0)])
def test_strengths_that_are_equivalent_by_definition_show_the_same_motion(system, count):
    pairs = EFFECTS["sensor_delay"]().equivalents(SYSTEMS[system](), LAWS["lugre"]())
    assert len(pairs) == count
    for (own, other), factor in pairs.items():
        shown = [
            with_effect(system, "lugre", "delay" if name.startswith("delay") else "sensor_delay", **{name: value})[0]
            for name, value in ((own, 0.0), (own, 4e-3), (other, 4e-3 * factor))
        ]
        velocity = next(iter(plain(system, "lugre").free)).signals[1]
        prompt, late, driven = (run.signals[velocity][len(T) // 2 :] for run in shown)
        assert np.std(late - driven) < 0.05 * np.std(late - prompt)


def test_the_full_share_of_presliding_is_dahl_friction():
    length = 0.3 / 1e3
    found, _ = with_effect("damper", "coulomb", "presliding", presliding=1.0, presliding_length=length)
    dahl = Simulator(plain("damper", "dahl"))
    expected = dahl.simulate(T, path(dahl.mechanism), {"sigma_0": 1e3, "mu_c": 0.3})
    np.testing.assert_allclose(found.F, expected.F, atol=1e-4)
    np.testing.assert_allclose(found.signals["force"], found.F)


def test_a_gap_delays_the_force_after_a_reversal_by_twice_its_half_width():
    values = {"sigma_0": 1e3, "mu_c": 0.3, "backlash_gap": 1e-3, "backlash_width": 1e-6}
    sim = Simulator(Mechanism(SYSTEMS["damper"](), LAWS["dahl"](), ("backlash",)))
    result = sim.simulate(T, path(sim.mechanism), values, z0="steady")
    quiet = (np.abs(result.F) < 0.01) & (np.abs(result.signals["v"]) > 1e-3)
    back = T[-1] / 2 < T
    assert np.ptp(result.signals["x"][back & quiet]) == pytest.approx(2e-3, rel=0.15)


def test_static_friction_grows_at_rest():
    sim = Simulator(Mechanism(SYSTEMS["drive"](), LAWS["lugre"](), ("dwell",)))
    force = {"force": 0.68 * sp.sin(2 * sp.pi * TIME / 1.6)}
    inputs = InputPath.from_expressions(sim.mechanism, T, force)
    p = law_values("lugre") | {"dwell_length": 1e-3}
    moved = [sim.simulate(T, inputs, p | {"dwell": k}).signals["x"][-1] for k in (0.0, 0.2)]
    assert moved[0] > 1e-3 > 1e-4 > moved[1]


def test_a_slope_holds_a_body_from_a_steady_start_with_a_gap():
    sim = Simulator(Mechanism(SYSTEMS["drive"](), LAWS["lugre"](), ("constant_force", "backlash")))
    p = law_values("lugre") | {"constant_force": -0.4, "backlash_gap": 1e-4}
    result = sim.simulate(T, InputPath.from_signals(sim.mechanism, T, {}), p, z0="steady")
    assert np.abs(result.v).max() < 1e-9
    assert result.z[0] == pytest.approx(0.4 / 1e5 + 1e-4, rel=1e-3)


def test_a_simulator_with_effects_can_be_sent_to_another_process():
    found, sim = with_effect("drive", "coulomb", "drag", drag=0.5)
    again = pickle.loads(pickle.dumps(sim)).simulate(T, path(sim.mechanism), law_values("coulomb") | {"drag": 0.5})
    np.testing.assert_array_equal(again.v, found.v)


# ---- shifts


def test_a_jump_is_shown_late_as_a_jump():
    t, at = np.arange(201) / 100, 0.634

    def true(s):
        return np.where(s < at, 3 + 2 * s, 0.5 * s)

    jumps = [(63, at)]
    for shift in (-0.0235, -0.004, 0.002, 0.031):
        value, rate = shift_samples(t, true(t), slopes(t, true(t), jumps), shift, jumps)
        np.testing.assert_allclose(value, true(t - shift), atol=1e-12)
        np.testing.assert_allclose(rate, np.where(t - shift < at, -2.0, -0.5), atol=1e-9)


def test_a_stop_is_found_where_a_stribeck_curve_slows_the_body_down_faster_than_before():
    t, v = np.arange(6) * 1e-3, np.array([0.0281, 0.0192, 0.0102, -6e-6, -6e-6, -6e-6])
    a = np.array([-8.82, -8.85, -9.49, -1e-4, -1e-4, -1e-4])
    (stop,) = find_stops(t, v, a, a)
    assert stop.at == stop.moves == 2 and t[2] < stop.time <= t[3]


def test_a_shift_of_nothing_changes_nothing():
    rng = np.random.default_rng(0)
    t = np.sort(rng.uniform(0, 1, 40))
    coefficients = InputPath.from_signals(plain("drive", "coulomb"), t, {"force": rng.normal(size=40)}).coefficients
    scale = np.diff(t)[:, None, None] ** np.arange(6)
    np.testing.assert_allclose(shift_pieces(t, coefficients, 0.0) * scale, coefficients * scale, atol=1e-9)
    y, slope = np.sin(3 * t), 3 * np.cos(3 * t)
    np.testing.assert_allclose(shift_samples(t, y, slope, 0.0)[0], y, atol=1e-14)


@pytest.mark.parametrize("shift", [-0.013, 0.004, 0.03])
def test_shifted_samples_and_paths_agree_with_the_shifted_function(shift):
    t = np.arange(401) / 400
    mechanism = plain("drive", "coulomb")
    inside = (t > 0.04) & (t < 0.96)
    value, rate = shift_samples(t, np.sin(9 * t), 9 * np.cos(9 * t), shift)
    np.testing.assert_allclose(value[inside], np.sin(9 * (t - shift))[inside], atol=1e-9)
    np.testing.assert_allclose(rate[inside], -9 * np.cos(9 * (t - shift))[inside], atol=1e-5)
    exact = InputPath.from_expressions(mechanism, t, {"force": sp.sin(9 * TIME)})
    late = InputPath(exact.names, t, shift_pieces(t, exact.coefficients, shift))
    grid = np.linspace(0.05, 0.95, 97)
    found = np.array([late(moment)[0] for moment in grid])
    np.testing.assert_allclose(found, np.sin(9 * (grid - shift)), atol=1e-10)


def test_friction_jumps_at_a_stop_unless_a_bristle_acts():
    system, plain_law, lugre = SYSTEMS["drive"](), LAWS["coulomb_viscous"](), LAWS["lugre"]()
    with_presliding = Mechanism(system, plain_law, ("presliding",))
    assert Mechanism(system, plain_law).jumps({})
    assert not Mechanism(system, lugre).jumps({})
    assert with_presliding.jumps({"presliding": 0.0})
    assert not with_presliding.jumps({"presliding": 0.5})
    assert not with_presliding.jumps({"presliding": 0.0}, free=("presliding",))
