"""Simulated recordings: what the configuration writes is what is simulated."""

from __future__ import annotations

import numpy as np
import pytest

from frictionpinn.data.simulated import check_truth, simulate_recording
from frictionpinn.errors import UserError
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.mechanism import Mechanism

TRUTH = {"sigma_0": 1e5, "sigma_1": 316.23, "sigma_2": 0.4, "mu_c": 0.3, "mu_s": 0.6, "v_s": 1e-3}
SWING = {"duration": 0.5, "theta": "50*deg*sin(w*t)", "constants": {"w": 6.0}}


def simulate(*trials, system="pob", truth=TRUTH, friction="lugre", rate=200.0):
    return simulate_recording(SYSTEMS[system](), friction, truth, trials or (SWING,), rate)


def test_a_prescribed_swing_is_the_written_function_of_time():
    (trial,) = simulate().trials
    np.testing.assert_allclose(trial.t, np.arange(100) / 200)
    np.testing.assert_allclose(trial.signals["theta"], np.deg2rad(50) * np.sin(6 * trial.t), atol=1e-12)
    np.testing.assert_allclose(trial.signals["omega"], 6 * np.deg2rad(50) * np.cos(6 * trial.t), atol=1e-9)


def test_units_names_and_source_are_given():
    recording = simulate(SWING, {**SWING, "name": "second"})
    assert recording.names == ["1", "second"] and "pob" in recording.source
    assert recording.units["v"] == "m/s" and set(recording.units) == set(recording.trials[0].signals)
    assert set(recording.trials[0].truth) == {"friction_force", "normal_force", "v_slip", "z", "z_rate"}


def test_the_checksum_tells_recordings_apart_and_is_repeatable():
    assert simulate().checksum == simulate().checksum
    assert simulate().checksum != simulate(truth={**TRUTH, "mu_c": 0.31}).checksum


def test_the_true_force_obeys_the_law():
    (trial,) = simulate().trials
    v, z, rate = (trial.truth[name] for name in ("v_slip", "z", "z_rate"))
    force = TRUTH["sigma_0"] * z + TRUTH["sigma_1"] * rate + TRUTH["sigma_2"] * v
    np.testing.assert_allclose(trial.truth["friction_force"], force, atol=1e-6 * np.abs(force).max())


def test_a_test_bench_measures_the_friction_force():
    truth = {**TRUTH, "mu_c": 100.0, "mu_s": 130.0}
    (trial,) = simulate({"duration": 0.5, "x": "0.01*sin(6*t)"}, system="damper", truth=truth).trials
    np.testing.assert_array_equal(trial.signals["force"], trial.truth["friction_force"])


def test_a_test_bench_measures_what_acts_beside_the_law_too_as_its_sensor_shows_it():
    bench, law = SYSTEMS["damper"](), {"mu_c": 100.0, "sigma_2": 200.0}
    trials = [{"duration": 0.5, "x": "0.01*sin(6*t)"}]
    acting = law | {"constant_force": 8.0, "delay_force": 0.04}  # four samples
    (plain,) = simulate_recording(bench, "coulomb_viscous", law, trials, 100.0).trials
    (made,) = simulate_recording(bench, "coulomb_viscous", acting, trials, 100.0, ["constant_force", "delay"]).trials
    np.testing.assert_allclose(made.signals["force"][:-4], plain.signals["force"][4:] + 8.0, rtol=1e-6)


def test_a_free_motion_starts_where_it_is_told_to():
    truth = {"sigma_0": 50.0, "sigma_1": 0.5, "sigma_2": 0.01, "mu_c": 0.05, "mu_s": 0.08, "v_s": 0.02}
    (trial,) = simulate({"duration": 0.5, "initial": {"theta": 1.6}}, system="pendulum", truth=truth).trials
    assert trial.signals["theta"][0] == pytest.approx(1.6)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"rate": 0.0}, "impossible sampling rate: data.rate_hz is 0.0"),
        ({"friction": "lugr"}, "data.friction is 'lugr'.*did you mean 'lugre'"),
        ({"truth": {**TRUTH, "mu_k": 0.1}}, "data.truth.mu_k is 0.1; allowed: .*mu_c"),
        ({"truth": {key: value for key, value in TRUTH.items() if key != "v_s"}}, "data.truth.v_s"),
        ({"truth": {**TRUTH, "sigma_0": -1.0}}, "data.truth.sigma_0 is -1.0"),
        ({"truth": {**TRUTH, "mu_s": 0.2}}, "static below Coulomb friction: data.truth.mu_s is 0.2"),
    ],
)
def test_impossible_settings_are_named(change, message):
    with pytest.raises(UserError, match=message):
        simulate(**change)


@pytest.mark.parametrize(
    ("trial", "message"),
    [
        ({"theta": "sin(t)"}, "duration"),
        ({"duration": 0.5}, "theta"),
        ({"duration": 0.5, "thetta": "t", "theta": "t"}, "thetta is 't'; .*did you mean 'theta'"),
        ({"duration": 0.5, "theta": "sin(w*t)"}, "w"),
        ({"duration": 0.5, "theta": "__import__('os').getcwd()"}, "theta"),
        ({"duration": 0.5, "theta": "sqrt(-1 - t)"}, "not a finite number"),
        ({"duration": -1.0, "theta": "t"}, r"data.trials\[0\].duration is -1.0 s; allowed: at least 0.05 s"),
        ({"duration": "long", "theta": "t"}, r"data.trials\[0\].duration is 'long'"),
        ({"duration": "2", "theta": "t"}, r"not a number: data.trials\[0\].duration is '2'; allowed: seconds"),
        ({"duration": float("nan"), "theta": "t"}, r"data.trials\[0\].duration is nan"),
        ({"duration": 0.5, "theta": "80*deg*sin(15*t)"}, "contact"),
    ],
)
def test_impossible_trials_are_named(trial, message):
    with pytest.raises(UserError, match=message) as caught:
        simulate(trial)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", LAWS)
def test_every_law_accepts_its_own_parameters(name):
    typical = {"sigma_0": 1e4, "sigma_1": 100.0, "sigma_2": 0.4, "mu_c": 0.3, "mu_s": 0.5, "v_s": 0.01, "v_t": 0.01}
    law = LAWS[name]()
    mechanism = Mechanism(SYSTEMS["pob"](), law)
    check_truth(mechanism, {par.name: typical.get(par.name, par.value) for par in law.parameters})


def test_the_friction_of_an_imposed_motion_is_told_without_the_inertia_that_its_force_holds():
    drive, truth = SYSTEMS["drive"](imposed=True, M=2.0), {"mu_c": 3.0, "sigma_2": 4.0}
    recording = simulate_recording(drive, "coulomb_viscous", truth, [{"duration": 1.0, "x": "0.05*sin(6*t)"}], 200.0)
    (trial,) = recording.trials
    v, force = trial.signals["v"], trial.truth["friction_force"]
    slides = np.abs(v) > 1e-3
    np.testing.assert_allclose(force[slides], (3.0 * np.sign(v) + 4.0 * v)[slides], atol=1e-6)
    np.testing.assert_allclose(trial.signals["force"] - force, 2.0 * trial.signals["a"], atol=1e-9)
