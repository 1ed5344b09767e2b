"""One pass over all candidates at a fit: the score test of each, at every value of its hidden parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..numerics.parallel import in_parallel
from .bench import Bench
from .candidates import BUMPS, Candidate, Remainder
from .fit import Fit
from .linear import Rows
from .noise import Noise, fit_noise
from .overflow import limit, overflowing, sizes, without
from .points import Place, Tested, test_all
from .rows import linearise
from .score import Columns, Normal, log_p, solve

__all__ = ["Remaining", "Scanned", "Tested", "scan"]


@dataclass(frozen=True)
class Remaining:
    """How much a force or a friction that depends on one variable would explain.

    Attributes:
        variable: it, see :func:`frictionpinn.diagnose.candidates.remainders`.
        kind: "force" or "friction".
        log_p, statistic, freedom: as of a candidate.
        coefficients: of the bumps, one Gauss-Newton step, shape (BUMPS,).
        errors: their covariance, shape (BUMPS, BUMPS).
    """

    variable: str
    kind: str
    log_p: float
    statistic: float
    freedom: int
    coefficients: np.ndarray
    errors: np.ndarray

    @property
    def names(self) -> tuple[str, ...]:
        """Strengths of its bumps."""
        return tuple(f"{self.kind}_{self.variable}_{k}" for k in range(BUMPS))


@dataclass(frozen=True)
class Scanned:
    """Everything that a pass found.

    Attributes:
        tested: candidates, the most significant first.
        remaining: variables, the most significant first.
        noise: of every signal.
        residual: sum of squares in units of white noise, and its degrees of freedom.
        known: normal equations of what is estimated already.
        sigmas: noise of every signal, SI units.
    """

    tested: tuple[Tested, ...]
    remaining: tuple[Remaining, ...]
    noise: Noise
    residual: tuple[float, float]
    known: Normal
    sigmas: dict[str, float]


def scan(
    bench: Bench,
    fit: Fit,
    options: Sequence[Candidate],
    remainders: Sequence[Remainder],
    places: Mapping[str, float],
) -> Scanned:
    """Score tests of every candidate and every variable at a fit.

    Args:
        options: candidates that are not part of the fit.
        remainders: of the tested mechanism; may be empty.
        places: hidden parameters of the remainders.
    """
    strengths = tuple(dict.fromkeys(name for c in options for name in c.strengths))
    unknown = tuple(name for r in remainders for names in _groups(r).values() for name in names)
    middle = {name: value for c in options for name, value in c.grid[len(c.grid) // 2].items()}
    names = (*fit.names, *strengths, *unknown)
    rows = linearise(bench, fit, names, {**middle, **places}, probed=bool(remainders))
    wild = overflowing(rows, sizes(bench, bench.probe.mechanism.parameters, names), limit(bench, fit))
    rows = without(rows, wild)
    noise, freedom = _noise(rows, names)
    columns = _columns(rows, noise)
    normal = Normal.of(names, columns)
    rest = normal.given(fit.names)
    tested = test_all(Place(bench, fit, columns, rows, normal, noise, middle), options)
    found = []
    for r in remainders:
        for kind, group in _groups(r).items():
            statistic, rank, step = rest.test(group, _lengths(normal, group))
            at = rest.places(group)
            errors = np.linalg.pinv(rest.A[np.ix_(at, at)], rcond=1e-9, hermitian=True)
            found.append(Remaining(r.variable, kind, log_p(statistic, rank), statistic, rank, step, errors))
    n = len(fit.names)
    known = Normal(fit.names, normal.A[:n, :n], normal.b[:n], normal.rr, normal.V[:n, :n])
    return Scanned(
        tuple(sorted(tested, key=lambda t: t.log_p)),
        tuple(sorted(found, key=lambda m: m.log_p)),
        noise,
        (rest.rr, freedom - len(fit.names)),
        known,
        {name: sigma * noise.level.get(name, 1.0) for name, sigma in fit.sigmas.items()},
    )


def _groups(remainder: Remainder) -> dict[str, tuple[str, ...]]:
    return {key: tuple(f"{key}_{remainder.variable}_{k}" for k in range(BUMPS)) for key in ("force", "friction")}


def _lengths(normal: Normal, names: Sequence[str]) -> np.ndarray:
    return normal.A.diagonal()[normal.places(names)]


def _columns(rows: Sequence[Rows], noise: Noise | None) -> list[Columns]:
    return in_parallel(lambda k: Columns.of(rows[k], noise), [row.r.size for row in rows])


def _noise(rows: Sequence[Rows], names: Sequence[str]) -> tuple[Noise, float]:
    """Noise of what is left when every candidate and variable has explained what it can; samples free to vary."""
    columns = _columns(rows, None)
    normal = Normal.of(names, columns)
    step = solve(normal.A, normal.b)
    residuals = [
        (c.r - c.matrix @ step).reshape(row.r.shape) for row, c in zip(rows, columns, strict=True)
    ]  # fmt: skip
    count = sum(int(np.count_nonzero(row.r)) for row in rows)
    local = sum(c.own.shape[1] for c in columns)
    return fit_noise(rows, residuals, 1 - (local + len(names)) / count), count - local
