"""What a term would gain in the balance of a robot: score tests, and cross-validation by stretches of time.

At a fit the balance is linear in all that may change, see :mod:`frictionpinn.numerics.score`. Here there are rows
of every joint and no unknowns of single trials; a term at one joint has entries in that joint's rows alone.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy.stats import f, norm, wilcoxon

from ..numerics.score import NOTHING, TINY, inverse_root
from .least_squares import Solution, away, blocks_of

FOLDS = 8  # stretches of time, each left out once: seven eighths still excite what the whole does
LENGTH_S = 1.0  # of a stretch at least: many correlation times of filtered residuals


@dataclass(frozen=True)
class Scored:
    """What a term would do.

    Attributes:
        step: its strengths, SI units, shape (s,).
        log_p: decimal logarithm of the chance to see as much without it.
        gain: log-likelihood that it gains, residuals taken as white.
        size: root mean square of its torque at each joint, beside what is estimated already, N m, shape (joints,).
    """

    step: np.ndarray
    log_p: float
    gain: float
    size: np.ndarray


@dataclass(frozen=True)
class Confirmed:
    """What a term takes off stretches of time that its fit did not see.

    Attributes:
        gain: log-likelihood, ``error`` its standard error over the stretches.
        chance: of gains as even in sign without the term (signed ranks: Wilcoxon): one stretch that gains much more
            than others speaks against no term, though it widens the standard error.
        share: of the squares at its joints.
    """

    gain: float
    error: float
    chance: float
    share: float

    def sure(self, errors: float) -> bool:
        """Whether it is above zero by so many standard errors, or by signed ranks as surely."""
        return self.gain > errors * self.error or (self.gain > 0 and self.chance < float(norm.sf(errors)))


class Scorer:
    """Everything at a fit that tests of many terms share.

    Args:
        solution: the fit.
    """

    def __init__(self, solution: Solution):
        self.solution, self.sigmas = solution, solution.sigmas
        joints = len(self.sigmas)
        H = inverse_root(solution.precision)
        self.r = [np.concatenate([r[:, k] for r in solution.residuals]) / self.sigmas[k] for k in range(joints)]
        self.C = [np.concatenate([c[:, k] for c in solution.columns]) @ H for k in range(joints)]
        self.blocks = blocks_of(solution.trials)
        self.pull = H.T @ (solution.prior * away(solution.model))  # of the priors, which every stretch's fit keeps
        self.Cr = sum(C.T @ r for C, r in zip(self.C, self.r, strict=True))
        self.left = [r - C @ self.Cr for C, r in zip(self.C, self.r, strict=True)]  # beside a fit Cr is not zero
        self.folds = _folds([trial.compared for trial in solution.trials])

    def _rows(self, columns: Sequence[np.ndarray], at: Sequence[int]) -> dict[int, np.ndarray]:
        """A term's rows by joint, in units of the residuals."""
        return {
            k: np.concatenate([c[:, i] if len(at) > 1 else c.reshape(len(c), -1) for c in columns]) / self.sigmas[k]
            for i, k in enumerate(at)
        }

    def test(
        self,
        columns: Sequence[np.ndarray],
        at: Sequence[int],
        strengths: int,
        possible: Callable[[np.ndarray], bool] = lambda step: True,
    ) -> tuple[int, Scored]:
        """Score a term at several values of its hidden parameters; the index of that which gains most, and its score.

        Args:
            columns: of each trial, filtered, N m by strength: at one joint of shape (m, values * strengths), on the
                robot of shape (m, joints, strengths).
            at: joints that it acts on.
            strengths: of it.
            possible: whether strengths are; a step that is not gains nothing.
        """
        S = self._rows(columns, at)
        G = sum(self.C[k].T @ S[k] for k in at)
        b = sum(S[k].T @ self.r[k] for k in at) - G.T @ self.Cr
        best, kept = (0, Scored(np.zeros(strengths), 0.0, 0.0, np.zeros(len(self.sigmas)))), None
        for v in range(len(b) // strengths):
            own = slice(v * strengths, (v + 1) * strengths)
            length = sum(S[k][:, own].T @ S[k][:, own] for k in at)
            A = length - G[:, own].T @ G[:, own]
            told = np.diag(A) > NOTHING * np.maximum(np.diag(length), TINY)
            if not told.any() or not np.isfinite(A).all():
                continue
            step, H = np.zeros(strengths), inverse_root(A[np.ix_(told, told)])
            step[told] = -H @ (H.T @ b[own][told])
            gain = 0.5 * float(np.sum((H.T @ b[own][told]) ** 2))
            if gain > best[1].gain and possible(step):
                best, kept = (v, replace(best[1], step=step, gain=gain)), (own, told)
        if kept is None:
            return best
        own, told = kept
        g = G[:, own]
        beside = {k: (S[k][:, own] if k in S else 0.0) - self.C[k] @ g for k in range(len(self.sigmas))}
        chance = self._chance({k: rows[:, told] for k, rows in beside.items()})
        size = np.array([
            self.sigmas[k] * np.sqrt(np.mean((rows @ best[1].step) ** 2)) if k in S else 0.0
            for k, rows in beside.items()
        ])  # fmt: skip
        return best[0], replace(best[1], log_p=chance, size=size)

    def _chance(self, rows: Mapping[int, np.ndarray]) -> float:
        """Decimal logarithm of the chance of a term's step where it is absent.

        Its covariance is that of its steps without one block of time each; Hotelling's T^2.

        Args:
            rows: of the term beside what is estimated already, by joint.
        """
        A = np.array([sum(x[own].T @ x[own] for x in rows.values()) for own in self.blocks])
        b = np.array([sum(x[own].T @ self.left[k][own] for k, x in rows.items()) for own in self.blocks])
        steps = []
        for a, own in zip(A, b, strict=True):
            H = inverse_root(A.sum(axis=0) - a)
            steps.append(-H @ (H.T @ (b.sum(axis=0) - own)))
        whole = inverse_root(A.sum(axis=0))
        step, count, s = -whole @ (whole.T @ b.sum(axis=0)), len(A), len(b[0])
        away = np.array(steps) - np.mean(steps, axis=0)
        spread = inverse_root((count - 1) / count * away.T @ away)
        ratio = float(np.sum((spread.T @ step) ** 2)) * (count - s) / (s * (count - 1))
        return float(f.logsf(ratio, s, count - s) / np.log(10))

    def confirmed(self, columns: Sequence[np.ndarray], at: Sequence[int]) -> Confirmed:
        """Cross-validation: half the squared residuals that a term takes off stretches that its fit did not see."""
        S = self._rows(columns, at)
        base, gains, whole = self._base, [], 0.0
        count = base[0][0].shape[0]
        parts = []
        for rows in self.folds:
            inside = {k: S[k][rows] for k in at}
            parts.append(
                (
                    sum(x.T @ x for x in inside.values()),
                    sum(self.C[k][rows].T @ inside[k] for k in at),
                    sum(inside[k].T @ self.r[k][rows] for k in at),
                )
            )
        SS, CS, Sr = (sum(p[i] for p in parts) for i in range(3))
        A, b = np.eye(count), self.pull + sum(x[1] for x in base)  # columns are scaled by the precision, priors in it
        for (own_A, own_b, own_rr), (ss, cs, sr), rows in zip(base, parts, self.folds, strict=True):
            left = A - own_A
            both = np.block([[left, CS - cs], [(CS - cs).T, SS - ss]])
            plain = -np.linalg.lstsq(left, b - own_b, rcond=None)[0]
            H = inverse_root(both)
            more = -H @ (H.T @ np.concatenate([b - own_b, Sr - sr]))
            inner = np.block([[own_A, cs], [cs.T, ss]])
            before = own_rr + 2 * plain @ own_b + plain @ own_A @ plain
            after = own_rr + 2 * more @ np.concatenate([own_b, sr]) + more @ inner @ more
            gains.append(0.5 * float(before - after))
            whole += 0.5 * sum(float(self.r[k][rows] @ self.r[k][rows]) for k in at)
        return Confirmed(*certainty(np.array(gains)), float(np.sum(gains) / whole))

    @cached_property
    def _base(self) -> list[tuple[np.ndarray, np.ndarray, float]]:
        """Normal equations of what is estimated already, by stretch."""
        return [
            (
                sum(C[rows].T @ C[rows] for C in self.C),
                sum(C[rows].T @ r[rows] for C, r in zip(self.C, self.r, strict=True)),
                sum(float(r[rows] @ r[rows]) for r in self.r),
            )
            for rows in self.folds
        ]


def certainty(gains: np.ndarray) -> tuple[float, float, float]:
    """Sum of the stretches' gains, its standard error, and its chance by signed ranks."""
    chance = float(wilcoxon(gains, alternative="greater").pvalue) if np.any(gains) else 1.0
    return float(gains.sum()), float(np.sqrt(len(gains)) * gains.std(ddof=1)), chance


def _folds(times: Sequence[np.ndarray]) -> list[slice]:
    """Stretches of the compared samples of all trials in a row, none of two trials."""
    total = sum(float(t[-1] - t[0]) for t in times)
    folds, first = [], 0
    for t in times:
        share = float(t[-1] - t[0]) / total
        most = max(int((t[-1] - t[0]) / LENGTH_S), 1)
        count = int(np.clip(round(FOLDS * share), 1, most))
        if len(times) == 1:
            count = max(count, min(2, most))
        edges = first + np.linspace(0, len(t), count + 1).round().astype(int)
        folds += [slice(int(a), int(b)) for a, b in pairwise(edges)]
        first += len(t)
    return folds
