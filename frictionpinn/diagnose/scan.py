"""One pass over all candidates at a fit: the score test of each, at every value of its hidden parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..identify.linear import Rows
from ..identify.problem import in_parallel
from ..numerics.simulate import Simulation
from .bench import Bench
from .candidates import Candidate
from .fit import Fit
from .noise import Noise, fit_noise
from .remainder import BUMPS, Remainder
from .score import Columns, Normal, log_p, project, solve


@dataclass(frozen=True)
class Tested:
    """A candidate at a fit.

    Attributes:
        candidate: what was tested.
        log_p: decimal logarithm of the chance of such a statistic where the candidate is absent, all values tried
            counted.
        statistic: chi-squared where the candidate is absent.
        freedom: its degrees of freedom.
        step: strength -> value that one Gauss-Newton step gives, SI units.
        shape: hidden parameter -> value, of those tried the one that explains most.
        trace: the part of its derivatives that nothing else explains, shape (rows of all trials,), at unit length.
        beside: values of all parameters beside which it was tested, where these are not the fit's.
    """

    candidate: Candidate
    log_p: float
    statistic: float
    freedom: int
    step: dict[str, float]
    shape: dict[str, float]
    trace: np.ndarray
    beside: Mapping[str, float] | None = None


@dataclass(frozen=True)
class Remaining:
    """How much a force or a friction that depends on one variable would explain.

    Attributes:
        variable: it, see :func:`frictionpinn.diagnose.remainder.variables`.
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
    rows = bench.linearise(fit, names, {**middle, **places}, probed=bool(remainders))
    noise, freedom = _noise(rows, names)
    columns = _columns(rows, noise)
    normal = Normal.of(names, columns)
    rest = normal.given(fit.names)
    tested = _tested(bench, fit, options, columns, rows, normal, noise, middle)
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


def _tested(
    bench: Bench,
    fit: Fit,
    options: Sequence[Candidate],
    columns: Sequence[Columns],
    rows: Sequence[Rows],
    normal: Normal,
    noise: Noise,
    middle: Mapping[str, float],
) -> list[Tested]:
    """The best point of every candidate's grid."""
    n = len(fit.names)
    known = [c.matrix[:, :n] for c in columns]
    inner = normal.A[:n, :n]
    best: dict[str, Tested] = {}
    runs = bench.simulate(fit, strict=True)
    moving = {e.name for e in bench.tested.effects if e.states or e.memory}  # their shape moves a state
    for k in range(max((len(c.grid) for c in options), default=0)):
        here = [c for c in options if len(c.grid) > k and (len(c.grid) > 1 or k == 0)]
        shape = {name: value for c in here for name, value in c.grid[k].items()}
        names = tuple(dict.fromkeys(name for c in here for name in c.strengths))
        still = [c for c in here if c.effect not in moving]
        made = _pass(
            bench, fit, names, {**middle, **shape}, columns, rows, noise, runs if len(still) == len(here) else None
        )
        A = sum(S.T @ S for S, _ in made)
        cross = sum(B.T @ S for B, (S, _) in zip(known, made, strict=True))
        along = solve(inner, np.asarray(cross))
        free = [S - B @ along for B, (S, _) in zip(known, made, strict=True)]  # beside what is estimated already
        wide = [W - c.spread[:, :n] @ along for c, (_, W) in zip(columns, made, strict=True)]
        b = np.asarray(sum(S.T @ c.r for S, c in zip(free, columns, strict=True)))
        V = np.asarray(sum(W.T @ W for W in wide))
        rest = Normal(names, np.asarray(sum(S.T @ S for S in free)), b, normal.rr, V)
        lengths = np.asarray(A).diagonal()
        for c in here:
            at = rest.places(c.strengths)
            statistic, rank, step = rest.test(c.strengths, lengths[at])
            chance = log_p(statistic, rank, len(c.grid))
            if c.name not in best or statistic > best[c.name].statistic:
                trace = np.concatenate([S[:, at] @ step for S in free])
                trace /= max(float(np.linalg.norm(trace)), 1e-300)
                values = dict(zip(c.strengths, step.tolist(), strict=True))
                best[c.name] = Tested(c, chance, statistic, rank, values, dict(c.grid[k]), trace)
    return list(best.values())


def _pass(
    bench: Bench,
    fit: Fit,
    names: Sequence[str],
    values: Mapping[str, float],
    columns: Sequence[Columns],
    whole: Sequence[Rows],
    noise: Noise,
    runs: Sequence[Simulation] | None,
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Derivatives in the strengths at these hidden parameters, the trials' own unknowns projected out, and spread."""
    rows = bench.derivatives(fit, names, values, runs)
    result = []
    for row, full, c in zip(rows, whole, columns, strict=True):
        S = noise.scaled(row.signals, row.change).reshape(row.r.size, -1)
        padded = np.zeros((c.r.size, S.shape[1]))
        padded[: len(S)] = S  # inputs come last, and do not depend on a strength
        S = project(c.own, padded)
        W = S
        if noise.coloured:
            shape = (*full.r.shape, S.shape[1])
            W = noise.spread(full.signals, S.reshape(shape)).reshape(S.shape)
        result.append((S, W))
    return result
