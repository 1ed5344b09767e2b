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

import numpy as np
from scipy.optimize import minimize, minimize_scalar

from frictionpinn.errors import UserError
from frictionpinn.numerics.kalman_recursions import PRIOR, correct, forward, predict, transition
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
        value = -sum(forward(t, y, S, sigmas**2, self.prior, jumps, False)[0] for (t, y), jumps in pairs)
        return value / self.samples if np.isfinite(value) else 1e10

    def best_density(self, sigmas: np.ndarray, low: float, high: float) -> float:
        """Return log S of greatest likelihood between ``low`` and ``high``."""
        found = minimize_scalar(self, args=(sigmas,), bounds=(low, high), method="bounded", options={"xatol": 0.02})
        return float(found.x)

    def mark(self, log_density: float, sigmas: np.ndarray, threshold: float) -> int:
        """Search all trials for jumps once; return how many are new."""
        new = 0
        for (t, y), jumps in zip(self.data, self.jumps, strict=True):
            scores = forward(t, y, float(np.exp(log_density)), sigmas**2, self.prior, jumps, True)[2]
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
            _, z, scores = forward(t, y, float(self.density), variances, prior, jumps, True)
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
        z = forward(t, y, density, self._variances(sigmas), prior, jumps, False)[1].T
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
            transition(t - last, float(self.density or 0.0), F, Q)
            predict(F, Q, self._mean, self._covariance, np.zeros((size, size)))
        y = np.array([np.nan if s is None else s for s in (q, qd, qdd)])
        buffers = np.zeros((3, size)), np.zeros(3), np.zeros(3)
        correct(y, self._variances(None), self._mean, self._covariance, *buffers)
        self._time = float(t)
        difference = (self._mean[2] - before) / (t - last) if last is not None else 0.0
        jerk = self._mean[3] if size > 3 else difference
        return float(self._mean[0]), float(self._mean[1]), float(self._mean[2]), float(jerk)
