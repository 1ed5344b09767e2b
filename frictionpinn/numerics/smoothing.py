"""Smoothing of one coordinate's position, velocity and acceleration.

Every smoother is called as ``smoother(t, q, v, a, sigmas=None) -> (q, v, a, jerk)`` and fitted on the trials of one
coordinate by ``smoother.fit(trials, sigmas=None)``, which returns a smoother with its free parameters fixed. ``q``,
``v`` and ``a`` have shape (n,) and SI units, any two of them may be None; ``sigmas`` holds their noise standard
deviations in the same order, None where unknown. A smoother with ``causal = True`` never looks ahead.

What is not measured is derived: a lower derivative's time integral starts from 0, a higher one is a time derivative.
The Kalman smoother and filter stand in :mod:`frictionpinn.numerics.kalman`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from scipy import sparse
from scipy.integrate import cumulative_trapezoid
from scipy.interpolate import BSpline
from scipy.linalg import solveh_banded

from frictionpinn.errors import UserError

from .quantisation import quantisation_step

Signal = np.ndarray | None
Coordinate = tuple[np.ndarray, Signal, Signal, Signal]  # t, q, v, a
Smoothed = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]  # q, v, a, jerk
Sigmas = Sequence[float | None]

SIGNALS = ("position", "velocity", "acceleration")
SIGMA_FLOOR = 1e-6  # of a signal's root mean square: keeps noise-free data's weights finite


class Smoother(Protocol):
    """Common call of the smoothers."""

    causal: bool

    def fit(self, trials: Sequence[Coordinate], sigmas: Sigmas | None = None) -> Smoother: ...

    def __call__(self, t: np.ndarray, q: Signal, v: Signal, a: Signal, sigmas: Sigmas | None = None) -> Smoothed: ...


def checked(t: np.ndarray, q: Signal, v: Signal, a: Signal, least: int = 2) -> np.ndarray:
    """Return the measured signals as an array of shape (3, n), NaN where a sample or a whole signal is missing.

    Raises:
        UserError: no signal is given, lengths differ, ``t`` does not increase, or there are fewer than ``least``
            samples.
    """
    t, n = np.asarray(t, float), len(t)
    if n < least:
        raise UserError("too few samples to smooth", where="t", received=f"{n} samples", allowed=f"at least {least}")
    if not np.all(np.diff(t) > 0):
        raise UserError("time does not increase", where="t", fix="sort the samples and drop repeated times")
    if q is None and v is None and a is None:
        raise UserError("nothing to smooth", allowed="at least one of position, velocity and acceleration")
    y = np.full((3, n), np.nan)
    for row, name, values in zip(y, SIGNALS, (q, v, a), strict=True):
        if values is None:
            continue
        if np.shape(values) != (n,):
            raise UserError("lengths differ", where=name, received=np.shape(values), allowed=f"({n},), the shape of t")
        row[:] = values
    return y


def completed(t: np.ndarray, y: np.ndarray, causal: bool = False) -> np.ndarray:
    """Fill the missing rows of ``y`` (3, n) by time integrals from 0 and time derivatives of their neighbours."""
    y = y.copy()
    given = [k for k in range(3) if not np.all(np.isnan(y[k]))]
    for k in range(given[0] - 1, -1, -1):
        y[k] = cumulative_trapezoid(y[k + 1], t, initial=0)
    for k in range(given[0] + 1, 3):
        if k not in given:
            y[k] = derivative(t, y[k - 1], causal)
    return y


def derivative(t: np.ndarray, y: np.ndarray, causal: bool = False) -> np.ndarray:
    """Return dy/dt by central differences, or by backward ones where ``causal``; 0 at the first causal sample."""
    if causal:
        return np.concatenate([[0.0], np.diff(y) / np.diff(t)])
    return np.gradient(y, t)


def difference_sigma(trials: Sequence[tuple[np.ndarray, np.ndarray]], order: int = 4) -> float:
    """Estimate the standard deviation of white noise from differences that cancel cubics.

    Each run of ``order + 1`` samples is weighted by ``w_i ∝ 1 / prod_{j != i}(t_i - t_j)``, ``|w| = 1``, and the
    median absolute value of the sums is scaled to a normal distribution's, so that jumps and outliers count little
    (after Gasser, Sroka and Jennen-Steinmetz, Biometrika 73, 1986). Most differences of a signal recorded in coarse
    steps are zero; its noise is at least that of rounding, step / sqrt(12), see :func:`quantisation_step`.

    Args:
        trials: pairs (t, y) of shape (n,).
        order: order of the differences.

    Returns:
        Estimate in the unit of y, at least 1e-6 of its root mean square; 0 where y is 0 or too short.
    """
    residuals, kept = [np.zeros(0)], [np.zeros(0)]
    for t, y in trials:
        keep = ~np.isnan(y)
        kept.append(y[keep])
        if np.count_nonzero(keep) <= order:
            continue
        times = np.lib.stride_tricks.sliding_window_view(t[keep], order + 1)
        times = (times - times[:, :1]) / (times[:, -1:] - times[:, :1])
        gaps = times[:, :, None] - times[:, None, :] + np.eye(order + 1)
        weights = 1 / np.prod(gaps, axis=2)
        weights /= np.linalg.norm(weights, axis=1, keepdims=True)
        residuals.append(np.abs(np.sum(weights * np.lib.stride_tricks.sliding_window_view(y[keep], order + 1), 1)))
    pooled, values = np.concatenate(residuals), np.concatenate(kept)
    rms = float(np.sqrt((values**2).mean())) if values.size else 0.0
    rounding = quantisation_step(kept) / 12**0.5
    return max(1.4826 * float(np.median(pooled)) if pooled.size else 0.0, SIGMA_FLOOR * rms, rounding)


def known_sigmas(trials: Sequence[Coordinate], sigmas: Sigmas | None) -> np.ndarray:
    """Return the noise standard deviations of position, velocity and acceleration, shape (3,), SI units.

    Those that are not given are estimated by :func:`difference_sigma`; the ones of missing signals are NaN.

    Raises:
        UserError: ``sigmas`` has not three entries, or one is negative or not finite.
    """
    given = list(sigmas) if sigmas is not None else [None] * 3
    if len(given) != 3 or any(s is not None and not 0 <= s < np.inf for s in given):
        raise UserError("invalid noise levels", where="sigmas", received=given, allowed="three numbers >= 0 or null")
    result = np.full(3, np.nan)
    for k, value in enumerate(given):
        pairs = [(trial[0], np.asarray(trial[k + 1], float)) for trial in trials if trial[k + 1] is not None]
        if pairs:
            y = np.concatenate([y for _, y in pairs])
            size = np.sqrt(np.nansum(y**2) / max(np.count_nonzero(~np.isnan(y)), 1))
            floor = SIGMA_FLOOR * float(size) or SIGMA_FLOOR
            result[k] = max(difference_sigma(pairs) if value is None else value, floor)
    return result


@dataclass(frozen=True)
class NoSmoothing:
    """Returns the signals as measured; jerk is the time derivative of the acceleration.

    Args:
        causal: use backward differences, which do not look ahead, in place of central ones.
    """

    causal: bool = False

    def fit(self, trials: Sequence[Coordinate], sigmas: Sigmas | None = None) -> NoSmoothing:
        """Return itself: nothing is fitted."""
        return self

    def __call__(self, t: np.ndarray, q: Signal, v: Signal, a: Signal, sigmas: Sigmas | None = None) -> Smoothed:
        y = completed(t, checked(t, q, v, a), self.causal)
        return y[0], y[1], y[2], derivative(t, y[2], self.causal)


@dataclass(frozen=True)
class SavitzkyGolay:
    """Least-squares polynomial over a moving window, each signal on its own (Savitzky and Golay, 1964).

    Sampling need not be uniform: the window holds a fixed number of samples and the polynomial uses their times. At
    the ends the window stays within the data. Polynomials up to ``order`` pass unchanged.

    Args:
        window_s: length of the window, s.
        order: degree of the polynomial, at least 1.

    Raises:
        UserError: ``order`` is below 1 or ``window_s`` is not above 0; a trial is shorter than ``order + 1`` samples.
    """

    window_s: float = 0.1
    order: int = 3
    causal = False

    def __post_init__(self) -> None:
        if self.order < 1:
            raise UserError("invalid polynomial order", where="order", received=self.order, allowed="1 or above")
        if not self.window_s > 0:
            raise UserError("invalid window", where="window_s", received=self.window_s, allowed="above 0 s")

    def fit(self, trials: Sequence[Coordinate], sigmas: Sigmas | None = None) -> SavitzkyGolay:
        """Return itself: window and order are given."""
        return self

    def _local(self, t: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the value and the time derivative of the local polynomials at ``t``."""
        n, half = len(t), round(self.window_s / float(np.median(np.diff(t))) / 2)
        width = min(max(2 * half + 1, self.order + 1), n)
        index = np.clip(np.arange(n) - width // 2, 0, n - width)[:, None] + np.arange(width)
        span = 0.5 * (t[index[:, -1]] - t[index[:, 0]])
        powers = ((t[index] - t[:, None]) / span[:, None])[:, :, None] ** np.arange(self.order + 1)
        basis, triangle = np.linalg.qr(powers)
        coefficients = np.linalg.solve(triangle, np.einsum("nwp,nw->np", basis, y[index])[:, :, None])[:, :, 0]
        return coefficients[:, 0], coefficients[:, 1] / span

    def __call__(self, t: np.ndarray, q: Signal, v: Signal, a: Signal, sigmas: Sigmas | None = None) -> Smoothed:
        y = checked(t, q, v, a, self.order + 1)
        given = ~np.all(np.isnan(y), axis=1)
        slope = np.zeros(len(t))
        for k in range(3):
            if given[k]:
                y[k], slope = self._local(t, y[k])
            elif given[:k].any():
                y[k], slope = self._local(t, slope)
        y = completed(t, y)
        return y[0], y[1], y[2], slope


@dataclass(frozen=True)
class SmoothingSpline:
    """Quintic B-spline fitted jointly to position, velocity and acceleration (de Boor, 1978).

    Minimises ``sum_k sum_i ((y_k(t_i) - s^(k)(t_i)) / sigma_k)^2`` over the coefficients of ``s``, with a knot at every
    ``spacing``-th sample; the spacing is the one of least Bayesian information criterion (Schwarz, 1978),
    ``sum_k n_k log(RSS_k / n_k) + p log(sum_k n_k)``, over all trials. The normal equations are banded.

    Args:
        spacing: samples per knot interval; None: chosen by :meth:`fit`.
        sigmas: noise standard deviations of position, velocity, acceleration, SI units; None: estimated.

    Raises:
        UserError: ``spacing`` is below 1, or a trial has fewer than 6 samples.
    """

    spacing: int | None = None
    sigmas: tuple[float | None, ...] | None = None
    causal = False

    def __post_init__(self) -> None:
        if self.spacing is not None and self.spacing < 1:
            raise UserError("invalid knot spacing", where="spacing", received=self.spacing, allowed="1 or above")

    def fit(self, trials: Sequence[Coordinate], sigmas: Sigmas | None = None) -> SmoothingSpline:
        """Return the spline smoother whose knot spacing and noise levels suit these trials of one coordinate."""
        sigma = known_sigmas(trials, sigmas if sigmas is not None else self.sigmas)
        data = [(np.asarray(trial[0], float), checked(*trial, least=6)) for trial in trials]
        longest = max(len(t) for t, _ in data)
        candidates = sorted({round(2 ** (k / 2)) for k in range(2, 40) if 2 ** (k / 2) <= max(2, longest / 2)})
        spacing = self.spacing or min(candidates, key=lambda m: _criterion(data, m, sigma))
        return replace(self, spacing=spacing, sigmas=tuple(float(s) for s in sigma))

    def __call__(self, t: np.ndarray, q: Signal, v: Signal, a: Signal, sigmas: Sigmas | None = None) -> Smoothed:
        if self.spacing is None or self.sigmas is None:
            return self.fit([(t, q, v, a)], sigmas)(t, q, v, a)
        levels = known_sigmas([(t, q, v, a)], [None if s is None or np.isnan(s) else s for s in sigmas or self.sigmas])
        fitted, _ = _spline(np.asarray(t, float), checked(t, q, v, a, least=6), self.spacing, levels)
        return fitted[0], fitted[1], fitted[2], fitted[3]


def _design(t: np.ndarray, spacing: int) -> list[sparse.csr_array]:
    """Design matrices (n, p) of a quintic spline and its first three derivatives, knots at every spacing-th sample."""
    inner = t[spacing : len(t) - max(spacing // 2, 1) : spacing]
    knots = np.concatenate([np.full(6, t[0]), inner, np.full(6, t[-1])])
    matrices, change = [], sparse.eye_array(len(knots) - 6, format="csr")
    for nu in range(4):
        degree = 5 - nu
        trimmed = knots[nu : len(knots) - nu]
        matrices.append(sparse.csr_array(BSpline.design_matrix(t, trimmed, degree) @ change))
        count = len(trimmed) - degree - 1
        factors = degree / (trimmed[degree + 1 : degree + count] - trimmed[1:count])
        step = sparse.diags_array([-factors, factors], offsets=[0, 1], shape=(count - 1, count))
        change = sparse.csr_array(step @ change)
    return matrices


def _spline(t: np.ndarray, y: np.ndarray, spacing: int, sigmas: np.ndarray) -> tuple[np.ndarray, int]:
    """Return the fitted spline and its derivatives at ``t``, shape (4, n), and the number of coefficients."""
    span = t[-1] - t[0]  # unit time span: keeps the derivatives' columns of like size
    scale = span ** np.arange(4)
    design = _design((t - t[0]) / span, spacing)
    size = design[0].shape[1]
    gram, right = sparse.csr_array((size, size)), np.zeros(size)
    measured = [k for k in range(3) if not np.all(np.isnan(y[k]))]
    for k in measured:
        weight = np.where(np.isnan(y[k]), 0.0, 1 / (sigmas[k] * scale[k]) ** 2)
        weighted = design[k].T @ sparse.diags_array(weight)
        gram, right = gram + weighted @ design[k], right + weighted @ np.nan_to_num(y[k] * scale[k])
    for k in range(measured[0]):  # integration constants: what is not measured starts from 0
        first = design[k][[0]]
        gram = gram + first.T @ first * (gram.diagonal().max() / abs(first).max() ** 2)
    band = np.zeros((6, size))
    for d in range(min(6, size)):
        band[d, : size - d] = gram.diagonal(-d)
    band[0] *= 1 + 1e-13
    coefficients = solveh_banded(band, right, lower=True)
    return np.stack([matrix @ coefficients for matrix in design]) / scale[:, None], size


def _criterion(data: list[tuple[np.ndarray, np.ndarray]], spacing: int, sigmas: np.ndarray) -> float:
    """Bayesian information criterion of the spline with that knot spacing."""
    squares, counts, coefficients = np.zeros(3), np.zeros(3), 0
    for t, y in data:
        fitted, size = _spline(t, y, min(spacing, len(t) - 1), sigmas)
        squares += np.nansum((y - fitted[:3]) ** 2, axis=1)
        counts += np.sum(~np.isnan(y), axis=1)
        coefficients += size
    some = counts > 0
    variance = np.maximum(squares[some] / counts[some], (1e-3 * sigmas[some]) ** 2)
    return float(np.sum(counts[some] * np.log(variance)) + coefficients * np.log(counts.sum()))
