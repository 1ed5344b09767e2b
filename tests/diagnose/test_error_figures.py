"""Errors before and after, beside the noise floor, with outliers and without."""

from __future__ import annotations

import numpy as np
import pytest

from frictionpinn.data.noise import GaussianNoise, OutlierNoise
from frictionpinn.data.simulated import simulate_recording
from frictionpinn.diagnose.bench import Bench
from frictionpinn.diagnose.errors import FORCE, compare
from frictionpinn.numerics.coloured import lone
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.mechanism import Mechanism

TRUTH = {"sigma_0": 2e4, "sigma_1": 150.0, "sigma_2": 2.0, "mu_c": 3.0, "mu_s": 4.0, "v_s": 5e-3}
TRIALS = [{"duration": 2.0, "force": "5*sin(2*pi*t)"}, {"duration": 2.0, "force": "8*sin(3*pi*t)"}]


def errors(noise):
    system = SYSTEMS["drive"](M=1.0)
    made = noise(simulate_recording(system, "lugre", TRUTH, TRIALS, 200.0), 0)
    mechanism = Mechanism(system, LAWS["lugre"]())
    bench = Bench(mechanism, (), (), made, made.select(()), loss="auto")
    fit = bench.base
    return compare(bench, [fit, fit], fit.levels(bench.problem.loss))[0]


@pytest.mark.parametrize("noise", [GaussianNoise(0.02), OutlierNoise(0.02, 0.02, 10.0)])
def test_a_model_that_lacks_nothing_has_the_error_of_the_noise_whether_or_not_there_are_outliers(noise):
    found = errors(noise)
    assert (found["v"].get("outliers_left_out", 0) > 0) == isinstance(noise, OutlierNoise)
    assert 0.9 < found["v"]["after"] / found["v"]["noise_floor"] < 1.12
    assert 0.8 < found[FORCE]["after"] / found[FORCE]["noise_floor"] < 1.2


def test_inputs_are_reported_as_the_model_needs_them_and_of_an_imposed_motion_only_the_force_is_a_force():
    found = errors(GaussianNoise(0.02))
    assert (
        found["force"]["quantity"] == "rms error of the force that the model needs" and "relative" not in found["force"]
    )
    system = SYSTEMS["damper"]()
    truth = {"mu_c": 3.0, "sigma_2": 20.0}
    trials = [{"duration": 2.0, "x": "0.02*sin(2*pi*t)"}, {"duration": 2.0, "x": "0.03*sin(3*pi*t)"}]
    made = GaussianNoise(0.02)(simulate_recording(system, "coulomb_viscous", truth, trials, 200.0), 0)
    mechanism = Mechanism(system, LAWS["coulomb_viscous"]())
    bench = Bench(mechanism, (), (), made, made.select(()))
    fit = bench.base
    found = compare(bench, [fit, fit], fit.levels(bench.problem.loss))[0]
    assert [name for name, e in found.items() if "relative" in e] == [next(iter(found))] and len(found) > 1
    force = next(iter(found.values()))
    assert 0.9 < force["before"] / force["noise_floor"] < 2.0  # the model's force, not an input of 0, is compared
    assert {name: e["unit"] for name, e in found.items()} == {n: system.signal_units[n] for n in found}


def test_only_residuals_that_stand_alone_are_outliers():
    r = np.zeros(40)
    r[[0, 20]], r[30:34] = 9.0, 9.0
    assert np.flatnonzero(lone(r, 1.0)).tolist() == [0, 20]
    assert not lone(r, 2.0).any()
