"""One pass over all candidates at a fit: the score test of each, at every value of its hidden parameters.

1. The fit is linearised in all that is estimated, and in every candidate and every force and friction that depends on
   one variable in any way.
2. What is left when all of these have explained what they can tells the noise of every signal and its colour.
3. Each candidate's columns at each point of its grid are tested beside what is estimated: the best point counts.
4. So are the columns of forces and frictions that depend on a variable.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..numerics.coloured import Noise, fit_noise
from ..numerics.parallel import in_parallel
from ..numerics.resolution import samples_within
from ..numerics.score import SINGULAR, TINY, Columns, Normal, Rows, Score, beside, log_p, solve, weighted
from ..numerics.simulate import ContactLost, Simulation, SimulationFailed
from ..numerics.tangent import Tangent
from ..physics.remainder import BUMPS
from .bench import Bench
from .candidates import Candidate
from .fit import Fit
from .linearise import linearise

GUESS = 0.1  # of its usual size: a strength whose step no derivative tells
TOGETHER = 24  # columns of a candidate's grid that are tested at once: a budget of memory
BEYOND = 1e8  # times the range of the signals: squares of such columns and of others have no common digits


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
        moves: estimated parameter -> how far it goes along with that step.
        shape: hidden parameter -> value, of those tried the one that explains most.
        trace: the part of its derivatives that nothing else explains, shape (rows of all trials,), at unit length.
        untested: it could not be tested, since its derivatives overflow: simulated forward, an unstable motion makes of
            a tiny strength more than numbers hold. Its step is a guess then.
        width: resolution in time at which it was tested, s; 0: sample by sample.
    """

    candidate: Candidate
    log_p: float
    statistic: float
    freedom: int
    step: dict[str, float]
    moves: dict[str, float]
    shape: dict[str, float]
    trace: np.ndarray
    untested: bool = False
    width: float = 0.0


@dataclass(frozen=True)
class Remaining:
    """How much a force or a friction that depends on one variable would explain.

    Attributes:
        variable: it, see :func:`frictionpinn.physics.remainder.remainders`.
        kind: "force" or "friction".
        log_p: as of a candidate.
        coefficients: of the bumps, one Gauss-Newton step, shape (BUMPS,).
        errors: their covariance, shape (BUMPS, BUMPS).
        names: strengths of its bumps.
    """

    variable: str
    kind: str
    log_p: float
    coefficients: np.ndarray
    errors: np.ndarray
    names: tuple[str, ...]


@dataclass(frozen=True)
class Scanned:
    """Everything that a pass found.

    Attributes:
        tested: candidates, the most significant first.
        remaining: variables, the most significant first.
        noise: of every signal.
        known: normal equations of what is estimated already.
        sigmas: noise of every signal, SI units.
    """

    tested: tuple[Tested, ...]
    remaining: tuple[Remaining, ...]
    noise: Noise
    known: Normal
    sigmas: dict[str, float]


def scan(bench: Bench, fit: Fit, options: Sequence[Candidate]) -> Scanned:
    """Score tests of every variable at a fit, and of candidates that are not part of it, the ``options``."""
    middle = {name: value for c in options for name, value in c.grid[len(c.grid) // 2].items()}
    fit = replace(fit, values=fit.values | middle)
    strengths = dict.fromkeys(name for c in options for name in c.strengths)
    probed = bench.probe.mechanism
    shapes = bench.remainders.items()
    variables = [(name, *own) for name, r in shapes for own in r.groups(probed.system, probed.law).items()]
    bumps = [name for *_, own in variables for name in own]
    names = (*fit.names, *strengths, *bumps)
    rows = linearise(bench, fit, names)
    sizes = {par.name: bench.sizes.of(par) for par in probed.parameters if par.name in names}
    wild = _overflowing(fit, [row.change for row in rows], [sizes[name] for name in names])
    finite = [replace(row, change=np.where(wild, 0.0, row.change)) for row in rows] if wild.any() else rows
    noise = _noise(finite)
    estimated = [replace(row, change=row.change[:, :, : len(fit.names)]) for row in finite]
    known = in_parallel(lambda k: Columns.of(estimated[k], noise), [row.r.size for row in rows])
    runs = bench.simulate(fit, strict=True)
    place = _Place(bench, fit, names, rows, known, noise, sizes, runs)

    tested = in_parallel(lambda k: place.test(options[k]), [len(c.grid) for c in options], "effects tested")
    left, _, lengths = place.left(place.at_hand(bumps), bumps)
    remaining = []
    normals = Normal.each([own for *_, own in variables], left) if variables else []
    for (variable, kind, own), normal, length in zip(variables, normals, lengths.reshape(-1, BUMPS), strict=True):
        score, errors = normal.test(length), np.linalg.pinv(normal.A, rcond=SINGULAR, hermitian=True)
        remaining.append(Remaining(variable, kind, log_p(score.statistic, score.freedom), score.step, errors, own))
    return Scanned(
        tuple(sorted(tested, key=lambda t: t.log_p)),
        tuple(sorted(remaining, key=lambda m: m.log_p)),
        noise,
        Normal.of(fit.names, known),
        {name: sigma * noise.level.get(name, 1.0) for name, sigma in fit.sigmas.items()},
    )


def _overflowing(fit: Fit, changes: Sequence[np.ndarray], sizes: Sequence[float]) -> np.ndarray:
    """Mask of columns that are no numbers, or change a signal by too much at usual sizes of their parameters.

    Args:
        changes: rows of every trial, shape (signals, n, columns).
        sizes: of the columns' parameters, SI units, shape (columns,).
    """
    most, wild = BEYOND, np.zeros(len(sizes), bool)
    for model in fit.models:
        for name, y in zip(model.outputs, model.y, strict=True):
            if not np.isnan(y).all():
                most = max(most, BEYOND * float(np.nanmax(y) - np.nanmin(y)) / fit.sigmas[name])
    for change in changes:
        with np.errstate(over="ignore", invalid="ignore"):
            wild |= ~(np.abs(change).max(axis=(0, 1), initial=0.0) * np.asarray(sizes) <= most)
    return wild


def _noise(rows: Sequence[Rows]) -> Noise:
    """Noise of what is left when every candidate and variable has explained what it can.

    That of the fit, white, where these are more than half as many as the rows: so little is left that it tells nothing.
    """
    columns = in_parallel(lambda k: Columns.of(rows[k], Noise()), [row.r.size for row in rows])
    normal = Normal.of((), columns)
    step = solve(normal.A, normal.b)
    left = [(c.r - c.matrix @ step).reshape(row.r.shape) for row, c in zip(rows, columns, strict=True)]
    residuals = [dict(zip(row.signals, r, strict=True)) for row, r in zip(rows, left, strict=True)]
    count = sum(int(np.count_nonzero(row.r)) for row in rows)
    explained = len(step) + sum(c.own.shape[1] for c in columns)
    return fit_noise(residuals, 1 - explained / count) if 2 * explained < count else Noise()


@dataclass(frozen=True)
class _Place:
    """Where candidates are tested.

    Attributes:
        fit: with the hidden parameters of all candidates at the middle of their grids.
        names: parameters of ``rows``.
        rows, known: of every trial, in all parameters and in the estimated ones.
        sizes: usual sizes of parameters, SI units.
        runs: strict simulations of every trial.
    """

    bench: Bench
    fit: Fit
    names: tuple[str, ...]
    rows: Sequence[Rows]
    known: Sequence[Columns]
    noise: Noise
    sizes: Mapping[str, float]
    runs: Sequence[Simulation]

    def test(self, c: Candidate) -> Tested:
        """A candidate at the point of its grid where it explains most."""
        changes = self.at_hand(c.strengths) if len(c.grid) == 1 else self.on_grid(c)
        k, overflow, shape, trace = len(c.strengths), False, dict[str, float](), np.zeros(0)
        best, moved = Score(np.zeros(k), -1.0), np.zeros(len(self.fit.names))
        at_once = max(TOGETHER // k, 1)
        for first in range(0, len(c.grid), at_once):
            points = c.grid[first : first + at_once]
            some = [change[:, :, first * k : (first + at_once) * k] for change in changes]
            left, along, lengths = self.left(some, c.strengths * len(points))
            at = np.arange(len(lengths)).reshape(len(points), -1)
            for own, normal, point in zip(at, Normal.each([c.strengths] * len(at), left), points, strict=True):
                score = normal.test(lengths[own])
                overflow |= score.overflow
                if score.statistic > best.statistic:
                    best, shape, moved = score, dict(point), -along[:, own] @ score.step
                    trace = np.concatenate([x.matrix[:, own] @ score.step for x in left])
        if best.freedom == 0 and overflow:
            guess = {name: GUESS * self.sizes[name] for name in c.strengths}
            return Tested(c, 0.0, 0.0, 0, guess, {}, shape, 0.0 * trace, untested=True, width=self.fit.width)
        trace = trace / max(float(np.linalg.norm(trace)), TINY)
        step = dict(zip(c.strengths, best.step.tolist(), strict=True))
        moves = dict(zip(self.fit.names, moved.tolist(), strict=True))
        chance = log_p(best.statistic, best.freedom, len(c.grid))
        return Tested(c, chance, best.statistic, best.freedom, step, moves, shape, trace, width=self.fit.width)

    def at_hand(self, names: Sequence[str]) -> list[np.ndarray]:
        """Rows of every trial in some of the parameters, at the middle of the grids."""
        at = [self.names.index(name) for name in names]
        return [row.change[:, :, at] for row in self.rows]

    def on_grid(self, c: Candidate) -> list[np.ndarray]:
        """Rows of every trial in a candidate's strengths at every point of its grid, the strengths side by side.

        Where the shape of an effect leaves the motion as it is, all points share one set of linear equations. The
        others are simulated; infinite where that fails.
        """
        simulator, fit = self.bench.simulator, self.fit
        moving = any(e.name == c.effect and (e.states or e.memory) for e in self.bench.tested.effects)
        linear = not moving and Tangent.answers(simulator, c.strengths)

        def simulated(k: int, shape: Mapping[str, float]) -> np.ndarray:
            model, p = replace(fit.models[k], simulator=simulator), fit.values | dict(shape)
            try:
                run = model.simulate(p, fit.locals[k], c.strengths, ran=None if moving else self.runs[k])
            except (SimulationFailed, ContactLost):
                return np.full((*model.y.shape, len(c.strengths)), np.inf)
            return model.derivatives(run, p, c.strengths)[:, :, : len(c.strengths)]

        def work(k: int) -> np.ndarray:
            model, row = fit.models[k], self.rows[k]
            if linear:
                steady = [z for z in simulator.bristles if z not in model.start]
                path = model.path(fit.locals[k], fit.values)
                tangent = Tangent(simulator, self.runs[k], path, fit.values, steady=steady)
                changes = tangent.respond(c.strengths, c.grid, contact=False)
                J = np.stack([changes[name] for name in model.outputs])
            else:
                J = np.concatenate([simulated(k, shape) for shape in c.grid], axis=2)
            rows = weighted(J, row.weight[: len(J)], samples_within(model.t, fit.width))
            return np.pad(rows, ((0, len(row.signals) - len(J)), (0, 0), (0, 0)))  # inputs depend on no strength

        return in_parallel(work, [row.r.size for row in self.rows])

    def left(self, changes: Sequence[np.ndarray], names: Sequence[str]) -> tuple[list[Columns], np.ndarray, np.ndarray]:
        """Columns beside what is estimated, what they take of that, and their squared lengths before.

        See :func:`frictionpinn.numerics.score.beside`. Those that overflow have infinite length.

        Args:
            changes: rows of every trial, shape (signals, n, columns).
            names: the columns' parameters.
        """
        wild = _overflowing(self.fit, changes, [self.sizes[name] for name in names])

        def work(k: int) -> Columns:
            row = replace(self.rows[k], change=np.where(wild, 0.0, changes[k]))
            return Columns.of(row, self.noise, self.known[k])

        columns = in_parallel(work, [row.r.size for row in self.rows])
        lengths = np.asarray(sum((c.matrix**2).sum(axis=0) for c in columns))
        return *beside(self.known, columns), np.where(wild, np.inf, lengths)
