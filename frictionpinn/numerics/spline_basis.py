"""Noisy signals as smooth paths: B-splines linear in their coefficients, with as many knots as the data ask for."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import BSpline
from scipy.linalg import cho_factor, cho_solve

from .gram import gram
from .paths import DEGREE, at_samples
from .polynomials import combined
from .smoothing import Coordinate, Smoothed, SmoothingSpline, difference_sigma

LANES = DEGREE + 1  # B-splines that act between two knots
COARSEST, FINEST = 8, 2  # knot intervals of the coarsest spline tried; samples per interval of the finest
GROWTH = 1.4  # of the number of intervals from one spline tried to the next
FINER = 1.5  # the criterion's best spline still bends the response by a fraction of its standard error: take a finer
CLEAN = 0.3  # of the noise that is said to be there: signals with less were simulated without it
MISFIT = 1.7  # typical residual, over the noise's, of a spline that does not follow the signal at all
SPACINGS = (3, 6, 12, 24, 48)  # samples per knot tried for the free coordinates, which friction makes jump
PATIENCE = 3  # finer splines that may fail to lower the criterion before the search ends


@dataclass(frozen=True)
class PathBasis:
    """Degree-5 B-spline basis of one input over one trial, knots at sample times.

    Attributes:
        t: times, s, shape (n,).
        breaks: indices of the samples that are knots, the ends included.
        orders: 3 for a motion (position, velocity, acceleration), 1 for a plain input.
    """

    t: np.ndarray
    breaks: tuple[int, ...]
    orders: int

    @classmethod
    def evenly(cls, t: np.ndarray, intervals: int, orders: int) -> PathBasis:
        """Basis with about ``intervals`` knot intervals of equal numbers of samples."""
        count = min(intervals, (len(t) - 1) // FINEST) or 1
        return cls(t, tuple(np.unique(np.linspace(0, len(t) - 1, count + 1).round().astype(int))), orders)

    @property
    def size(self) -> int:
        """Number of coefficients."""
        return len(self.breaks) + DEGREE - 1

    @cached_property
    def _spline(self) -> BSpline:
        inner = self.t[list(self.breaks[1:-1])]
        knots = np.concatenate([np.full(6, self.t[0]), inner, np.full(6, self.t[-1])])
        return BSpline(knots, np.eye(self.size), DEGREE)

    @cached_property
    def design(self) -> np.ndarray:
        """Value and derivatives at the samples, shape (orders, n, size)."""
        return np.ascontiguousarray(np.stack([self._spline.derivative(m)(self.t) for m in range(self.orders)]))

    @cached_property
    def pieces(self) -> np.ndarray:
        """Polynomials between two knots, about the first, of the B-splines that act there: those from as many on as
        knots lie before it, shape (intervals, orders, 6, LANES)."""
        begins, count = self.t[list(self.breaks[:-1])], len(self.breaks) - 1
        acting = np.arange(count)[:, None] + np.arange(LANES)
        powers = [np.take_along_axis(self._spline.derivative(m)(begins), acting, 1) for m in range(DEGREE + 1)]
        result = np.zeros((count, self.orders, DEGREE + 1, LANES))
        for k in range(self.orders):
            for m in range(DEGREE + 1 - k):
                result[:, k, m] = powers[m + k] / math.factorial(m)
        return result

    @property
    def support(self) -> np.ndarray:
        """First and last interval between samples in which each B-spline acts, shape (size, 2)."""
        first, last = np.array(self.breaks[:-1]), np.array(self.breaks[1:]) - 1
        j = np.arange(self.size)
        return np.stack([first[np.maximum(j - DEGREE, 0)], last[np.minimum(j, len(last) - 1)]], axis=1)

    def path(self, coefficients: np.ndarray) -> np.ndarray:
        """Polynomial coefficients between the samples of the spline with these, shape (n - 1, orders, 6)."""
        return combined(coefficients, self.pieces, self.t, np.array(self.breaks, np.int64))

    def values(self, coefficients: np.ndarray) -> np.ndarray:
        """Value and derivatives at the samples of the spline with these, shape (orders, n)."""
        return at_samples(self.path(coefficients), self.t).T

    def fit(self, y: np.ndarray, sigmas: np.ndarray, beside: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Weighted least squares on y, shape (orders, n), NaN where missing; sigmas, shape (orders,).

        Args:
            beside: columns that explain some of y beside the spline, shape (orders, n, k).

        Returns:
            coefficients, shape (size + k,), and the residuals, shape (orders, n).
        """
        weight = np.where(np.isnan(y), 0.0, 1 / sigmas[:, None])
        design = self.design if beside is None else np.dstack([self.design, beside])
        rows = design.reshape(-1, design.shape[2])
        matrix, right = gram(rows, np.nan_to_num(y).reshape(-1), (weight**2).reshape(-1))
        matrix[np.diag_indices_from(matrix)] *= 1 + 1e-12
        coefficients = cho_solve(cho_factor(matrix), right)
        return coefficients, y - design @ coefficients


@dataclass(frozen=True)
class NoisyInput:
    """A measured input whose path is a spline: columns of u, measured signals, fitted coefficients.

    Attributes:
        names: its signals.
        columns: their places in u.
        basis: the spline's basis.
        y: measured signals, shape (len(names), n), NaN where missing.
        coefficients: least-squares fit to them alone, shape (basis.size,).
    """

    names: tuple[str, ...]
    columns: tuple[int, ...]
    basis: PathBasis
    y: np.ndarray
    coefficients: np.ndarray


def choose_basis(t: np.ndarray, y: np.ndarray, sigmas: np.ndarray, most: int) -> PathBasis | None:
    """Return the basis of least Bayesian information criterion sum_k n_k log(RSS_k / n_k) + p log(sum_k n_k).

    The sensor of a velocity or acceleration may have an offset against the position's, and a wrong factor.
    Intervals grow by 40 % from the coarsest; the search ends where three finer ones brought nothing, or with ``most``
    coefficients. The basis returned is a little finer than the best.

    Args:
        t: times, s, shape (n,).
        y: signals, shape (orders, n), NaN where missing.
        sigmas: their noise standard deviations, shape (orders,).
        most: largest number of coefficients; None is returned where so many do not follow the signal. A spline that
            misses less than the noise is better than the samples, whose noise would be taken for the input.
    """
    counts, offsets = np.sum(~np.isnan(y), axis=1), _offsets(y)
    measured = counts > 0
    own = [difference_sigma([(t, row)]) if np.any(~np.isnan(row)) else np.inf for row in y]
    expected = np.where(np.array(own) < CLEAN * sigmas, sigmas**2, 0.0)[measured]  # of signals without their noise
    best, least, worse, intervals = None, np.inf, 0, max(2, min(COARSEST, len(t) // 8)) / 2
    last = min(most - DEGREE, (len(t) - 1) / FINEST)
    while worse < PATIENCE and last >= 1:
        basis = PathBasis.evenly(t, round(min(intervals, last)), len(y))
        residuals = basis.fit(y, sigmas, offsets)[1][measured]
        squares = np.nansum(residuals**2, axis=1)
        variance = np.maximum(squares / counts[measured] + expected, (1e-3 * sigmas[measured]) ** 2)
        value = float(np.sum(counts[measured] * np.log(variance)) + basis.size * np.log(counts.sum()))
        typical = _typical(residuals, y[measured] - residuals)
        misfit = bool(np.any(typical > MISFIT * sigmas[measured]))  # too coarse to judge by
        best, least, worse = (basis, value, 0) if value < least or misfit else (best, least, worse + 1)
        if intervals >= last:
            if misfit and last < (len(t) - 1) / FINEST:
                return None
            break
        intervals *= GROWTH
    if best is None:
        return None
    return PathBasis.evenly(t, round(min(FINER * (len(best.breaks) - 1), most - DEGREE)), len(y))


def _typical(residuals: np.ndarray, fitted: np.ndarray) -> np.ndarray:
    """Typical residual of each signal, outliers and a wrong factor of its sensor aside, shape (orders,)."""
    around = np.where(np.isnan(residuals), np.nan, fitted)
    around -= np.nanmean(around, axis=1, keepdims=True)
    squares = np.maximum(np.nansum(around**2, axis=1), np.finfo(float).tiny)
    factors = np.nansum(residuals * around, axis=1) / squares
    return 1.4826 * np.nanmedian(np.abs(residuals - factors[:, None] * around), axis=1)


def _offsets(y: np.ndarray) -> np.ndarray:
    """What an offset of the sensor of each derivative changes, shape (orders, n, columns): of those with a lower
    derivative measured at half as many samples at least, which tells it."""
    columns, counts = [], np.sum(~np.isnan(y), axis=1)
    for k in range(1, len(y)):
        if counts[k] and 2 * counts[:k].max() >= counts[k]:
            columns.append(np.zeros_like(y))
            columns[-1][k] = 1.0
    return np.stack(columns, axis=2) if columns else np.zeros((*y.shape, 0))


def smooth_together(data: Sequence[Coordinate], sigmas: Sequence[float | None]) -> list[Smoothed]:
    """One coordinate of every trial through the smoothing spline of least Bayesian information criterion over all.

    Args:
        data: times, s, position, velocity and acceleration, each of shape (n,) or None where not measured.
        sigmas: their noise standard deviations, None where unknown.
    """
    best: list[Smoothed] = []
    least = np.inf
    spacings = [spacing for spacing in SPACINGS if spacing <= min(len(trial[0]) for trial in data) // 3]
    for spacing in spacings or [2]:
        smoother = SmoothingSpline(spacing=spacing).fit(data, sigmas)
        fits = [smoother(*trial) for trial in data]
        value, samples = 0.0, 0
        for k in range(3):
            rows = [(t[k + 1] - fit[k]) ** 2 for t, fit in zip(data, fits, strict=True) if t[k + 1] is not None]
            if rows:
                joined = np.concatenate(rows)
                value += np.sum(~np.isnan(joined)) * np.log(np.nanmean(joined) + 1e-300)
                samples += len(joined)
        value += sum(len(trial[0]) // spacing + 5 for trial in data) * np.log(samples)
        if not best or value < least:
            best, least = fits, value
    return best
