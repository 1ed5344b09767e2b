"""Kalman smoother and filter for position, velocity and acceleration measured together.

State ``z = (q, q', q'')``, with 4 states also the jerk and with 5 the snap. The highest derivative is a Wiener process
of spectral density S: 3 states are driven by white jerk, 4 by white snap (Bar-Shalom, Li and Kirubarajan, *Estimation
with Applications to Tracking and Navigation*, 2001, ch. 6). Over a step h, with n states,

    z(t+h) = F z(t) + w,  F_ij = h^(j-i) / (j-i)!,
    cov(w)_ij = S h^(2n-1-i-j) / ((n-1-i)! (n-1-j)! (2n-1-i-j)),  i, j = 0 ... n-1,

and each measured signal is its state plus white noise. Steps need not be uniform, and NaN samples are skipped.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numba
import numpy as np
from scipy.optimize import minimize, minimize_scalar

from frictionpinn.errors import UserError
from frictionpinn.numerics.smoothing import (
    Coordinate,
    Sigmas,
    Signal,
    Smoothed,
    checked,
    completed,
    derivative,
    known_sigmas,
)

JUMP_GAP_S, JUMP_ROUNDS = 0.05, 8  # least time between jumps found in one round; most rounds of the search
PRIOR = 100.0  # prior standard deviation of the first state, relative to each signal's root mean square


@numba.njit(cache=True)
def _transition(h, density, F, Q):
    """Write the transition matrix and the process noise covariance over a step ``h``."""
    n = F.shape[0]
    factorial = np.array([1.0, 1.0, 2.0, 6.0, 24.0])
    for i in range(n):
        for j in range(n):
            F[i, j] = h ** (j - i) / factorial[j - i] if j >= i else 0.0
            power = 2 * n - 1 - i - j
            Q[i, j] = density * h**power / (factorial[n - 1 - i] * factorial[n - 1 - j] * power)


@numba.njit(cache=True)
def _predict(F, Q, x, P, work):
    """Advance mean and covariance by one step, in place."""
    n = len(x)
    for i in range(n):
        for j in range(n):
            work[i, j] = 0.0
            for k in range(i, n):
                work[i, j] += F[i, k] * P[k, j]
    for i in range(n):
        mean = 0.0
        for k in range(i, n):
            mean += F[i, k] * x[k]
        x[i] = mean
    for i in range(n):
        for j in range(i, n):
            entry = Q[i, j]
            for k in range(j, n):
                entry += work[i, k] * F[j, k]
            P[i, j] = entry
            P[j, i] = entry


@numba.njit(cache=True)
def _correct(y, variances, x, P, gains, errors, spreads):
    """Take in the signals of one sample one after another; return their log-likelihood."""
    n, loglik = len(x), 0.0
    for c in range(3):
        spreads[c] = 0.0
        if np.isnan(y[c]) or np.isnan(variances[c]) or P[c, c] + variances[c] <= 0:
            continue
        s = P[c, c] + variances[c]
        e = y[c] - x[c]
        for i in range(n):
            gains[c, i] = P[i, c] / s
        for i in range(n):
            x[i] += gains[c, i] * e
            for j in range(i, n):
                P[i, j] -= gains[c, i] * gains[c, j] * s
                P[j, i] = P[i, j]
        errors[c], spreads[c] = e, s
        loglik -= 0.5 * (np.log(2 * np.pi * s) + e * e / s)
    return loglik


@numba.njit(cache=True)
def _forward(t, y, density, variances, deviations, jumps, smooth):
    """Return log-likelihood, states (n, size) and jump scores (n,) of a trial, smoothed where ``smooth``.

    The smoother gives the Rauch-Tung-Striebel estimates in the modified Bryson-Frazier form, which inverts no
    covariance (Bierman, 1973). ``jumps`` marks the samples before which the acceleration may jump.
    """
    n, size = len(t), len(deviations)
    x, P = np.zeros(size), np.diag(deviations**2)
    F, Q, work = np.zeros((size, size)), np.zeros((size, size)), np.zeros((size, size))
    means, predicted, covariances = np.zeros((n, size)), np.zeros((n, size)), np.zeros((n, size, size))
    gains, errors, spreads = np.zeros((n, 3, size)), np.zeros((n, 3)), np.zeros((n, 3))
    loglik, step, scores = 0.0, -1.0, np.zeros(n)
    for k in range(n):
        if k > 0:
            if t[k] - t[k - 1] != step:
                step = t[k] - t[k - 1]
                _transition(step, density, F, Q)
            _predict(F, Q, x, P, work)
            if jumps[k]:
                _jump(step, P, deviations / PRIOR)
        predicted[k], covariances[k] = x, P
        loglik += _correct(y[:, k], variances, x, P, gains[k], errors[k], spreads[k])
        means[k] = x
    if smooth:
        _backward(t, density, predicted, covariances, gains, errors, spreads, means, scores)
    return loglik, means, scores


@numba.njit(cache=True)
def _jump(h, P, deviations):
    """Let the acceleration jump at any time in the step ``h``, and the higher derivatives with it."""
    spread = deviations[2] ** 2
    moments = np.array([[h**4 / 20, h**3 / 8, h**2 / 6], [h**3 / 8, h**2 / 3, h / 2], [h**2 / 6, h / 2, 1.0]])
    for i in range(3):
        for j in range(3):
            P[i, j] += spread * moments[i, j]
    for i in range(3, len(P)):
        P[i, i] += deviations[i] ** 2


@numba.njit(cache=True)
def _inform(information, gain, spread, c, product):
    """Replace N by e_c e_c' / s + L' N L with L = I - K e_c', in place."""
    size = len(gain)
    column = np.zeros(size)
    for i in range(size):
        for j in range(size):
            column[i] += information[i, j] * gain[j]
    centre = 1.0 / spread
    for i in range(size):
        centre += gain[i] * column[i]
    for i in range(size):
        information[i, c] -= column[i]
        information[c, i] -= column[i]
    information[c, c] += centre


@numba.njit(cache=True)
def _backward(t, density, predicted, covariances, gains, errors, spreads, means, scores):
    """Overwrite the filtered ``means`` by the smoothed ones and ``scores`` by the evidence of jumps."""
    n, size = means.shape
    information, product = np.zeros((size, size)), np.zeros((size, size))
    F, Q, adjoint, before = np.zeros((size, size)), np.zeros((size, size)), np.zeros(size), np.zeros(size)
    for k in range(n - 1, -1, -1):
        for c in range(2, -1, -1):
            if spreads[k, c] > 0:
                change = errors[k, c] / spreads[k, c]
                for i in range(size):
                    change -= gains[k, c, i] * adjoint[i]
                adjoint[c] += change
                _inform(information, gains[k, c], spreads[k, c], c, product)
        if information[2, 2] > 0:
            scores[k] = adjoint[2] ** 2 / information[2, 2]
        for i in range(size):
            means[k, i] = predicted[k, i]
            for j in range(size):
                means[k, i] += covariances[k, i, j] * adjoint[j]
        if k > 0:
            _transition(t[k] - t[k - 1], density, F, Q)
            for i in range(size):
                before[i] = 0.0
                for j in range(i + 1):
                    before[i] += F[j, i] * adjoint[j]
            adjoint[:] = before
            information = F.T @ information @ F


def _prior(data: list[tuple[np.ndarray, np.ndarray]], order: int) -> tuple[np.ndarray, float]:
    """Prior standard deviations of the first state, and the root mean square of its highest derivative."""
    rows: list[np.ndarray] = []
    for t, y in data:
        filled = np.array([np.interp(t, t[ok], row[ok]) if (ok := ~np.isnan(row)).any() else row for row in y])
        filled = completed(t, filled)
        jerk = derivative(t, filled[2])
        rows.append(np.vstack([filled, jerk, derivative(t, jerk)])[:order])
    rms = np.sqrt(np.mean(np.concatenate(rows, axis=1) ** 2, axis=1))
    rms = np.where(rms > 0, rms, 1.0)
    prior = PRIOR * rms
    for k in range(3):  # what is not measured and follows by integration starts from 0
        if all(np.isnan(y[: k + 1]).all() for _, y in data):
            prior[k] = 0.0
    return prior, float(rms[-1])


def _find_jumps(t: np.ndarray, scores: np.ndarray, jumps: np.ndarray, threshold: float) -> int:
    """Mark the highest scores above ``threshold**2`` in ``jumps``; return how many are new."""
    candidates, new = scores.copy(), 0
    candidates[:3] = 0.0
    for k in np.flatnonzero(jumps):
        candidates[max(k - 2, 0) : k + 3] = 0.0
    while candidates.max() > threshold**2:
        best = int(candidates.argmax())
        jumps[best], new = True, new + 1
        candidates[np.abs(t - t[best]) <= JUMP_GAP_S] = 0.0
        candidates[max(best - 2, 0) : best + 3] = 0.0
    return new


class _Likelihood:
    """Mean negative log-likelihood of the trials of one coordinate, and its minimisation."""

    def __init__(self, data: list[tuple[np.ndarray, np.ndarray]], prior: np.ndarray):
        self.data, self.prior = data, prior
        self.jumps = [np.zeros(len(t), bool) for t, _ in data]
        self.samples = sum(np.count_nonzero(~np.isnan(y)) for _, y in data)

    def __call__(self, log_density: float, sigmas: np.ndarray) -> float:
        S, pairs = float(np.exp(log_density)), zip(self.data, self.jumps, strict=True)
        value = -sum(_forward(t, y, S, sigmas**2, self.prior, jumps, False)[0] for (t, y), jumps in pairs)
        return value / self.samples if np.isfinite(value) else 1e10

    def best_density(self, sigmas: np.ndarray, low: float, high: float) -> float:
        """Return log S of greatest likelihood between ``low`` and ``high``."""
        found = minimize_scalar(self, args=(sigmas,), bounds=(low, high), method="bounded", options={"xatol": 0.02})
        return float(found.x)

    def mark(self, log_density: float, sigmas: np.ndarray, threshold: float) -> int:
        """Search all trials for jumps once; return how many are new."""
        new = 0
        for (t, y), jumps in zip(self.data, self.jumps, strict=True):
            scores = _forward(t, y, float(np.exp(log_density)), sigmas**2, self.prior, jumps, True)[2]
            new += _find_jumps(t, scores, jumps, threshold)
        return new

    def best_sigmas(self, log_density: float, sigmas: np.ndarray, free: np.ndarray, reach: float):
        """Return log S, within ``reach`` of the given one, and the ``free`` noise levels of greatest likelihood."""

        def levels(p: np.ndarray) -> np.ndarray:
            scaled = sigmas.copy()
            scaled[free] *= np.exp(p[1:])
            return scaled

        result = minimize(
            lambda p: self(log_density + p[0], levels(p)),
            np.zeros(1 + free.sum()),
            method="L-BFGS-B",
            bounds=[(-reach, reach)] + [(-3.0, 3.0)] * int(free.sum()),
            options={"ftol": 1e-7, "eps": 1e-4},
        )
        return log_density + float(result.x[0]), levels(result.x)


@dataclass
class _KalmanModel:
    """State-space model, its maximum-likelihood fit, and what smoother and filter share."""

    order: int = 4
    density: float | None = None
    sigmas: tuple[float | None, ...] | None = None
    prior: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        if self.order not in (3, 4, 5):
            raise UserError("invalid order", where="order", received=self.order, allowed="3, 4 or 5 states")
        if self.density is not None and not 0 <= self.density < np.inf:
            raise UserError("invalid spectral density", where="density", received=self.density, allowed="0 or above")

    def _threshold(self) -> float | None:
        return None

    def fit(self, trials: Sequence[Coordinate], sigmas: Sigmas | None = None) -> Self:
        """Return the model with density and noise levels of greatest likelihood on these trials of one coordinate.

        The likelihood ``prod_k N(e_k; 0, s_k)`` of the filter's innovations is maximised over log S, then jointly over
        log S and the noise levels. A density or noise level that is given stays.

        Args:
            trials: tuples (t, q, v, a) of one coordinate, shape (n,) each, q, v or a None where not measured.
            sigmas: known noise standard deviations of q, v, a, SI units; None entries are estimated.

        Raises:
            UserError: a trial is malformed or has fewer than 5 samples, or a noise level is invalid.
        """
        own = [None if s is None or np.isnan(s) else s for s in self.sigmas or [None] * 3]
        given = list(sigmas) if sigmas is not None else own
        levels = known_sigmas(trials, given)
        free = np.array([np.isfinite(s) and g is None for s, g in zip(levels, given, strict=True)])
        data = [(np.asarray(trial[0], float), checked(*trial, least=5)) for trial in trials]
        prior, top = _prior(data, self.order)
        cost, logs = _Likelihood(data, prior), np.log(max(self.density or 0.0, 1e-300))
        if self.density is None:
            step = float(np.median(np.concatenate([np.diff(t) for t, _ in data])))
            grid = np.log(top**2 / step) + np.linspace(-42.0, 6.0, 17)
            middle = grid[int(np.argmin([cost(g, levels) for g in grid]))]
            logs = cost.best_density(levels, middle - 3, middle + 3)
        threshold = self._threshold()
        for _ in range(JUMP_ROUNDS if threshold else 0):
            if not cost.mark(logs, levels, threshold or np.inf):
                break
            logs = cost.best_density(levels, logs - 8, logs + 2) if self.density is None else logs
        if free.any():
            logs, levels = cost.best_sigmas(logs, levels, free, reach=12.0 if self.density is None else 0.0)
        density = float(np.exp(logs)) if self.density is None else self.density
        return replace(self, density=density, sigmas=tuple(levels.tolist()), prior=tuple(prior.tolist()))

    def _variances(self, sigmas: Sigmas | None) -> np.ndarray:
        """Variances of the measured signals, shape (3,), NaN for one that the fit did not see."""
        levels = list(self.sigmas or [None] * 3)
        if sigmas is not None:
            if len(sigmas) != 3:
                raise UserError("invalid noise levels", where="sigmas", received=list(sigmas), allowed="three entries")
            levels = [own if new is None else new for new, own in zip(sigmas, levels, strict=True)]
        return np.array([np.nan if s is None else s for s in levels], float) ** 2


@dataclass
class KalmanSmoother(_KalmanModel):
    """Fixed-interval smoother over a whole trial (Rauch, Tung and Striebel, 1965).

    Position, velocity and acceleration come out consistent with each other; with 3 states the jerk is the time
    derivative of the smoothed acceleration, with more it is a state.

    Stick-slip makes the acceleration jump, which a single S can follow only by smoothing less everywhere. Where the
    smoothed disturbance exceeds ``jump_threshold`` of its standard deviations (auxiliary residuals: de Jong and
    Penzer, J. Am. Stat. Assoc. 93, 1998), the acceleration is let free to jump and the search is repeated.

    Args:
        order: number of states, 3 (white jerk), 4 (white snap) or 5; more suits smoother motion.
        density: spectral density S, (SI unit of the highest state)^2/s; None: by maximum likelihood.
        sigmas: noise standard deviations of q, v, a, SI units; None: by maximum likelihood.
        prior: standard deviations of the first state; None: from the data.
        jump_threshold: in standard deviations; None: no jumps are sought, which is better for a coordinate that moves
            smoothly while its signals have outliers.

    Raises:
        UserError: ``order``, ``density`` or ``jump_threshold`` is out of range, or the trial is malformed.
    """

    order: int = 5
    jump_threshold: float | None = 4.5
    causal = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.jump_threshold is not None and not self.jump_threshold > 0:
            raise UserError(
                "invalid threshold", where="jump_threshold", received=self.jump_threshold, allowed="above 0"
            )

    def _threshold(self) -> float | None:
        return self.jump_threshold

    def __call__(self, t: np.ndarray, q: Signal, v: Signal, a: Signal, sigmas: Sigmas | None = None) -> Smoothed:
        """Return smoothed (q, v, a, jerk), shape (n,) each; an unfitted smoother is fitted on this trial first."""
        if self.prior is None or self.density is None or self.sigmas is None:
            return self.fit([(t, q, v, a)], sigmas)(t, q, v, a)
        t, y, jumps = np.asarray(t, float), checked(t, q, v, a), np.zeros(len(t), bool)
        variances, prior = self._variances(sigmas), np.array(self.prior)
        for _ in range(JUMP_ROUNDS):
            _, z, scores = _forward(t, y, float(self.density), variances, prior, jumps, True)
            if self.jump_threshold is None or not _find_jumps(t, scores, jumps, self.jump_threshold):
                break
        z = z.T
        return z[0], z[1], z[2], z[3] if self.order > 3 else derivative(t, z[2])


@dataclass
class KalmanFilter(_KalmanModel):
    """Causal counterpart of :class:`KalmanSmoother`: the estimate at a sample uses that sample and earlier ones.

    Arguments as there. :meth:`fit` it on training trials; :meth:`__call__` filters a trial, :meth:`update` takes one
    sample at a time and :meth:`reset` starts anew. With 3 states the jerk is a backward difference.
    """

    causal = True

    def __post_init__(self) -> None:
        super().__post_init__()
        self.reset()

    def reset(self) -> None:
        """Forget all samples taken in by :meth:`update`."""
        self._time: float | None = None
        self._mean = np.zeros(self.order)
        self._covariance = np.diag(np.square(self.prior)) if self.prior is not None else np.eye(self.order)

    def _require_fit(self) -> None:
        if self.prior is None or self.density is None or self.sigmas is None:
            raise UserError("filter is not fitted", where="KalmanFilter", fix="call fit with training trials first")

    def __call__(self, t: np.ndarray, q: Signal, v: Signal, a: Signal, sigmas: Sigmas | None = None) -> Smoothed:
        """Return filtered (q, v, a, jerk), shape (n,) each.

        Raises:
            UserError: the filter is not fitted, or the trial is malformed.
        """
        self._require_fit()
        t, y, jumps = np.asarray(t, float), checked(t, q, v, a, least=1), np.zeros(len(t), bool)
        density, prior = float(self.density or 0.0), np.array(self.prior)
        z = _forward(t, y, density, self._variances(sigmas), prior, jumps, False)[1].T
        return z[0], z[1], z[2], z[3] if self.order > 3 else derivative(t, z[2], causal=True)

    def update(
        self, t: float, q: float | None = None, qd: float | None = None, qdd: float | None = None
    ) -> tuple[float, float, float, float]:
        """Take in one sample, None where a signal is missing, and return (q, v, a, jerk), SI units.

        Raises:
            UserError: the filter is not fitted, or ``t`` is not after the previous sample's.
        """
        self._require_fit()
        before, last = self._mean[2], self._time
        size = self.order
        if last is not None:
            if not t > last:
                raise UserError("time does not increase", where="t", received=t, allowed=f"above {last} s")
            F, Q = np.zeros((size, size)), np.zeros((size, size))
            _transition(t - last, float(self.density or 0.0), F, Q)
            _predict(F, Q, self._mean, self._covariance, np.zeros((size, size)))
        y = np.array([np.nan if s is None else s for s in (q, qd, qdd)])
        buffers = np.zeros((3, size)), np.zeros(3), np.zeros(3)
        _correct(y, self._variances(None), self._mean, self._covariance, *buffers)
        self._time = float(t)
        difference = (self._mean[2] - before) / (t - last) if last is not None else 0.0
        jerk = self._mean[3] if size > 3 else difference
        return float(self._mean[0]), float(self._mean[1]), float(self._mean[2]), float(jerk)
