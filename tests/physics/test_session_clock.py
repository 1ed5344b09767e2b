"""Effects see the time of the session, which runs on through its trials."""

from __future__ import annotations

import numpy as np
import pytest

from frictionpinn.data.noise import GaussianNoise
from frictionpinn.data.simulated import simulate_recording
from frictionpinn.identify import maximum_likelihood
from frictionpinn.numerics.paths import InputPath
from frictionpinn.numerics.session import Session
from frictionpinn.numerics.simulate import Simulator
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.mechanism import Mechanism

T = np.arange(401) / 200
DRY = {"mu_c": 3.0, "sigma_2": 2.0}
PUSHES = [{"duration": 2.0, "force": f"{size}*sin({rate}*t)"} for size, rate in ((6, 7), (8, 9), (7, 6), (9, 8))]


def mechanism(*effects: str) -> Mechanism:
    return Mechanism(SYSTEMS["drive"](M=1.0), LAWS["coulomb_viscous"](), effects)


def simulated(effect: str, session: Session = Session(), **values: float):  # noqa: B008
    made = mechanism(effect)
    signals = {"force": 8 * np.sin(7 * T)}
    path = InputPath.from_signals(made, T, signals, session=session)
    return Simulator(made).simulate(T, path, DRY | values)


def test_drift_goes_on_where_the_trial_before_left_it():
    later = simulated("drift", Session(offset=10.0), drift=0.02)
    stronger = simulated("drift", drift=0.02 / 1.2, mu_c=DRY["mu_c"] * 1.2)
    np.testing.assert_allclose(later.v, stronger.v, atol=1e-9)
    assert np.abs(later.v - simulated("drift", drift=0.02).v).max() > 1e-2


def test_a_first_trial_from_zero_is_what_it_was():
    plain, first = simulated("drift", drift=0.02), simulated("drift", Session(0.0, 1), drift=0.02)
    np.testing.assert_array_equal(plain.v, first.v)


def test_a_vibration_keeps_to_the_time_of_the_trial():
    values = {"vibration_sin": 1.0, "vibration_frequency": 5.3}
    first, later = (simulated("vibration", Session(offset), **values) for offset in (0.0, 10.03))
    np.testing.assert_array_equal(first.v, later.v)


def test_sensitivities_see_the_session():
    made = mechanism("drift")
    sim, path = Simulator(made), InputPath.from_signals(made, T, {"force": 8 * np.sin(7 * T)}, session=Session(50.0))
    found = sim.simulate(T, path, DRY | {"drift": 0.01}, sensitivities=["drift"])
    runs = [sim.simulate(T, path, DRY | {"drift": 0.01 + s * 1e-8}, steps=found.steps).v for s in (1, -1)]
    slope = found.sensitivities["v"][:, 0]
    assert np.abs(slope - (runs[0] - runs[1])[:, 0] / 2e-8).max() < 1e-4 * np.abs(slope).max()


@pytest.mark.parametrize("windows", [None, 1.0])
def test_friction_that_rises_through_a_session_with_pauses_is_identified(windows):
    trials = [{**push, "start": start} for push, start in zip(PUSHES, (0.0, 20.0, 45.0, 60.0), strict=True)]
    truth, made = DRY | {"drift": 0.004}, mechanism("drift")
    clean = simulate_recording(made.system, "coulomb_viscous", truth, trials, 200.0, ("drift",))
    noisy = GaussianNoise(0.02)(clean, 0).select(["1", "2", "4"])
    estimate = maximum_likelihood(made, noisy, free=tuple(truth), windows=windows)
    low, high = estimate.ci95["drift"]
    assert low <= 0.004 <= high and high - low < 1e-3, estimate
    assert estimate.values["mu_c"] == pytest.approx(DRY["mu_c"], rel=0.02)


# ---- levels of trials


def test_a_level_acts_in_its_trial_alone():
    plain, own = simulated("trial_level"), simulated("trial_level", Session(trial=3), trial_level_3=0.2)
    np.testing.assert_allclose(own.v, simulated("trial_level", mu_c=1.2 * DRY["mu_c"]).v, atol=1e-9)
    np.testing.assert_array_equal(simulated("trial_level", Session(trial=2), trial_level_3=0.2).v, plain.v)
    beyond = simulated("trial_level", Session(trial=11), **{f"trial_level_{k}": 0.2 for k in range(1, 11)})
    np.testing.assert_array_equal(beyond.v, plain.v)


def test_any_level_of_every_trial_but_one_is_identified():
    levels = {"trial_level_2": 0.15, "trial_level_3": -0.1, "trial_level_4": 0.02}
    truth, made = DRY | levels, mechanism("trial_level")
    clean = simulate_recording(made.system, "coulomb_viscous", truth, PUSHES, 200.0, ("trial_level",))
    estimate = maximum_likelihood(made, GaussianNoise(0.02)(clean, 0), free=tuple(truth))
    for name, value in levels.items():
        low, high = estimate.ci95[name]
        assert low <= value <= high and high - low < 0.02, estimate
