"""Score test of every candidate at a fit: how much would the likelihood gain if its strengths left neutral?

With r the residuals in units of their noise, B the derivatives in what is estimated already and S those in the
strengths of a candidate, the statistic is (S_B' r)' (S_B' R S_B)^-1 (S_B' r), S_B = S less its projection on B and R
the autocorrelation of the noise (Rao's score or Lagrange multiplier test, robust to coloured noise); it is chi-squared
where the candidate is absent. The trial's own unknowns, initial states and noisy inputs, are projected out first.

Source: Rao, Proc. Camb. Phil. Soc. 44 (1948); White, Maximum likelihood of misspecified models, Econometrica 50 (1982).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import gammaln
from scipy.stats import chi2

from .linear import Rows
from .noise import Noise

SINGULAR = 1e-9  # of the largest eigenvalue: directions below are not told by the data
NOTHING = 1e-6  # of a column's squared length: what is left of it beside what is estimated is rounding
ALIKE = 0.995  # share of a candidate's trace that another explains: the data do not tell them apart


@dataclass(frozen=True)
class Columns:
    """Everything that a trial says, its own unknowns projected out, in units of the noise.

    Attributes:
        own: orthonormal basis of the trial's own unknowns, shape (rows, unknowns).
        r: residuals, shape (rows,).
        matrix: derivatives C, shape (rows, parameters).
        spread: W with W'W = C'RC, shape (rows, parameters).
    """

    own: np.ndarray
    r: np.ndarray
    matrix: np.ndarray
    spread: np.ndarray

    @classmethod
    def of(cls, row: Rows, noise: Noise | None) -> Columns:
        """Scale, flatten and project."""
        r, change, local = row.r, row.change, row.local
        if noise is not None:
            r, change, local = (noise.scaled(row.signals, values) for values in (r, change, local))
        own = basis(local.reshape(r.size, -1))
        matrix = project(own, change.reshape(r.size, -1))
        spread = matrix
        if noise is not None and noise.coloured:
            spread = noise.spread(row.signals, matrix.reshape(change.shape)).reshape(matrix.shape)
        return cls(own, project(own, r.reshape(-1)), matrix, spread)


def basis(matrix: np.ndarray) -> np.ndarray:
    """Orthonormal basis of the columns of a matrix, those that depend on others left out."""
    norms = np.linalg.norm(matrix, axis=0)
    scaled = matrix[:, norms > 0] / norms[norms > 0]
    if not scaled.shape[1]:
        return scaled
    values, vectors = np.linalg.eigh(scaled.T @ scaled)
    keep = values > SINGULAR * values[-1]
    return scaled @ (vectors[:, keep] / np.sqrt(values[keep]))


def project(own: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """What is left of columns beside a basis."""
    return columns - own @ (own.T @ columns)


@dataclass(frozen=True)
class Normal:
    """Normal equations of named columns: A = C'C, b = C'r and the covariance V = C'RC of b, summed over the trials.

    Attributes:
        names: parameters.
        A, V: shape (n, n).
        b: shape (n,).
        rr: r'r.
    """

    names: tuple[str, ...]
    A: np.ndarray
    b: np.ndarray
    rr: float
    V: np.ndarray

    @classmethod
    def of(cls, names: Sequence[str], columns: Sequence[Columns]) -> Normal:
        """Sum over the trials."""
        A = sum(c.matrix.T @ c.matrix for c in columns)
        b = sum(c.matrix.T @ c.r for c in columns)
        V = sum(c.spread.T @ c.spread for c in columns)
        return cls(tuple(names), np.asarray(A), np.asarray(b), float(sum(c.r @ c.r for c in columns)), np.asarray(V))

    def places(self, names: Sequence[str]) -> list[int]:
        """Columns of these parameters."""
        return [self.names.index(name) for name in names]

    def given(self, known: Sequence[str]) -> Normal:
        """The equations of the others when these are estimated along."""
        inner = self.places(known)
        outer = [i for i in range(len(self.names)) if i not in set(inner)]
        X = solve(self.A[np.ix_(inner, inner)], np.column_stack([self.A[np.ix_(inner, outer)], self.b[inner]]))
        A = self.A[np.ix_(outer, outer)] - self.A[np.ix_(outer, inner)] @ X[:, :-1]
        b = self.b[outer] - self.A[np.ix_(outer, inner)] @ X[:, -1]
        T = np.zeros((len(self.names), len(outer)))
        T[inner], T[outer] = -X[:, :-1], np.eye(len(outer))
        rr = self.rr - float(self.b[inner] @ X[:, -1])
        return Normal(tuple(self.names[i] for i in outer), A, b, rr, T.T @ self.V @ T)

    @property
    def covariance(self) -> np.ndarray:
        """Covariance of the parameters by least squares, A^-1 V A^-1, shape (n, n)."""
        inverse, _ = pseudo_inverse(self.A)
        return inverse @ self.V @ inverse

    def test(self, names: Sequence[str], scale: np.ndarray | None = None) -> tuple[float, int, np.ndarray]:
        """Statistic, degrees of freedom and the step of the strengths, shape (names,).

        ``scale`` holds the squared lengths of their columns before anything was projected out: what is left of them
        below rounding counts as nothing, and so does a column of infinite length: one that could not be computed.
        """
        at = self.places(names)
        A, b = self.A[np.ix_(at, at)], self.b[at]
        size = A.diagonal() if scale is None else scale
        keep = A.diagonal() > NOTHING * np.maximum(size, 1e-300)
        step = np.zeros(len(at))
        if not keep.any():
            return 0.0, 0, step
        inverse, rank = pseudo_inverse(A[np.ix_(keep, keep)])
        step[keep] = -inverse @ b[keep]
        spread, _ = pseudo_inverse(self.V[np.ix_(at, at)][np.ix_(keep, keep)])
        return float(b[keep] @ spread @ b[keep]), rank, step


def pseudo_inverse(A: np.ndarray) -> tuple[np.ndarray, int]:
    """Inverse of a positive matrix in the directions that the data tell, and their number."""
    size = 1 / np.sqrt(np.maximum(A.diagonal(), 1e-300))
    values, vectors = np.linalg.eigh(A * size[:, None] * size)
    keep = values > SINGULAR * max(values[-1], 1e-300)
    half = size[:, None] * vectors[:, keep] / np.sqrt(values[keep])
    return half @ half.T, int(keep.sum())


def solve(A: np.ndarray, right: np.ndarray) -> np.ndarray:
    """A^-1 right for a positive matrix, in the directions that the data tell."""
    return pseudo_inverse(A)[0] @ right if len(A) else np.zeros((0, *right.shape[1:]))


def log_p(statistic: float, freedom: int, trials: int = 1) -> float:
    """Decimal logarithm of the chance of such a statistic in one of so many trials where the candidate is absent."""
    if freedom < 1:
        return 0.0
    value = float(chi2.logsf(statistic, freedom))
    if not np.isfinite(value):  # beyond the range of numbers: the leading term of the incomplete gamma function
        value = (freedom / 2 - 1) * np.log(statistic / 2) - statistic / 2 - float(gammaln(freedom / 2))
    return min(0.0, float(value / np.log(10) + np.log10(trials)))
