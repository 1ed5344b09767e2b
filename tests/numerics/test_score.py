"""The score test: what a column would explain beside others, and how the noise's colour counts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import toeplitz
from scipy.signal import lfilter

from frictionpinn.numerics import score
from frictionpinn.numerics.coloured import Noise, fit_noise, outliers
from frictionpinn.numerics.score import Columns, Normal, Rows, basis, beside, log_p, project

WHITE = Noise()


def rows(seed: int, n: int = 60, parameters: int = 4, local: int = 2, signals: int = 2) -> Rows:
    rng = np.random.default_rng(seed)
    names = tuple("xv"[:signals])
    return Rows(
        names,
        rng.normal(size=(signals, n)),
        rng.normal(size=(signals, n, parameters)),
        rng.normal(size=(signals, n, local)),
        np.ones((signals, n)),
    )


def scored(trials: Sequence[Rows], known: Sequence[int], tested: Sequence[int]):
    """Score test of some columns beside others."""

    def columns(at: Sequence[int]) -> list[Columns]:
        return [Columns.of(replace(trial, change=trial.change[:, :, list(at)]), WHITE) for trial in trials]

    lengths = sum((c.matrix**2).sum(axis=0) for c in columns(tested))
    return Normal.of(tested, beside(columns(known), columns(tested))[0]).test(lengths)


def test_groups_of_columns_are_summed_as_each_alone():
    trials = [rows(3, parameters=6), rows(4, parameters=6)]
    whole = [Columns.of(trial, WHITE) for trial in trials]
    groups = Normal.each(["ab", "cd", "ef"], whole)
    for k, group in enumerate(groups):
        alone = Normal.of(group.names, [Columns.of(replace(t, change=t.change[:, :, 2 * k : 2 * k + 2]), WHITE)
                                        for t in trials])  # fmt: skip
        np.testing.assert_allclose(group.A, alone.A)
        np.testing.assert_allclose(group.b, alone.b)


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 10_000))
def test_statistic_is_the_drop_of_the_sum_of_squares(seed):
    trials = [rows(seed), rows(seed + 1)]
    found = scored(trials, [0, 1], [2, 3])

    def least(names: str) -> float:
        blocks, r = [], []
        for k, trial in enumerate(trials):
            size = trial.r.size
            own = np.zeros((size, 4))
            own[:, 2 * k : 2 * k + 2] = trial.local.reshape(size, -1)
            wanted = trial.change.reshape(size, -1)[:, ["abcd".index(n) for n in names]]
            blocks.append(np.column_stack([wanted, own]))
            r.append(trial.r.reshape(-1))
        A, y = np.concatenate(blocks), np.concatenate(r)
        return float(np.sum((y - A @ np.linalg.lstsq(A, y, rcond=None)[0]) ** 2))

    assert found.statistic == pytest.approx(least("ab") - least("abcd"), rel=1e-6)
    assert found.freedom == 2 and found.step.shape == (2,)


def test_a_column_that_others_span_tells_nothing():
    trial = rows(1)
    change = trial.change.copy()
    change[:, :, 3] = 2 * change[:, :, 0] - change[:, :, 1]
    found = scored([replace(trial, change=change)], [0, 1], [3])
    assert (found.statistic, found.freedom) == (0.0, 0)


def test_numbers_that_are_too_far_apart_make_no_error_and_are_told(monkeypatch):
    def fails(A):
        raise np.linalg.LinAlgError("Eigenvalues did not converge")

    monkeypatch.setattr(score, "inverse_root", fails)
    found = Normal(("a", "b"), np.eye(2), np.ones(2), 1.0, np.eye(2)).test(np.ones(2))
    assert found.overflow and found.statistic == 0.0 and not found.step.any()


def test_spread_is_that_of_the_noise_colour():
    a = np.array([0.6, -0.2])
    innovation = 1.0
    impulse = lfilter([1.0], [1, *-a], np.eye(1, 4000)[0])
    gamma = np.array([np.sum(impulse[: 4000 - k] * impulse[k:]) for k in range(50)])
    noise = Noise({"x": a}, {"x": innovation}, {"x": float(np.sqrt(gamma[0]))})
    rng = np.random.default_rng(0)
    C = np.zeros((1, 50, 3))
    C[0, 15:35] = rng.normal(size=(20, 3))  # away from the ends
    W = noise.spread(("x",), C)[0]
    R = toeplitz(gamma / gamma[0])
    full = lfilter([1.0], [1, *-a], np.concatenate([np.zeros((200, 3)), C[0]])[::-1], axis=0)[::-1] / np.sqrt(gamma[0])
    assert full.T @ full == pytest.approx(C[0].T @ R @ C[0], rel=1e-3)
    assert pytest.approx(full[200:], rel=1e-9) == W


def test_coloured_noise_gives_no_larger_statistics_than_white():
    rng = np.random.default_rng(3)
    n, draws = 400, 300
    smooth = np.cumsum(rng.normal(size=(1, n, 1)), axis=1)
    found = []
    for _ in range(draws):
        e = lfilter([1.0], [1, -0.8], rng.normal(size=n + 100))[100:]
        row = Rows(("x",), e[None] * 0.6, smooth, np.zeros((1, n, 0)), np.ones((1, n)))
        noise = fit_noise([{"x": row.r[0]}], 1.0)
        normal = Normal.of("a", [Columns.of(row, noise)])
        found.append(normal.test(normal.A.diagonal()).statistic)
    assert np.mean(np.array(found) > 6.63) < 0.04  # 1 % of chi-squared, where white noise is assumed about 40 %


def test_white_noise_is_left_white_and_colour_is_found():
    rng = np.random.default_rng(0)
    white = dict(zip("xv", rng.normal(size=(2, 3000)), strict=True))
    assert fit_noise([white], 1.0).coloured == ()
    e = lfilter([1.0], [1, -0.7], rng.normal(size=3000))
    noise = fit_noise([white | {"v": e}], 1.0)
    assert noise.coloured == ("v",)
    assert noise.coefficients["v"][0] == pytest.approx(0.7, abs=0.06)
    assert noise.level["v"] == pytest.approx(np.std(e), rel=0.05)


def test_lone_outliers_are_seen_and_a_missing_effect_is_none():
    rng = np.random.default_rng(0)
    clean = rng.normal(size=2000)
    spiked = clean.copy()
    spiked[rng.choice(2000, 20, replace=False)] += 12
    slow = clean + 8 * (np.abs(np.arange(2000) - 1000) < 100)
    assert outliers({"1": {"x": clean}}) == 0.0
    assert outliers({"1": {"x": spiked}}) > 0.005
    assert outliers({"1": {"x": slow}}) < 0.002


@given(st.floats(1.0, 1e6), st.integers(1, 8))
def test_log_p_falls_with_the_statistic_beyond_the_range_of_numbers(statistic, freedom):
    value, next_value = log_p(statistic, freedom), log_p(2 * statistic, freedom)
    assert np.isfinite(value) and next_value <= value <= 0


def test_basis_leaves_out_dependent_columns():
    A = np.random.default_rng(0).normal(size=(30, 3))
    own = basis(np.column_stack([A, A[:, 0] + A[:, 1], np.zeros(30)]))
    assert own.shape == (30, 3)
    assert project(own, A) == pytest.approx(np.zeros((30, 3)), abs=1e-10)
