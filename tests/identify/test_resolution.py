"""Residuals at a resolution in time, and what counts as noise."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from frictionpinn.numerics.jumps import beside_jumps
from frictionpinn.numerics.resolution import averaged, samples_within
from frictionpinn.numerics.whiteness import SIGNIFICANCE, whiteness


def plainly(rows, weight, half):
    """What ``averaged`` says it does, sample by sample."""
    means, result = np.zeros_like(rows), np.zeros_like(rows)
    there = np.zeros(rows.shape[:2])
    for i in range(rows.shape[0]):
        for k in range(rows.shape[1]):
            near = [j for j in range(max(0, k - half), min(rows.shape[1], k + half + 1)) if weight[i, j]]
            if near:
                means[i, k], there[i, k] = rows[i, near].mean(axis=0), 1.0
        for k in range(rows.shape[1]):
            near = [j for j in range(max(0, k - half), min(rows.shape[1], k + half + 1)) if there[i, j]]
            result[i, k] = means[i, near].mean(axis=0) if near else 0.0
    return np.sqrt(half) * result[:, ::half]


@settings(max_examples=40, deadline=None)
@given(st.integers(1, 9), st.integers(20, 60), st.integers(0, 2**31 - 1))
def test_rows_are_averaged_twice_over_what_was_measured(half, n, seed):
    rng = np.random.default_rng(seed)
    rows, weight = rng.standard_normal((2, n, 3)), (rng.random((2, n)) > 0.2).astype(float)
    np.testing.assert_allclose(averaged(rows, weight, half), plainly(rows, weight, half), atol=1e-12)


def test_what_varies_slowly_keeps_its_weight_and_noise_loses_it():
    t = np.arange(4000) / 1000.0
    slow, noise = np.sin(2 * np.pi * 0.5 * t), np.random.default_rng(0).standard_normal(len(t))
    for values, kept in ((slow, (0.97, 1.03)), (noise, (0.0, 0.05))):
        rows = averaged(np.ascontiguousarray(values[None, :, None]), np.ones((1, len(t))), 20)
        assert kept[0] < np.sum(rows**2) / np.sum(values**2) < kept[1]


def test_a_late_stop_costs_more_than_in_proportion_only_at_a_coarse_resolution():
    k = np.arange(400)
    late = np.array([np.where((k >= 200) & (k < 200 + d), 1.0, 0.0) for d in (4, 8)])[:, :, None]
    coarse = np.sum(averaged(late, np.ones((2, 400)), 20) ** 2, axis=(1, 2))
    assert np.sum(late**2, axis=(1, 2))[1] == 2 * np.sum(late**2, axis=(1, 2))[0]
    assert coarse[1] > 3.5 * coarse[0]  # as the square: a descent sees where to go


def test_a_resolution_is_a_time_not_a_number_of_samples():
    assert samples_within(np.arange(0, 2, 0.01), 0.05) == 5
    assert samples_within(np.arange(0, 2, 0.001), 0.05) == pytest.approx(50, abs=1)
    assert samples_within(np.arange(0, 2, 0.01), 0.0) == 0


def test_white_noise_is_noise_and_ringing_or_a_slow_remainder_is_not():
    rng, t = np.random.default_rng(1), np.arange(1500) / 500.0
    noise = [rng.standard_normal(len(t)) for _ in range(3)]
    assert whiteness({"v": noise}, 50) > SIGNIFICANCE
    for extra in (0.3 * np.sin(2 * np.pi * 120 * t), 0.2 * np.sin(2 * np.pi * 0.7 * t)):
        assert whiteness({"v": [r + extra for r in noise]}, 50) < SIGNIFICANCE


def test_samples_beside_a_jump_are_left_out_and_no_others():
    y = np.where(np.arange(100) < 40, 0.0, 3.0) + np.random.default_rng(0).normal(0, 0.1, 100)
    assert np.flatnonzero(beside_jumps(y, 0.1)).tolist() == [39, 40]
    assert not beside_jumps(np.sin(np.arange(100) / 10), 0.01).any()
