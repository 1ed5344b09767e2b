"""Positions that act and were not measured: where the forces put them."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))
from wide_draw import draw

import frictionpinn as fp
from frictionpinn.data.contact import smooth_trials
from frictionpinn.data.recording import Recording
from frictionpinn.errors import UserError
from frictionpinn.identify import Problem, bound, maximum_likelihood
from frictionpinn.numerics.smoothing import SmoothingSpline
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.mechanism import Mechanism

PUSHED = "1.5 * sin(3 * t) + 0.8 * sin(7.3 * t)"


def rates_only(recording: Recording, gone: set[str]) -> Recording:
    """The recording without these signals."""
    trials = [replace(t, signals={n: x for n, x in t.signals.items() if n not in gone}) for t in recording.trials]
    return replace(recording, trials=tuple(trials))


def pendulum(starts: list[float], noise: float = 0.02, push: str = PUSHED) -> tuple[Mechanism, Recording]:
    """Trials of a pendulum that begin at these angles, and its mechanism."""
    model = fp.mechanism(fp.system("pendulum"), "coulomb_viscous")
    trials = [{"duration": 4, "tau": push, "initial": {"theta": start}} for start in starts]
    return model, fp.simulate(model, {"mu_c": 0.2, "sigma_2": 0.05}, trials, rate_hz=200, noise=noise)


def begins(model: Mechanism, recording: Recording, name: str) -> np.ndarray:
    """Where the problem's trials begin before any fit, a position by its name."""
    return np.array([trial.start[name] for trial in Problem(model, recording).trials])


def around(angles: np.ndarray) -> np.ndarray:
    """Differences of angles, the shorter way round."""
    return np.abs((angles + np.pi) % (2 * np.pi) - np.pi)


def test_a_pendulum_of_which_only_the_rate_was_measured_begins_where_its_forces_say() -> None:
    starts = [3.1, 2.2, 4.0, 1.0]
    model, recording = pendulum(starts)
    found = begins(model, rates_only(recording, {"theta", "alpha"}), "theta")
    assert around(found - starts).max() < 0.1


def test_a_pendulum_that_falls_from_upright_is_not_taken_for_one_that_hangs() -> None:
    model, recording = pendulum([0.1, -0.2, 3.0], push="0")
    found = begins(model, rates_only(recording, {"theta", "alpha"}), "theta")
    assert around(found - [0.1, -0.2, 3.0]).max() < 0.1


def test_a_pendulum_that_friction_holds_is_taken_to_hang() -> None:
    model, recording = pendulum([np.pi], noise=0.0, push="0.1 * sin(9 * t)")
    (found,) = begins(model, rates_only(recording, {"theta", "alpha"}), "theta")
    assert around(found - np.pi) < 0.1


def test_the_friction_of_a_pendulum_is_told_by_its_rate_alone_within_the_bound() -> None:
    model, recording = pendulum([3.1, 2.2, 4.0], noise=0.05)
    recording = rates_only(recording, {"theta", "alpha"})
    truth = {"mu_c": 0.2, "sigma_2": 0.05}
    fit, least = maximum_likelihood(model, recording), bound(model, recording, truth)
    assert fit.outcome == "converged"
    for name, value in truth.items():
        assert abs(fit.values[name] - value) < 4 * least.std[name]
        assert least.std[name] < 0.1 * value


def test_a_pole_on_a_cart_begins_where_its_forces_say() -> None:
    pole = fp.mechanism(fp.system("cartpole"), "coulomb_viscous")
    truth = {"rail": {"mu_c": 0.05, "sigma_2": 0.2}, "bearing": {"mu_c": 0.005, "sigma_2": 0.002}}
    trials = [{"duration": 3, "force": "8 * sin(5 * t)", "initial": {"theta": start}} for start in (3.1, 2.5)]
    recording = fp.simulate(pole, truth, trials, rate_hz=200, noise=0.01)
    found = begins(pole, rates_only(recording, {"x", "theta"}), "theta")
    assert around(found - [3.1, 2.5]).max() < 0.1
    assert not begins(pole, rates_only(recording, {"x", "theta"}), "x").any()  # where it is on the rail says nothing


@pytest.mark.parametrize("seed", [0, 2, 7, 13, 18, 22, 26, 32, 45, 55])
def test_drawn_pendulums_that_hardly_slide_in_some_trials_begin_in_the_right_half_of_the_turn(seed: int) -> None:
    case = draw(seed, effects=False)
    model = Mechanism(SYSTEMS["pendulum"](**case.parameters), LAWS[case.law]())
    trials = {trial.name: trial for trial in case.clean.trials}
    for window in Problem(model, rates_only(case.recording, {"theta", "alpha"})).trials:
        whole = trials[window.trial.partition("[")[0]]
        truth = whole.signals["theta"][np.searchsorted(whole.t, window.t[0])]
        assert around(window.start["theta"] - truth) < 0.5


def test_an_online_estimator_asks_for_the_angle_that_it_cannot_know() -> None:
    model, recording = pendulum([3.1, 2.2])
    with pytest.raises(UserError, match="where theta is was not measured"):
        fp.online(model, {"mu_c": 0.2, "sigma_2": 0.05}, rates_only(recording, {"theta"}))


def test_what_is_assumed_of_a_position_that_acts_is_said() -> None:
    _, recording = pendulum([3.1, 2.2])
    check = fp.check(rates_only(recording, {"theta"}), fp.system("pendulum"))
    assert check.ok, check.findings
    assert any("theta; where a trial begins" in line for line in check.assumptions)


def test_a_network_s_samples_have_the_angle_that_was_not_measured() -> None:
    _, recording = pendulum([3.1, 2.2, 4.0], noise=0.01)
    fewer = rates_only(recording, {"theta"})
    motion = smooth_trials(fewer, list(fewer.trials), fp.system("pendulum"), SmoothingSpline(spacing=4))
    for signals, trial in zip(motion, recording.trials, strict=True):
        assert around(signals["theta"] - trial.signals["theta"]).mean() < 0.1
