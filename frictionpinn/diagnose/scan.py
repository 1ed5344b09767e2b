"""One pass over all candidates at a fit: the score test of each, at every value of its hidden parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..identify.linear import Rows
from ..identify.problem import in_parallel
from ..numerics.tangent import Tangent
from .bench import Bench
from .candidates import Candidate
from .fit import Fit
from .noise import Noise, fit_noise
from .remainder import BUMPS, Remainder
from .rows import derivatives, linearise, responses, tangents
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
    rows = linearise(bench, fit, names, {**middle, **places}, probed=bool(remainders))
    noise, freedom = _noise(rows, names)
    columns = _columns(rows, noise)
    normal = Normal.of(names, columns)
    rest = normal.given(fit.names)
    tested = _tested(_Place(bench, fit, columns, rows, normal, noise, middle), options)
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


@dataclass(frozen=True)
class _Place:
    """Where candidates are tested: a fit on its bench, what its rows say, and hidden parameters of the others."""

    bench: Bench
    fit: Fit
    columns: Sequence[Columns]
    rows: Sequence[Rows]
    normal: Normal
    noise: Noise
    middle: Mapping[str, float]

    def judged(self, made: Sequence[Rows]) -> tuple[list[np.ndarray], np.ndarray, np.ndarray, list[np.ndarray]]:
        """Derivatives in strengths beside everything that is estimated, as columns S of every trial and their spread W;
        S'r and the squared lengths of the columns before what the parameters of the fit explain is taken out."""
        n, loads = len(self.fit.names), [row.r.size for row in self.rows]
        found = in_parallel(lambda k: self._projected(made[k], self.rows[k], self.columns[k]), loads)
        known = [c.matrix[:, :n] for c in self.columns]
        cross = sum(B.T @ S for B, (S, _) in zip(known, found, strict=True))
        along = solve(self.normal.A[:n, :n], np.asarray(cross))
        lengths = np.asarray(sum((S**2).sum(axis=0) for S, _ in found))
        free = in_parallel(lambda k: found[k][0] - known[k] @ along, loads)
        wide = free
        if self.noise.coloured:
            wide = [W - c.spread[:, :n] @ along for c, (_, W) in zip(self.columns, found, strict=True)]
        b = np.asarray(sum(S.T @ c.r for S, c in zip(free, self.columns, strict=True)))
        return free, b, lengths, wide

    def _projected(self, row: Rows, full: Rows, c: Columns) -> tuple[np.ndarray, np.ndarray]:
        """The trial's own unknowns projected out, and the spread."""
        S = self.noise.scaled(row.signals, row.change).reshape(row.r.size, -1)
        padded = np.zeros((c.r.size, S.shape[1]))
        padded[: len(S)] = S  # inputs come last, and do not depend on a strength
        S = project(c.own, padded)
        if not self.noise.coloured:
            return S, S
        return S, self.noise.spread(full.signals, S.reshape(*full.r.shape, -1)).reshape(S.shape)


def _tested(place: _Place, options: Sequence[Candidate]) -> list[Tested]:
    """The best point of every candidate's grid."""
    bench, fit = place.bench, place.fit
    runs = bench.simulate(fit, strict=True)
    moving = {e.name for e in bench.tested.effects if e.states or e.memory}  # their shape moves a state
    many = [
        c for c in options
        if len(c.grid) > 1 and c.effect not in moving and Tangent.answers(bench.simulator, c.strengths)
    ]  # fmt: skip
    along = tangents(bench, fit, place.middle, runs)
    found = [_best_of(place, c, c.grid, *place.judged(responses(bench, fit, c, along))) for c in many]
    left = [c for c in options if c not in many]
    best: dict[str, Tested] = {}
    for k in range(max((len(c.grid) for c in left), default=0)):
        here = [c for c in left if len(c.grid) > k]
        shape = {name: value for c in here for name, value in c.grid[k].items()}
        names = tuple(dict.fromkeys(name for c in here for name in c.strengths))
        same = runs if all(c.effect not in moving for c in here) else None
        free, b, lengths, wide = place.judged(derivatives(bench, fit, names, {**place.middle, **shape}, same))
        for c in here:
            at = [names.index(name) for name in c.strengths]
            own = [S[:, at] for S in free]
            spread = own if wide is free else [W[:, at] for W in wide]
            tested = _best_of(place, c, [c.grid[k]], own, b[at], lengths[at], spread)
            if c.name not in best or tested.statistic > best[c.name].statistic:
                best[c.name] = tested
    return [*found, *best.values()]


def _best_of(
    place: _Place,
    candidate: Candidate,
    shapes: Sequence[Mapping[str, float]],
    free: Sequence[np.ndarray],
    b: np.ndarray,
    lengths: np.ndarray,
    wide: Sequence[np.ndarray],
) -> Tested:
    """The shape that explains most, of those whose columns stand side by side in what ``_Place.judged`` returns."""
    k = len(candidate.strengths)
    A = np.asarray(sum(_squares(S, k) for S in free))
    V = A if wide is free else np.asarray(sum(_squares(W, k) for W in wide))
    tests = [
        Normal(candidate.strengths, A[j], b[j * k :][:k], place.normal.rr, V[j]).test(
            candidate.strengths, lengths[j * k :][:k]
        )
        for j in range(len(shapes))
    ]
    j = max(range(len(shapes)), key=lambda j: tests[j][0])
    statistic, rank, step = tests[j]
    trace = np.concatenate([S[:, j * k : (j + 1) * k] @ step for S in free])
    trace /= max(float(np.linalg.norm(trace)), 1e-300)
    values = dict(zip(candidate.strengths, step.tolist(), strict=True))
    chance = log_p(statistic, rank, len(candidate.grid))
    return Tested(candidate, chance, statistic, rank, values, dict(shapes[j]), trace)


def _squares(S: np.ndarray, k: int) -> np.ndarray:
    """S'S of every k columns, shape (columns / k, k, k)."""
    each = [np.ascontiguousarray(S[:, a::k]) for a in range(k)]
    return np.stack([np.stack([np.einsum("rj,rj->j", x, y) for y in each], -1) for x in each], -2)
