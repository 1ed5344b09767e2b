"""Windows of the past: causal, exact on polynomials, the same whether sampled uniformly or not."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from frictionpinn.models.features import Features, local_polynomial

N = 80
GRID = {
    "uniform": np.arange(N) / 400,
    "jittered": (np.arange(N) + np.random.default_rng(0).uniform(-0.3, 0.3, N)) / 400,
    "mixed": np.cumsum(np.where(np.arange(N) < 40, 1 / 400, 1 / 250)),
}


@pytest.mark.parametrize("grid", GRID)
@settings(max_examples=20, deadline=None)
@given(k=st.integers(1, N - 1), window=st.integers(1, 20), degree=st.integers(0, 3), seed=st.integers(0, 9))
def test_what_comes_later_changes_nothing(grid, k, window, degree, seed):
    t, degree = GRID[grid], min(degree, window - 1)
    values = np.random.default_rng(seed).normal(size=N)
    changed = np.concatenate([values[:k], values[k:] + 100.0])
    before, after = (local_polynomial(t, item, window, degree) for item in (values, changed))
    np.testing.assert_array_equal(before[:k], after[:k])
    assert before.shape == (N, degree + 1)


@pytest.mark.parametrize("grid", GRID)
@pytest.mark.parametrize(("window", "degree"), [(1, 0), (2, 1), (6, 1), (12, 2), (20, 3), (48, 4)])
def test_polynomials_are_reproduced(grid, window, degree):
    t = GRID[grid]
    span = window * float(np.median(np.diff(t)))
    polynomial = np.polynomial.Polynomial([0.3, -2.0, 40.0, 300.0, -2000.0][: degree + 1])
    found = local_polynomial(t, polynomial(t), window, degree)
    factorial = np.cumprod([1, *range(1, degree + 1)])
    derivatives = [polynomial.deriv(j)(t) if j else polynomial(t) for j in range(degree + 1)]
    expected = np.stack([d * span**j / factorial[j] for j, d in enumerate(derivatives)], axis=1)
    np.testing.assert_allclose(found[window - 1 :], expected[window - 1 :], rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize(("window", "degree"), [(6, 1), (12, 2), (24, 3)])
def test_uniform_and_nearly_uniform_sampling_agree(window, degree):
    t = GRID["uniform"]
    values = np.random.default_rng(1).normal(size=N)
    nearly = t + np.where(np.arange(N) % 2 == 1, 2e-4 / 400, 0.0)  # just too uneven for the fast path
    assert not np.allclose(np.diff(nearly), np.diff(nearly)[0], rtol=1e-4)
    fast, general = (local_polynomial(item, values, window, degree) for item in (t, nearly))
    np.testing.assert_allclose(fast, general, rtol=1e-2, atol=1e-2 * np.abs(fast).max())


@pytest.mark.parametrize("grid", GRID)
def test_a_constant_has_a_value_and_no_slope_from_the_first_sample_on(grid):
    found = local_polynomial(GRID[grid], np.full(N, 3.0), 12, 2)
    np.testing.assert_allclose(found, np.tile([3.0, 0.0, 0.0], (N, 1)), atol=1e-9)


def test_features_of_the_rates_are_the_rates_of_the_features():
    t = np.arange(400) / 400
    features = Features.from_config(["v_slip", "normal_force"], {"v_slip": [[1, 0], [6, 1], [12, 2]]})
    signals = {"v_slip": np.sin(5 * t), "normal_force": 10 + np.cos(4 * t)}
    rates = {"v_slip": 5 * np.cos(5 * t), "normal_force": -4 * np.sin(4 * t)}
    expected = np.gradient(features(t, signals), t, axis=0)
    np.testing.assert_allclose(features(t, rates)[20:-1], expected[20:-1], atol=2e-3)


def test_signs_say_what_mirroring_does_to_each_feature():
    windows = {"v_slip": [[1, 0], [6, 1]], "a_frictionless": [[3, 1]]}
    features = Features.from_config(["v_slip", "normal_force", "a_frictionless"], windows)
    t = GRID["uniform"]
    rng = np.random.default_rng(2)
    signals = {"v_slip": rng.normal(size=N), "normal_force": rng.normal(size=N), "a_frictionless": rng.normal(size=N)}
    turned = {name: values if name == "normal_force" else -values for name, values in signals.items()}
    np.testing.assert_allclose(features(t, turned), features(t, signals) * features.odd)
    assert features.length == 6 and features.odd.tolist() == [-1, -1, -1, 1, -1, -1]
