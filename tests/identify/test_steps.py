"""Steps of Levenberg and Marquardt's method: faint unknowns, bounds, and where the search ends."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from frictionpinn.numerics.descent import levenberg_marquardt
from frictionpinn.numerics.quadratic import Piece, State

FREE = np.full(3, -np.inf), np.full(3, np.inf)


def problem(matrix: np.ndarray, target: np.ndarray):
    """min |A u - y|^2 / 2 as one trial without unknowns of its own."""

    def evaluate(u, locals_, derivatives, **options):
        r = matrix @ u - target
        piece = Piece(0.5 * float(r @ r), {}, gg=matrix.T @ matrix, gl=np.zeros((3, 0)), grad_g=matrix.T @ r)
        return State(u, (np.zeros(0),), (piece,))

    return evaluate


def test_an_unknown_that_hardly_shows_does_not_hold_back_the_others():
    matrix = np.diag([30.0, 30.0, 1e-7])
    evaluate = problem(matrix, np.array([90.0, -60.0, 1.0]))  # the third would have to go to 1e7
    found = levenberg_marquardt(evaluate, evaluate(np.zeros(3), [np.zeros(0)], True), FREE)
    np.testing.assert_allclose(found.state.u[:2], [3.0, -2.0], atol=1e-3)
    assert found.reason == "converged" and abs(found.state.u[2]) < 60


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 10**6))
def test_the_search_ends_at_the_minimum_within_the_bounds(seed):
    from scipy.optimize import lsq_linear

    rng = np.random.default_rng(seed)
    matrix, target = rng.standard_normal((8, 3)) * 10.0 ** rng.uniform(-2, 1, 3), 5 * rng.standard_normal(8)
    low, high = -rng.uniform(0.01, 2, 3), rng.uniform(0.01, 2, 3)
    evaluate = problem(matrix, target)
    found = levenberg_marquardt(evaluate, evaluate(np.zeros(3), [np.zeros(0)], True), (low, high))
    best = lsq_linear(matrix, target, (low, high)).cost
    assert np.all(found.state.u >= low) and np.all(found.state.u <= high)
    assert found.state.cost == pytest.approx(best, abs=0.02)


def test_unknowns_that_are_held_stay():
    evaluate = problem(30 * np.eye(3), 30 * np.ones(3))
    u = np.array([0.5, 0.0, 0.0])
    limits = np.array([0.5, -np.inf, 0.0]), np.array([0.5, np.inf, 0.0])
    found = levenberg_marquardt(evaluate, evaluate(u, [np.zeros(0)], True), limits)
    np.testing.assert_allclose(found.state.u, [0.5, 1.0, 0.0], atol=1e-2)
