"""Score tests of candidates at a fit, each at every point of its grid of hidden parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..numerics.parallel import in_parallel
from ..numerics.simulate import ContactLost, Simulation, SimulationFailed
from ..numerics.tangent import Tangent
from .bench import Bench
from .candidates import Candidate
from .fit import Fit
from .linear import Rows
from .noise import Noise
from .overflow import limit, overflowing, sizes, without
from .rows import derivatives, responses, tangents
from .score import Columns, Normal, log_p, project, solve

GUESS = 0.1  # of its usual size: a strength whose step no derivative tells


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
        short: values of all parameters of its fit over short windows, where it was tested over these.
        untested: it could not be tested, since its derivatives overflow; its step is a guess then.
    """

    candidate: Candidate
    log_p: float
    statistic: float
    freedom: int
    step: dict[str, float]
    shape: dict[str, float]
    trace: np.ndarray
    beside: Mapping[str, float] | None = None
    short: Mapping[str, float] | None = None
    untested: bool = False


@dataclass(frozen=True)
class Place:
    """Where candidates are tested: a fit on its bench, what its rows say, and hidden parameters of the others."""

    bench: Bench
    fit: Fit
    columns: Sequence[Columns]
    rows: Sequence[Rows]
    normal: Normal
    noise: Noise
    middle: Mapping[str, float]

    @cached_property
    def moving(self) -> set[str]:
        """Effects whose shape moves a state."""
        return {e.name for e in self.bench.tested.effects if e.states or e.memory}

    @cached_property
    def most(self) -> float:
        """See :func:`frictionpinn.diagnose.overflow.limit`."""
        return limit(self.bench, self.fit)

    def judged(
        self, made: Sequence[Rows], names: Sequence[str]
    ) -> tuple[list[np.ndarray], np.ndarray, np.ndarray, list[np.ndarray]]:
        """Derivatives in strengths beside everything that is estimated, as columns S of every trial and their spread W;
        S'r and the squared lengths of the columns before what the parameters of the fit explain is taken out: infinite
        of those that overflow, which count as nothing. ``names`` are the columns' strengths, again and again."""
        usual = sizes(self.bench, self.bench.tested.parameters, names)
        wild = overflowing(made, np.tile(usual, made[0].change.shape[-1] // len(usual)), self.most)
        made = without(made, wild)
        n, loads = len(self.fit.names), [row.r.size for row in self.rows]
        found = in_parallel(lambda k: self._projected(made[k], self.rows[k], self.columns[k]), loads)
        known = [c.matrix[:, :n] for c in self.columns]
        cross = sum(B.T @ S for B, (S, _) in zip(known, found, strict=True))
        along = solve(self.normal.A[:n, :n], np.asarray(cross))
        lengths = np.where(wild, np.inf, np.asarray(sum((S**2).sum(axis=0) for S, _ in found)))
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


def test_all(place: Place, options: Sequence[Candidate]) -> list[Tested]:
    """The best point of every candidate's grid."""
    bench, fit = place.bench, place.fit
    runs = bench.simulate(fit, strict=True)
    many = [
        c for c in options
        if len(c.grid) > 1 and c.effect not in place.moving and Tangent.answers(bench.simulator, c.strengths)
    ]  # fmt: skip
    along = tangents(bench, fit, place.middle, runs)
    found = in_parallel(
        lambda k: _best_of(
            place, many[k], many[k].grid, *place.judged(responses(bench, fit, many[k], along), many[k].strengths)
        ),
        [len(c.grid) * len(c.strengths) for c in many],
    )
    left = [c for c in options if c not in many]
    points = max((len(c.grid) for c in left), default=0)
    best: dict[str, Tested] = {}
    for made in in_parallel(lambda k: _at_point(place, left, k, runs), [1.0] * points):
        for tested in made:
            known = best.get(tested.candidate.name)
            if known is None or (known.untested, -known.statistic) > (tested.untested, -tested.statistic):
                best[tested.candidate.name] = tested
    return [*found, *best.values()]


def _at_point(place: Place, options: Sequence[Candidate], k: int, runs: Sequence[Simulation]) -> list[Tested]:
    """The candidates whose grid has a point k, there; ``runs`` are the fit's strict simulations."""
    here = [c for c in options if len(c.grid) > k]
    shape = {name: value for c in here for name, value in c.grid[k].items()}
    names = tuple(dict.fromkeys(name for c in here for name in c.strengths))
    same = None if any(c.effect in place.moving for c in here) else runs
    try:
        made = derivatives(place.bench, place.fit, names, {**place.middle, **shape}, same)
    except (SimulationFailed, ContactLost):
        return [_untested(place, c, c.grid[k]) for c in here]
    free, b, lengths, wide = place.judged(made, names)
    found = []
    for c in here:
        at = [names.index(name) for name in c.strengths]
        own = [S[:, at] for S in free]
        spread = own if wide is free else [W[:, at] for W in wide]
        found.append(_best_of(place, c, [c.grid[k]], own, b[at], lengths[at], spread))
    return found


def _best_of(
    place: Place,
    candidate: Candidate,
    shapes: Sequence[Mapping[str, float]],
    free: Sequence[np.ndarray],
    b: np.ndarray,
    lengths: np.ndarray,
    wide: Sequence[np.ndarray],
) -> Tested:
    """The shape that explains most, of those whose columns stand side by side in what ``Place.judged`` returns."""
    k = len(candidate.strengths)
    A = np.asarray(sum(_squares(S, k) for S in free))
    V = A if wide is free else np.asarray(sum(_squares(W, k) for W in wide))
    tests = []
    for j in range(len(shapes)):
        part = slice(j * k, (j + 1) * k)
        normal = Normal(candidate.strengths, A[j], b[part], place.normal.rr, V[j])
        try:
            tests.append(normal.test(candidate.strengths, lengths[part]))
        except np.linalg.LinAlgError:  # numbers that are too far apart
            lengths[part] = np.inf
            tests.append((0.0, 0, np.zeros(k)))
    j = max(range(len(shapes)), key=lambda j: tests[j][0])
    statistic, rank, step = tests[j]
    if rank == 0 and np.isinf(lengths).any():
        return _untested(place, candidate, shapes[j])
    trace = np.concatenate([S[:, j * k : (j + 1) * k] @ step for S in free])
    trace /= max(float(np.linalg.norm(trace)), 1e-300)
    values = dict(zip(candidate.strengths, step.tolist(), strict=True))
    chance = log_p(statistic, rank, len(candidate.grid))
    return Tested(candidate, chance, statistic, rank, values, dict(shapes[j]), trace)


def _untested(place: Place, candidate: Candidate, shape: Mapping[str, float]) -> Tested:
    """A candidate whose derivatives overflow: its step is a tenth of its usual size."""
    usual = sizes(place.bench, place.bench.tested.parameters, candidate.strengths)
    step = dict(zip(candidate.strengths, (GUESS * usual).tolist(), strict=True))
    trace = np.zeros(sum(len(c.r) for c in place.columns))
    return Tested(candidate, 0.0, 0.0, 0, step, dict(shape), trace, untested=True)


def _squares(S: np.ndarray, k: int) -> np.ndarray:
    """S'S of every k columns, shape (columns / k, k, k)."""
    each = [np.ascontiguousarray(S[:, a::k]) for a in range(k)]
    return np.stack([np.stack([np.einsum("rj,rj->j", x, y) for y in each], -1) for x in each], -2)
