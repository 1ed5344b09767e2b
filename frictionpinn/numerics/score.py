"""Score test: how much would the likelihood gain if the strengths of a candidate left neutral?

Near a fit the model is linear in all that may change. With r the residuals in units of their noise and C their
derivatives in parameters, each trial's own unknowns (nuisance parameters: initial states and noisy inputs) projected
out of both, the normal equations are

    A d = -b,  A = C'C,  b = C'r,  V = C'RC,

V the covariance of b and R the autocorrelation of the noise. An estimate has the covariance A^-1 V A^-1 (sandwich).
For a candidate with columns S beside those of what is estimated already, B, take S_B = S - B (B'B)^-1 B'S. Then

    (S_B' r)' (S_B' R S_B)^-1 (S_B' r)

is chi-squared where the candidate is absent, and -(S_B' S_B)^-1 S_B' r is its step (Rao's score or Lagrange multiplier
test, robust to coloured noise).

Source: Rao, Proc. Camb. Phil. Soc. 44 (1948); White, Maximum likelihood of misspecified models, Econometrica 50 (1982).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import gammaln
from scipy.stats import chi2

from .coloured import Noise
from .resolution import averaged

SINGULAR = 1e-9  # of the largest eigenvalue: directions below are not told by the data
NOTHING = 1e-6  # of a column's squared length: what is left of it beside what is estimated is rounding
TINY = 1e-300  # keeps what is zero from being divided by


@dataclass(frozen=True)
class Rows:
    """One trial at a fit, in units of the noise; rows run over signals, then samples at the fit's resolution in time.

    Attributes:
        signals: measured signals, outputs first, then noisy inputs.
        r: model minus measurement, shape (signals, n); 0 where missing.
        change: derivatives in the parameters, shape (signals, n, parameters); 0 for inputs.
        local: derivatives in the trial's own unknowns, shape (signals, n, unknowns).
        weight: what r and derivatives in SI units were multiplied by, shape (signals, samples), see :func:`weighted`.
    """

    signals: tuple[str, ...]
    r: np.ndarray
    change: np.ndarray
    local: np.ndarray
    weight: np.ndarray


def weighted(values: np.ndarray, weight: np.ndarray, half: int) -> np.ndarray:
    """Values in SI units, shape (signals, samples, k), as rows.

    Args:
        weight: 1 / noise, 0 where nothing was measured, shape (signals, samples). With a robust loss it carries the
            square root of its weights, as in iteratively reweighted least squares.
        half: see :func:`frictionpinn.numerics.resolution.averaged`; 0: every sample is a row.
    """
    with np.errstate(over="ignore"):
        rows = np.nan_to_num(values) * weight[:, :, None]
    return averaged(np.ascontiguousarray(rows), np.ones(weight.shape), half) if half else rows


@dataclass(frozen=True)
class Columns:
    """Rows of a trial, its own unknowns projected out, in units of the noise.

    Attributes:
        own: orthonormal basis of the derivatives in the trial's own unknowns, shape (rows, unknowns).
        r: residuals, shape (rows,).
        matrix: derivatives C, shape (rows, parameters).
        spread: W with W'W = C'RC, shape (rows, parameters); C itself where the noise is white.
    """

    own: np.ndarray
    r: np.ndarray
    matrix: np.ndarray
    spread: np.ndarray

    @classmethod
    def of(cls, row: Rows, noise: Noise, known: Columns | None = None) -> Columns:
        """Scale, flatten and project: beside the own unknowns and residuals of ``known`` columns of these rows."""
        if known is None:
            r, local = (noise.scaled(row.signals, values).reshape(row.r.size, -1) for values in (row.r, row.local))
            own = basis(local)
            r = project(own, r[:, 0])
        else:
            own, r = known.own, known.r
        change = noise.scaled(row.signals, row.change)
        matrix = project(own, change.reshape(row.r.size, -1))
        spread = matrix
        if noise.coloured:
            spread = noise.spread(row.signals, matrix.reshape(change.shape)).reshape(matrix.shape)
        return cls(own, r, matrix, spread)


def basis(matrix: np.ndarray) -> np.ndarray:
    """Orthonormal basis of the columns of a matrix, those that overflow or depend on others left out."""
    with np.errstate(over="ignore", invalid="ignore"):
        matrix = matrix[:, np.isfinite((matrix**2).sum(axis=0))]
    return matrix @ inverse_root(matrix.T @ matrix)


def project(own: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """What is left of columns beside a basis."""
    return columns - own @ (own.T @ columns)


@dataclass(frozen=True)
class Score:
    """Result of a score test of k strengths.

    Attributes:
        step: one Gauss-Newton step, shape (k,), SI units.
        statistic: chi-squared where the strengths are neutral.
        freedom: its degrees of freedom.
        overflow: whether some columns hold what is no number, or numbers that are too far apart.
    """

    step: np.ndarray
    statistic: float = 0.0
    freedom: int = 0
    overflow: bool = False


@dataclass(frozen=True)
class Normal:
    """Normal equations of named columns, summed over the trials.

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
        return cls.each([names], columns)[0]

    @classmethod
    def each(cls, groups: Sequence[Sequence[str]], columns: Sequence[Columns]) -> list[Normal]:
        """Of groups of as many columns each that lie side by side."""
        b = np.asarray(sum(c.matrix.T @ c.r for c in columns)).reshape(len(groups), -1)
        A = np.asarray(sum(_squares(c.matrix, len(groups)) for c in columns))
        white = all(c.spread is c.matrix for c in columns)
        V = A if white else np.asarray(sum(_squares(c.spread, len(groups)) for c in columns))
        rr = float(sum(c.r @ c.r for c in columns))
        return [cls(tuple(names), A[k], b[k], rr, V[k]) for k, names in enumerate(groups)]

    @property
    def covariance(self) -> np.ndarray:
        """Covariance of the parameters by least squares, shape (n, n)."""
        H = inverse_root(self.A)
        return H @ (H.T @ self.V @ H) @ H.T

    def test(self, lengths: np.ndarray) -> Score:
        """Score test, where the columns are what strengths have beside all that is estimated, see :func:`beside`.

        Args:
            lengths: squared lengths of the strengths' columns before that, shape (n,). What is left below rounding
                counts as nothing, and so does a column of infinite length: one that overflows.
        """
        keep, step = self.A.diagonal() > NOTHING * np.maximum(lengths, TINY), np.zeros(len(self.b))
        b, at = self.b[keep], np.ix_(keep, keep)
        try:
            H, spread = inverse_root(self.A[at]), inverse_root(self.V[at])
        except np.linalg.LinAlgError:  # numbers that are too far apart
            return Score(step, overflow=True)
        step[keep] = -H @ (H.T @ b)
        return Score(step, float(np.sum((spread.T @ b) ** 2)), H.shape[1], bool(np.isinf(lengths).any()))


def _squares(matrix: np.ndarray, groups: int) -> np.ndarray:
    """Products of the columns of each group, shape (groups, k, k), of a matrix of shape (rows, groups * k)."""
    if groups == 1:
        return (matrix.T @ matrix)[None]
    parts = matrix.reshape(len(matrix), groups, -1)
    products = [
        [np.einsum("ng,ng->g", one, other) for one in np.moveaxis(parts, 2, 0)] for other in np.moveaxis(parts, 2, 0)
    ]
    return np.moveaxis(np.array(products), 2, 0)


def beside(known: Sequence[Columns], others: Sequence[Columns]) -> tuple[list[Columns], np.ndarray]:
    """S_B of every trial: what is left of the others' columns when those of what is known have explained what they can.

    Also (B'B)^-1 B'S, shape (known, others): what is known moves by minus that for a unit of the others. ``r`` is left
    as it is: S_B is orthogonal to what they explain of it.
    """
    A = np.asarray(sum(B.matrix.T @ B.matrix for B in known))
    along = solve(A, np.asarray(sum(B.matrix.T @ S.matrix for B, S in zip(known, others, strict=True))))
    result = []
    for B, S in zip(known, others, strict=True):
        left = S.matrix - B.matrix @ along
        white = S.spread is S.matrix
        result.append(replace(S, matrix=left, spread=left if white else S.spread - B.spread @ along))
    return result, along


def inverse_root(A: np.ndarray) -> np.ndarray:
    """H with HH' = A^-1 in the directions that the data tell, for a positive matrix of shape (n, n): (n, rank)."""
    size = 1 / np.sqrt(np.maximum(A.diagonal(), TINY))
    values, vectors = np.linalg.eigh(A * size[:, None] * size)
    keep = values > SINGULAR * values.max(initial=TINY)
    return size[:, None] * vectors[:, keep] / np.sqrt(values[keep])


def solve(A: np.ndarray, right: np.ndarray) -> np.ndarray:
    """A^-1 right for a positive matrix, in the directions that the data tell."""
    H = inverse_root(A)
    return H @ (H.T @ right)


def log_p(statistic: float, freedom: int, trials: int = 1) -> float:
    """Decimal logarithm of the chance of such a statistic in one of so many trials where the candidate is absent."""
    if freedom < 1:
        return 0.0
    value = float(chi2.logsf(statistic, freedom))
    if not np.isfinite(value):  # beyond the range of numbers: the leading term of the incomplete gamma function
        value = (freedom / 2 - 1) * np.log(statistic / 2) - statistic / 2 - float(gammaln(freedom / 2))
    return min(0.0, float(value / np.log(10) + np.log10(trials)))
