"""What a term would gain in the balance of a robot: score tests, and cross-validation by stretches of time.

At a fit the balance is linear in all that may change, see :mod:`frictionpinn.diagnose.score`. Here there are rows of
every joint and no unknowns of single trials; a term at one joint has entries in that joint's rows alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from ..diagnose.score import NOTHING, TINY, inverse_root, log_p
from .balance import Solution

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
        spread = solution.spread(solution.columns)
        self.W = [np.concatenate([c[:, k] for c in spread]) @ H for k in range(joints)]
        self.WW, self.CC = sum(W.T @ W for W in self.W), [C.T @ C for C in self.C]
        self.Cr = sum(C.T @ r for C, r in zip(self.C, self.r, strict=True))
        self.folds = _folds([trial.compared for trial in solution.trials])

    def _rows(self, columns: Sequence[np.ndarray], at: Sequence[int]) -> tuple[dict, dict]:
        """A term's rows and their spread by joint, in units of the residuals."""
        names, noise = self.solution.model.names, self.solution.noise
        S, W = {}, {}
        for i, k in enumerate(at):
            own = [(c[:, i] if len(at) > 1 else c.reshape(len(c), -1)) / self.sigmas[k] for c in columns]
            S[k] = np.concatenate(own)
            W[k] = np.concatenate([noise.spread([names[k]], c[None])[0] for c in own])
        return S, W

    def test(self, columns: Sequence[np.ndarray], at: Sequence[int], strengths: int) -> list[Scored]:
        """Score a term at several values of its hidden parameters.

        Args:
            columns: of each trial, filtered, N m by strength: at one joint of shape (m, values * strengths), on the
                robot of shape (m, joints, strengths).
            at: joints that it acts on.
            strengths: of it.
        """
        S, W = self._rows(columns, at)
        G = sum(self.C[k].T @ S[k] for k in at)
        b = sum(S[k].T @ self.r[k] for k in at) - G.T @ self.Cr
        wide = sum(self.W[k].T @ W[k] for k in at)
        values = len(b) // strengths
        split = {k: (S[k].reshape(-1, values, strengths), W[k].reshape(-1, values, strengths)) for k in at}
        length = sum(np.einsum("nvs,nvu->vsu", x, x) for x, _ in split.values())
        spread = sum(np.einsum("nvs,nvu->vsu", w, w) for _, w in split.values())
        found = []
        for v in range(values):
            own = slice(v * strengths, (v + 1) * strengths)
            g = G[:, own]
            cross = wide[:, own].T @ g
            V = spread[v] - cross - cross.T + g.T @ self.WW @ g
            found.append(self._scored({k: x[:, v] for k, (x, _) in split.items()}, g, length[v], b[own], V))
        return found

    def _scored(
        self, S: dict[int, np.ndarray], G: np.ndarray, length: np.ndarray, b: np.ndarray, V: np.ndarray
    ) -> Scored:
        A, step, size = length - G.T @ G, np.zeros(len(b)), np.zeros(len(self.sigmas))
        keep = np.diag(A) > NOTHING * np.maximum(np.diag(length), TINY)
        if not keep.any() or not np.isfinite(A).all():
            return Scored(step, 0.0, 0.0, size)
        H, spread = inverse_root(A[np.ix_(keep, keep)]), inverse_root(V[np.ix_(keep, keep)])
        step[keep] = -H @ (H.T @ b[keep])
        statistic = float(np.sum((spread.T @ b[keep]) ** 2))
        moved = G @ step
        for k, rows in S.items():
            # (S - C G) step squared, from products that are there already.
            squared = (
                step @ (rows.T @ rows) @ step - 2 * step @ (rows.T @ self.C[k]) @ moved + moved @ self.CC[k] @ moved
            )
            size[k] = self.sigmas[k] * np.sqrt(max(squared, 0.0) / len(rows))
        return Scored(step, log_p(statistic, H.shape[1]), 0.5 * float(np.sum((H.T @ b[keep]) ** 2)), size)

    def confirmed(self, columns: Sequence[np.ndarray], at: Sequence[int]) -> tuple[float, float, float]:
        """Cross-validation: half the squared residuals that a term takes off stretches that its fit did not see.

        Returns:
            The gain, its standard error over the stretches, and its share of the squares at the joints ``at``.
        """
        S, _ = self._rows(columns, at)
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
        A, b = sum(x[0] for x in base), sum(x[1] for x in base)
        for (own_A, own_b, own_rr), (ss, cs, sr), rows in zip(base, parts, self.folds, strict=True):
            left = A - own_A + 1e-12 * np.eye(count)
            both = np.block([[left, CS - cs], [(CS - cs).T, SS - ss]])
            plain = -np.linalg.lstsq(left, b - own_b, rcond=None)[0]
            H = inverse_root(both)
            more = -H @ (H.T @ np.concatenate([b - own_b, Sr - sr]))
            inner = np.block([[own_A, cs], [cs.T, ss]])
            before = own_rr + 2 * plain @ own_b + plain @ own_A @ plain
            after = own_rr + 2 * more @ np.concatenate([own_b, sr]) + more @ inner @ more
            gains.append(0.5 * float(before - after))
            whole += 0.5 * sum(float(self.r[k][rows] @ self.r[k][rows]) for k in at)
        values = np.array(gains)
        return float(values.sum()), float(np.sqrt(len(values)) * values.std(ddof=1)), float(values.sum() / whole)

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
