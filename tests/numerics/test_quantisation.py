"""The noise level of signals recorded in steps, and of signals that only look like it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from frictionpinn.numerics.quantisation import quantisation_step
from frictionpinn.numerics.smoothing import difference_sigma

T = np.arange(2000) / 400
many = settings(max_examples=60, deadline=None, derandomize=True)


def differences(y: np.ndarray) -> float:
    """The estimate by differences alone, at uniform sampling."""
    weights = np.array([1, -4, 6, -4, 1]) / 70**0.5
    return 1.4826 * float(np.median(np.abs(np.convolve(y, weights, "valid"))))


@given(
    step=st.floats(1e-6, 1e3), levels=st.floats(3, 200), rate=st.floats(0.2, 2), noise=st.floats(0, 0.3),
    offset=st.floats(-100, 100), seed=st.integers(0, 99),
)  # fmt: skip
@many
def test_coarse_steps_count_as_noise_of_rounding(step, levels, rate, noise, offset, seed):
    smooth = levels * np.sin(2 * np.pi * rate * T + seed) + 0.3 * levels * np.sin(2 * np.pi * 0.37 * rate * T)
    smooth += offset + noise * np.random.default_rng(seed).standard_normal(len(T))
    found = difference_sigma([(T, step * np.round(smooth))])
    assert 0.9 / 12**0.5 * step < found < (noise + 0.75) * step


@pytest.mark.parametrize("decimals", [9, 4])
def test_a_velocity_in_steps_of_0_063_is_no_exact_one(decimals):
    v = np.round(0.02 * np.pi * np.round(0.3 * np.sin(9 * T) / (0.02 * np.pi)), decimals)
    assert quantisation_step([v]) == pytest.approx(0.0628, rel=1e-2)
    assert difference_sigma([(T, v)]) == pytest.approx(0.0628 / 12**0.5, rel=1e-2)


def test_a_position_that_mostly_rests_and_then_runs_over_many_steps_is_quantised():
    phase = np.clip(T % 2.5, 0, 0.5) / 0.5
    x = 1e-3 * np.round(1e3 * (np.floor(T / 2.5) + phase**3 * (10 - 15 * phase + 6 * phase**2)))
    assert np.mean(np.diff(x) == 0) > 0.5
    assert difference_sigma([(T, x)]) == pytest.approx(1e-3 / 12**0.5)


@given(sigma=st.floats(1e-6, 1e3), size=st.floats(0, 1e3), count=st.integers(5, 2000), seed=st.integers(0, 99))
@many
def test_the_level_of_gaussian_noise_is_what_differences_say(sigma, size, count, seed):
    y = size * np.sin(3 * T[:count]) + sigma * np.random.default_rng(seed).standard_normal(count)
    rms = float(np.sqrt(np.mean(y**2)))
    assert difference_sigma([(T[:count], y)]) == pytest.approx(max(differences(y), 1e-6 * rms), rel=1e-9)


EXACT = {
    "square waves of several sizes": lambda k: (3.0 + 1.5 * k) * np.sign(np.sin(2 * np.pi * 4 * T + 0.1)),
    "a force switched on and off": lambda k: 5.0 * (np.sin(9 * T) > 0.3),
    "ramps between rests": lambda k: np.round(2e3 * np.clip(np.abs((T % 2) - 1) - 0.25, 0, 0.5)) / 2e3 * (k + 1),
    "a smooth motion": lambda k: np.sin((3 + k) * T),
    "a smooth motion between rests": lambda k: np.maximum(np.sin((3 + k) * T), 0.0),
    "a slow signal held for four samples": lambda k: np.repeat(np.sin((3 + k) * T[::4]), 4),
    "rest": lambda k: np.zeros(len(T)),
}


@pytest.mark.parametrize("name", EXACT)
def test_exact_signals_are_not_taken_for_quantised_ones(name):
    assert quantisation_step([EXACT[name](k) for k in range(5)]) == 0.0


@given(bits=st.integers(4, 14), seed=st.integers(0, 9))
@many
def test_noise_above_the_step_is_left_as_it_is(bits, seed):
    step = 2.0 / 2**bits
    y = step * np.round((np.sin(9 * T) + 2 * step * np.random.default_rng(seed).standard_normal(len(T))) / step)
    assert difference_sigma([(T, y)]) == pytest.approx(differences(y), rel=1e-9)
