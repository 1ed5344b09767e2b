"""The error beyond the noise, its interval, and where the noise is known from."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from frictionpinn.diagnose.errors import main_signal
from frictionpinn.numerics.excess import NEIGHBOURS, RESIDUAL, Excess, Level, block_length, block_means, noise_level
from frictionpinn.physics import SYSTEMS

T = [np.arange(1000) * 0.01] * 2


def noisy(size: float, seed: int = 0, noise: float = 1.0) -> list[np.ndarray]:
    """Residuals of two trials: what a model lacks, a slow wave of that rms, in white noise."""
    rng = np.random.default_rng(seed)
    return [np.sqrt(2) * size * np.sin(2 * np.pi * 0.7 * t) + noise * rng.normal(size=len(t)) for t in T]


def test_an_error_below_the_noise_is_found_beyond_it_and_its_interval_holds_it():
    inside, drops = [], []
    for seed in range(40):
        found = Excess.of(T, (noisy(0.3, seed), noisy(0.0, seed)), Level(1.0, 0.71 / np.sqrt(2000), NEIGHBOURS))
        before, after = found.told(0), found.told(1)
        inside.append(before["ci95"][0] <= 0.3 <= before["ci95"][1])
        assert after["value"] < 0.25  # of the noise: a sixteenth of the squared error
        drops.append(found.drop_over_error)
    assert np.mean(inside) >= 0.85 and np.median(drops) > 2.5


def told(drop: float, least: float = 0.0):
    return {"drop_over_error": drop, "excess_before": {"ci95": [least, 1.0]}, "noise_floor": 0.5}


@pytest.mark.parametrize(
    ("errors", "first"),
    [
        ({"x": told(7.0), "v": told(2.0, 0.9)}, "x"),
        ({"x": told(0.0, 0.3), "v": told(-1.0, 0.1)}, "x"),
        ({"x": told(0.0), "v": told(0.0)}, "v"),
    ],
)
def test_the_signal_that_shows_the_improvement_best_is_quoted_first_else_what_is_left_else_the_velocity(errors, first):
    assert main_signal(SYSTEMS["drive"](M=1.0), errors) == first


def test_two_models_that_do_the_same_show_no_drop():
    assert Excess.of(T, (noisy(0.3), noisy(0.3)), Level(1.0, 0.02, NEIGHBOURS)).drop_over_error == 0.0


def test_blocks_are_long_against_the_correlation_of_the_residual_in_seconds_at_any_rate():
    rng = np.random.default_rng(0)
    for dt in (0.01, 0.002):
        a = np.exp(-dt / 0.05)  # exp(-3) = 0.05 is left after 0.15 s
        t = np.arange(round(100 / dt)) * dt
        r = lfilter([1.0], [1, -a], rng.normal(size=len(t)))
        assert block_length([t], [r]) == pytest.approx(3 * 0.15, rel=0.5)
    white = rng.normal(size=len(t))
    assert block_length([t], [white]) == pytest.approx(10 * 0.002, rel=0.3)


def test_longer_blocks_make_wider_intervals_of_correlated_residuals():
    rng = np.random.default_rng(1)
    y = [lfilter([1.0], [1, -0.98], rng.normal(size=5000))[:, None] ** 2]
    short, long = (np.std(block_means(y, [span])) for span in (1, 300))
    assert long > 3 * short


def test_shares_of_the_effects_and_what_is_left_make_the_whole():
    path = (noisy(0.8), noisy(0.5), noisy(0.2))
    found = Excess.of(T, path, Level(1.0, 0.01, NEIGHBOURS))
    first, second, left = (found.share(k) for k in (1, 2, 0))
    assert first["value"] + second["value"] + left["value"] == pytest.approx(1.0)
    assert first["value"] == pytest.approx((0.64 - 0.25) / 0.64, abs=0.1)
    for told in (first, second, left):
        assert told["ci95"][0] <= told["value"] <= told["ci95"][1]


def test_noise_is_told_from_neighbouring_samples_where_the_model_is_far_off_and_both_levels_are_said():
    rng = np.random.default_rng(0)
    t = T[0]
    y = np.sin(t) + 0.01 * rng.normal(size=len(t))
    far = noise_level([(t, y)], 0.2)
    assert far.source == NEIGHBOURS and far.sigma == pytest.approx(0.01, rel=0.1) and far.other == 0.2
    near = noise_level([(t, y)], 0.0102)
    assert near.source == NEIGHBOURS and near.other is None


def test_a_signal_that_moves_faster_than_it_is_sampled_gets_its_noise_from_the_residual_and_it_says_so():
    t = T[0][::20]
    y = np.sin(2 * np.pi * 2.3 * t) + 0.01 * np.random.default_rng(0).normal(size=len(t))
    found = noise_level([(t, y)], 0.01)
    assert (found.source, found.sigma) == (RESIDUAL, 0.01) and found.other > 0.1


def test_an_encoder_at_rest_for_long_still_has_the_noise_of_its_steps():
    t = T[0]
    y = np.round(np.sin(t) / 0.05) * 0.05
    assert noise_level([(t, y)], 0.05).sigma == pytest.approx(0.05 / np.sqrt(12))
