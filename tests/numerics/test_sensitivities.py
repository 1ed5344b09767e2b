"""Derivatives of a simulation against central differences."""

from itertools import pairwise

import numpy as np
import pytest
import sympy as sp
from motions import all_values, path, simulator, values
from short_paths import T

from frictionpinn.numerics.paths import InputPath
from frictionpinn.numerics.simulate import SimulationFailed, Simulator
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.mechanism import Mechanism
from frictionpinn.physics.system import TIME

STEPS = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)


def differences(sim, inputs, p, y0, name, steps, relative, **options):
    """Central differences of every output over the same steps, for one relative change of a parameter or state.

    Each comes with the error that roundoff in the output makes.
    """
    p, y0 = dict(zip(sim.parameter_names, sim.parameters(p), strict=True)), dict(y0)
    table, key = (y0, name[:-3]) if name.endswith("(0)") else (p, name)
    base = table.get(key, 0.0)
    h = relative * (abs(base) or 1e-2)
    runs = []
    for value in (base + h, base - h):
        table[key] = value
        try:
            runs.append(sim.simulate(inputs.t, inputs, p, y0, steps=steps, **options))
        except SimulationFailed:  # the recorded steps are too long for so large a change
            return {}
    at_contacts = [contact.z.name.rpartition("z")[0] for contact in sim.mechanism.contacts]
    outputs = [f"{at}{name}" for at in at_contacts for name in ("N", "F", "z", "zdot", "v_slip")]
    outputs += list(sim.mechanism.predictions)
    above, below = ({name: quantity(run, name) for name in outputs} for run in runs)
    return {name: ((above[name] - below[name]) / (2 * h), 1e-15 * np.abs(above[name]).max() / h) for name in outputs}


def quantity(result, name):
    contact, _, own = name.rpartition(".")
    return result.signals[name] if name in result.signals else getattr(result.at(contact), own)


@pytest.mark.parametrize("law", ["lugre", "dahl", "coulomb_viscous", "stribeck"])
@pytest.mark.parametrize("system", list(SYSTEMS))
def test_sensitivities_agree_with_central_differences(system, law):
    sim = simulator(system, law)
    inputs, p = path(sim), all_values(sim)
    names = [*sim.parameter_names, *(f"{name}(0)" for name in sim.state_names)]
    y0 = dict.fromkeys(sim.state_names, 0.0) | {c.signals[1]: 0.1 for c in sim.mechanism.free}
    result = sim.simulate(T, inputs, p, y0, sensitivities=names)
    assert result.sensitivity_names == tuple(names)
    for j, name in enumerate(names):
        tables = [differences(sim, inputs, p, y0, name, result.steps, relative) for relative in STEPS]
        for output, derivatives in result.sensitivities.items():
            check(derivatives[:, j], [table[output] for table in tables if table], f"d {output} / d {name}")


def check(found, candidates, what):
    """Agreement to 1e-5 with the best of several central differences and their Richardson extrapolations.

    Truncation asks for a small change and roundoff for a large one: a regularised sign over 1e-4 m/s leaves little
    room between them.
    """
    pairs = pairwise(candidates)
    candidates = candidates + [((100 * b - a) / 99, noise_b) for (a, _), (b, noise_b) in pairs]
    scale = np.abs(found).max()
    assert any(np.abs(found - candidate).max() <= 1e-5 * scale + noise for candidate, noise in candidates), what


def test_sensitivities_follow_a_steady_start():
    sim, p = simulator("drive", "lugre"), values("lugre")
    inputs = path(sim, expressions={"force": sp.Rational(1, 2) + 3 * TIME})
    names = ["sigma_0", "mu_c", "preload"]
    result = sim.simulate(T, inputs, p, z0="steady", sensitivities=names)
    for j, name in enumerate(names):
        tables = [differences(sim, inputs, p, {}, name, result.steps, relative, z0="steady") for relative in STEPS]
        for output in ("v", "z", "F"):
            check(result.sensitivities[output][:, j], [table[output] for table in tables if table], name)


@pytest.mark.parametrize("law", ["coulomb_viscous", "lugre"])
@pytest.mark.parametrize(("speed", "z0"), [(0.1, "steady"), (0.1, 0.0), (0.0, 0.0)])
def test_sensitivities_follow_the_state_of_an_effect_that_starts_where_it_rests(law, speed, z0):
    sim = simulator("drive", law, effects=("dwell",))
    p = values(law) | {"dwell": 0.3, "dwell_time": 0.1, "dwell_length": 0.05}
    inputs, y0 = path(sim), {"v": speed}
    names = ["dwell", "dwell_time", "dwell_length", *(["v(0)"] if speed else [])]
    result = sim.simulate(T, inputs, p, y0, z0=z0, sensitivities=names)
    for j, name in enumerate(names):
        tables = [differences(sim, inputs, p, y0, name, result.steps, relative, z0=z0) for relative in STEPS]
        for output in ("v", "a", "F"):
            check(result.sensitivities[output][:, j], [table[output] for table in tables if table], name)


def test_sensitivity_to_the_input_path():
    sim, p = simulator("pob", "lugre"), values("lugre")
    bump = {"theta": sp.sin(5 * TIME) ** 2}
    inputs, direction = path(sim), path(sim, expressions=bump)
    result = sim.simulate(T, inputs, p, sensitivities=["mu_c"], directions={"bump": direction})
    h = 1e-6
    runs = [
        sim.simulate(
            T, InputPath(inputs.names, T, inputs.coefficients + s * direction.coefficients), p, steps=result.steps
        )
        for s in (h, -h)
    ]
    assert result.sensitivity_names == ("mu_c", "bump")
    for output in ("v", "a", "N", "F", "z"):
        expected = (quantity(runs[0], output) - quantity(runs[1], output)) / (2 * h)
        assert np.abs(result.sensitivities[output][:, 1] - expected).max() < 1e-5 * np.abs(expected).max()


@pytest.mark.parametrize("system", ["pob", "drive"])
def test_sensitivities_of_the_motion_do_not_change_where_those_of_the_contact_are_left_out(system):
    sim, p = simulator(system, "lugre"), values("lugre")
    names = ["mu_c", "sigma_1", f"{sim.state_names[0]}(0)"]
    full = sim.simulate(T, path(sim), p, sensitivities=names)
    found = sim.simulate(T, path(sim), p, sensitivities=names, contact=False)
    assert set(full.sensitivities) - set(found.sensitivities) == {"v_slip", "N", "F"}
    for signal, derivatives in found.sensitivities.items():
        assert np.array_equal(derivatives, full.sensitivities[signal])
    assert np.array_equal(found.F, full.F)


def test_the_force_of_an_imposed_motion_keeps_its_sensitivities():
    sim, p = simulator("damper", "lugre"), values("lugre")
    full, found = (sim.simulate(T, path(sim), p, sensitivities=["mu_c"], contact=flag) for flag in (True, False))
    assert np.array_equal(found.sensitivities["force"], full.sensitivities["F"]) and full.sensitivities["F"].any()
    assert "F" not in found.sensitivities


def test_an_imposed_motion_requires_friction_and_inertia_and_its_friction_is_told_alone():
    system, effects = SYSTEMS["drive"](imposed=True, M=2.0), ("payload", "sensor_scale")
    sim = Simulator(Mechanism(system, LAWS["coulomb_viscous"](), effects))
    motion = {"x": 0.05 * np.sin(6 * T), "v": 0.3 * np.cos(6 * T), "a": -1.8 * np.sin(6 * T)}
    p = {"mu_c": 3.0, "sigma_2": 4.0, "payload_M": 0.5, "scale_force": 0.05}
    run = sim.simulate(T, motion, p, sensitivities=["payload_M", "scale_force", "sigma_2"])
    np.testing.assert_allclose(run.required, run.F + 2.5 * motion["a"])
    np.testing.assert_allclose(run.signals["force"], 1.05 * run.required)
    wanted = [1.05 * motion["a"], run.required, 1.05 * motion["v"]]
    np.testing.assert_allclose(run.sensitivities["force"].T, wanted, atol=1e-12)
    zero = np.zeros(len(T))
    np.testing.assert_allclose(run.sensitivities["F"].T, [zero, zero, motion["v"]], atol=1e-12)
