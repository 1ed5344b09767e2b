"""Landscapes that mislead: jumps within a sample, friction that a law has and the data have not, work within work."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from cases import case, deviations

from frictionpinn.data.noise import GaussianNoise
from frictionpinn.data.simulated import simulate_recording
from frictionpinn.identify import maximum_likelihood
from frictionpinn.numerics.loss import LOSSES, choose_loss
from frictionpinn.numerics.parallel import in_parallel


@pytest.mark.parametrize("seed", [0, 3])
def test_a_law_whose_force_jumps_within_a_sample_is_found(seed):
    mechanism, truth, clean, _, _ = case("drive", "stribeck", (0, 1, 2, 3, 4))
    estimate = maximum_likelihood(mechanism, GaussianNoise(0.05)(clean, seed))
    assert estimate.outcome == "converged"
    assert max(deviations(estimate, truth).values()) < 4
    assert estimate.std["mu_s"] / estimate.values["mu_s"] < 0.02


def test_outliers_are_expected_only_where_the_force_jumps():
    assert choose_loss("auto", case("drive", "stribeck")[0]).robust
    assert not choose_loss("auto", case("drive", "lugre")[0]).robust
    assert not choose_loss("gaussian", case("drive", "stribeck")[0]).robust


def test_friction_that_does_not_rise_towards_rest_is_told_in_words():
    mechanism, truth, *_ = case("drive", "lugre")
    flat = truth | {"mu_s": truth["mu_c"]}
    trials = [{"duration": 2.0, "force": "5*sin(2*pi*t)"}, {"duration": 2.0, "force": "8*sin(3*pi*t)"}]
    noisy = GaussianNoise(0.05)(simulate_recording(mechanism.system, "lugre", flat, trials, 200.0), 2)
    estimate = maximum_likelihood(mechanism, noisy)
    assert estimate.outcome in ("at a bound", "not identified")
    said = ("mu_s: at most", "mu_s does not show", "v_s does not show", "v_s is as large")
    assert any(text.startswith(said) for text in estimate.advice)
    low, high = estimate.ci95["mu_c"]
    assert abs(truth["mu_c"] - estimate.values["mu_c"]) < 0.75 * (high - low)  # three standard deviations


def test_work_within_work_keeps_its_order_and_ends():
    def outer(k: int) -> list[int]:
        return in_parallel(lambda j: 10 * k + j, [1.0] * 5)

    assert in_parallel(outer, [3.0, 1.0, 2.0]) == [[10 * k + j for j in range(5)] for k in range(3)]


def test_parallel_work_hands_on_its_error():
    def fail(k: int) -> int:
        if k == 2:
            raise ValueError("two")
        return k

    for _ in range(2):  # and leaves the workers usable
        with pytest.raises(ValueError, match="two"):
            in_parallel(fail, np.ones(4))
    assert in_parallel(lambda k: in_parallel(lambda j: j, [1, 1])[1], [1, 1, 1]) == [1, 1, 1]


@pytest.mark.parametrize("name", ["gaussian", "robust"])
def test_a_loss_tells_the_standard_deviation_of_gaussian_noise(name):
    r, loss = 0.3 * np.random.default_rng(0).standard_normal(20_000), LOSSES[name]
    assert loss.spread * loss.sigma(r, len(r)) == pytest.approx(0.3, rel=0.02)


def test_samples_that_were_not_measured_do_not_make_an_interval_narrower():
    """A robust loss knows from its residuals how much they tell; of a sample that is not there it knows nothing."""
    mechanism, _, _, noisy, _ = case("drive", "coulomb_viscous", (0, 1, 2, 3))
    first, *others = noisy.trials
    fewer = [replace(trial, signals={n: trial.signals[n] for n in ("force", "v")}) for trial in others]
    alone, with_them = (
        maximum_likelihood(mechanism, replace(noisy, trials=trials), thorough=False, profiles=False, loss="robust")
        for trials in ((first, *others), (first, *fewer))
    )
    assert with_them.std["mu_c"] > 0.98 * alone.std["mu_c"]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert with_them.to_dict()["rms_residuals"]["1"]["a"] is None
