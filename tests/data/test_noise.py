"""Behaviour of the noise models."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from frictionpinn.data.noise import GaussianNoise, NoNoise, OutlierNoise, QuantisedNoise
from frictionpinn.data.recording import Recording, Trial
from frictionpinn.errors import UserError

MODELS = [NoNoise(), GaussianNoise(), QuantisedNoise(), OutlierNoise()]


def recording(n: int = 4000) -> Recording:
    t = np.linspace(0.0, 3.0, n)
    trials = []
    for k, name in enumerate("ABC"):
        x, v = (1 + k) * np.sin(5 * t), 20 + (1 + k) * np.cos(5 * t)
        trials.append(Trial(name, t, {"x": x, "v": v, "rest": np.full(n, 2.0)}, {"x": x}))
    return Recording(tuple(trials), {"x": "m", "v": "m/s", "rest": "N"})


def added(noise, rec: Recording, seed: int, name: str) -> np.ndarray:
    noisy = noise(rec, seed)
    return np.concatenate(
        [a.signals[name] - b.signals[name] for a, b in zip(noisy.trials, rec.trials, strict=True)],
    )


@pytest.mark.parametrize("noise", MODELS, ids=lambda m: type(m).__name__)
def test_time_truth_and_the_given_recording_are_left_alone(noise):
    rec, untouched = recording(), recording()
    noisy = noise(rec, 1)
    for new, old, same in zip(noisy.trials, rec.trials, untouched.trials, strict=True):
        assert np.array_equal(new.t, same.t) and np.array_equal(new.truth["x"], same.truth["x"])
        assert all(np.array_equal(old.signals[k], same.signals[k]) for k in same.signals)
    assert noisy.units == rec.units


@pytest.mark.parametrize("noise", MODELS, ids=lambda m: type(m).__name__)
def test_added_noise_has_the_announced_standard_deviation(noise):
    rec = recording()
    for name, level in noise.levels(rec).items():
        assert np.std(added(noise, rec, 3, name)) == pytest.approx(level, rel=0.1, abs=1e-15)


def test_level_is_relative_to_the_spread_over_all_trials():
    rec = recording()
    x = np.concatenate([trial.signals["x"] for trial in rec.trials])
    assert GaussianNoise(0.1).levels(rec)["x"] == pytest.approx(0.1 * np.std(x))
    assert GaussianNoise(0.1).levels(rec)["rest"] == 0


@given(seed=st.integers(0, 2**32))
@settings(max_examples=10, deadline=None)
def test_noise_of_a_signal_depends_on_seed_and_names_alone(seed):
    rec = recording(50)
    noise = GaussianNoise()
    first = noise(rec, seed)
    turned = tuple(replace(tr, signals=dict(reversed(tr.signals.items()))) for tr in reversed(rec.trials))
    second = noise(replace(rec, trials=turned), seed)
    for trial, same in zip(first.trials, reversed(second.trials), strict=True):
        assert trial.name == same.name
        assert all(np.allclose(trial.signals[k], same.signals[k], rtol=0, atol=1e-12) for k in trial.signals)


def test_streams_of_signals_trials_and_seeds_are_uncorrelated():
    rec, noise = recording(), GaussianNoise()
    n = len(rec.trials[0])
    x, v, other = added(noise, rec, 1, "x"), added(noise, rec, 1, "v"), added(noise, rec, 2, "x")
    rows = [x[:n], x[n : 2 * n], x[2 * n :], v[:n], other[:n]]
    assert np.abs(np.corrcoef(rows) - np.eye(5)).max() < 0.08


def test_quantised_signals_lie_on_the_steps():
    rec = recording()
    noise = QuantisedNoise(0.01, bits=6, step={"v": 0.25})
    steps = noise.steps(rec)
    assert steps["v"] == 0.25 and steps["x"] == pytest.approx(6 / 64, rel=1e-3)
    for trial in noise(rec, 1).trials:
        for name in ("x", "v"):
            assert np.allclose(trial.signals[name] / steps[name], np.round(trial.signals[name] / steps[name]))


def test_outliers_come_at_the_given_fraction():
    rec = recording()
    noise = OutlierNoise(0.05, fraction=0.1, scale=100.0)
    large = np.abs(added(noise, rec, 1, "x")) > 5 * GaussianNoise(0.05).levels(rec)["x"]
    assert np.mean(large) == pytest.approx(0.1, abs=0.015)


@pytest.mark.parametrize(
    "make",
    [
        lambda: GaussianNoise(-0.1),
        lambda: GaussianNoise(float("nan")),
        lambda: QuantisedNoise(bits=0),
        lambda: QuantisedNoise(step={"x": 0.0}),
        lambda: QuantisedNoise(step={"nowhere": 1.0})(recording(10), 0),
        lambda: OutlierNoise(fraction=1.5),
        lambda: OutlierNoise(scale=0.0),
        lambda: GaussianNoise()(recording(10), -1),
    ],
)
def test_mistakes_are_told_in_one_line(make):
    with pytest.raises(UserError) as caught:
        make()
    assert "\n" not in str(caught.value)
