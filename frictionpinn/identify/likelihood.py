"""Maximum likelihood on simulated trajectories, noisy inputs estimated with the parameters.

Two things make this likelihood rugged. Errors add up over a trial: a static friction a little off moves a stop, and all
that follows is another motion. And what is sampled jumps: a stop one sample late costs the whole jump of the
acceleration, and a small change of the parameters changes nothing. So the search goes

1. over short windows, each begun anew from what was measured, at a coarse resolution in time: a design over what the
   sliding samples do not tell, the best refined (:func:`find_start`);
2. over whole trials, noisy inputs among the unknowns, from that resolution to the single sample, each minimum the start
   of the next (:func:`coarse_to_fine`); at the sample alone, which shows how fast a contact rings (:func:`_ringing`);
   and back and down again (:func:`cycled`);
3. at the noise levels that the residuals show, until these settle.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..data.recording import Recording
from ..errors import UserError
from ..numerics.parallel import in_parallel
from ..numerics.simulate import ContactLost, SimulationFailed
from ..numerics.whiteness import SIGNIFICANCE, whiteness
from ..physics.mechanism import Mechanism
from .assemble import estimated_sigmas, failed, finish
from .descent import FINE, coarse_to_fine, cycled, resolutions
from .minima import neighbours, returned
from .problem import Problem
from .result import Estimate
from .solve import Evaluate, Solution, State, levenberg_marquardt
from .start import coarse_design, ridge_grid, search
from .trial import TrialModel

MOST_WINDOWS = 80  # that the search for a start simulates
RIVAL = 15.0  # log-likelihood: a start that is worse by more is not tried on the whole trials
NEAR = 4.0  # log-likelihood at the coarsest resolution: another start that is as near is followed as well
STIFFNESSES, NEXT = (0.5, 2.0), 3  # times that of the fit; resolutions next to the sample from which they are followed
ELSEWHERE = 0.1  # in log u: starts that are closer are the same
ROUGH: dict[str, Any] = {
    "rtol": 1e-4,
    "atol": 1e-5,
}  # tolerances over windows: errors of 1e-5 m/s are far below any noise
REACH = 2.0  # times the largest friction force: how far from zero the initial bristle force may be
MISFIT = 20.0  # times the noise by differences: residuals over windows that are larger set the level
GIVEN = "as given"  # a start that is fitted even where it looks poor over windows
NOISE_ROUNDS, SETTLED = 4, 0.01  # rounds of noise estimation at most; relative change that ends them

Found = tuple[Solution, tuple[TrialModel, ...]]  # where a search ended, and the models of the trials there


def windows_of(problem: Problem) -> tuple[TrialModel, ...]:
    """The trials in windows that each hold one stretch of low speed."""
    mu_c = (problem.fixed | problem.start).get("mu_c")
    windows = [window for motion in problem.motions for window in motion.windows(mu_c)]
    if len(windows) > MOST_WINDOWS:  # enough for a start, however long the recording
        chosen = np.random.default_rng(0).choice(len(windows), MOST_WINDOWS, replace=False)
        windows = [windows[k] for k in sorted(chosen)]
    return tuple(windows)


def find_start(
    problem: Problem, given: Mapping[str, float] | None = None, asis: bool = True, width: float | None = None
) -> list[Solution]:
    """Fits over short windows to start whole trials from, best first; ``given`` is tried beside the search's, refined
    and, with ``asis``, as it is. ``width`` is the resolution in time, s; by default the coarsest."""
    windows = windows_of(problem)
    locals_ = [model.local for model in windows]
    space, width = problem.space, resolutions(problem)[0] if width is None else width

    def evaluator(which: Sequence[int]) -> Evaluate:
        return problem.evaluator([windows[k] for k in which], joint=False, width=width, **ROUGH)

    own = []
    if given is not None:
        p = np.array([(problem.start | dict(given))[name] for name in space.names], dtype=float)
        own = search(evaluator, space, locals_, [p], 1, iterations=20, decrease=0.3)
        there = evaluator(range(len(windows)))(space.to_search(p), locals_, False) if asis else None
        if there is not None:  # the inputs' noise may lead the refinement astray: the start itself is tried too
            own.append(Solution(there, 0, 1, GIVEN))
    points = coarse_design(space, problem.start, problem.scales, problem.fixed, problem.shapes)
    found = search(evaluator, space, locals_, points, 2, iterations=6, decrease=2.0)
    grid = ridge_grid(space, space.to_values(found[0].state.u), problem.fixed) if found else []
    if grid:
        found += search(evaluator, space, found[0].state.locals, grid, 2, iterations=15, decrease=0.3)
    return sorted([*own, *found], key=lambda solution: solution.state.cost)


def first_sigmas(problem: Problem, state: State) -> dict[str, float]:
    """Noise levels to begin the whole trials with: those of the residuals over windows where these are far larger.

    Differences see nothing of filtered noise or of what a model lacks, and the search would weigh signals by that.
    """
    result = dict(problem.sigmas)
    for name in set(problem.channels.outputs) - set(problem.given):
        r = np.concatenate([piece.residuals[name] for piece in state.pieces])
        r = r[~np.isnan(r)]
        level = problem.loss.sigma(r, len(r)) if len(r) else 0.0
        result[name] = level if level > MISFIT * result[name] else result[name]
    return result


def with_bristle(problem: Problem, u: np.ndarray) -> tuple[TrialModel, ...]:
    """Trial models whose initial bristle force starts in equilibrium at these parameters."""
    p, result = problem.values(u), []
    for model in problem.trials:
        if "z" not in model.states:
            result.append(model)
            continue
        start = {name: value for name, value in model.start.items() if name != "z"}
        steady = replace(model, states=(), start=start, inputs=(), base=model.path(model.local), directions=None)
        run = steady.simulate(p, np.zeros(0))
        if "sigma_0" in p:
            z, largest = float(run.z[0]) * p["sigma_0"], float(np.abs(run.F).max())
        else:
            z, largest = float(run.z[0]), float(np.abs(run.z).max())
        result.append(replace(model, start=model.start | {"z": z}, force_scale=REACH * largest or 1.0))
    return tuple(result)


def _alike(start: State, other: State) -> bool:
    """Whether two starts are the same, as far as the windows tell."""
    return bool(np.abs(start.u - other.u).max() < ELSEWHERE or (other.curved and returned(other)(start)))


def _whole(
    problem: Problem, starts: Sequence[Solution], sigmas: Mapping[str, float], known: Found | None
) -> Found | None:
    """Fit the whole trials from the starts at the coarsest resolution, and from the best of these down to the sample.

    Another is followed, too, where it is about as good there but elsewhere. ``known`` is returned where it is better.
    """
    widths, begun = resolutions(problem), []
    distinct: list[Solution] = []
    for start in starts:
        poor = start.state.cost > starts[0].state.cost + RIVAL and start.reason != GIVEN
        if poor or any(_alike(start.state, other.state) for other in distinct):
            continue
        distinct.append(start)
        try:
            models = with_bristle(problem, start.state.u)
        except (ContactLost, SimulationFailed):
            continue
        locals_ = tuple(model.local[: model.size(problem.joint)] for model in models)
        begin = State(start.state.u, locals_, ())
        found = coarse_to_fine(problem.evaluator(models, sigmas), begin, problem.space.limits, widths[:1])
        if found is not None:
            begun.append((found, models))
    begun.sort(key=lambda pair: pair[0].state.cost)
    best = known
    for k, (coarse, models) in enumerate(begun):
        first = begun[0][0].state
        if k and (coarse.state.cost > first.cost + NEAR or _alike(coarse.state, first)):
            continue
        evaluate = problem.evaluator(models, sigmas)
        found = coarse_to_fine(evaluate, coarse.state, problem.space.limits, widths[1:]) or coarse
        if best is None or found.state.cost < best[0].state.cost:
            best = found, models
    return best


def explained(problem: Problem, state: State) -> bool:
    """Whether a fit leaves nothing but noise."""
    rows = {name: [piece.residuals[name] for piece in state.pieces] for name in problem.channels.outputs}
    interval = min(float(np.median(np.diff(model.t))) for model in problem.trials)
    return whiteness(rows, round(resolutions(problem)[0] / interval)) > SIGNIFICANCE


def _ringing(problem: Problem, sigmas: Mapping[str, float], best: Found, anew: bool) -> Found:
    """The fit or a lower one, where a contact rings faster than the coarser resolutions show: a search at the single
    sample, if it is to be made ``anew``, and the fit with other stiffnesses, followed from the resolutions next to it.
    """
    limits, widths = problem.space.limits, resolutions(problem)
    begun: list[tuple[State, tuple[TrialModel, ...], list[float]]] = []
    for start in find_start(problem, width=0.0)[:1] if anew else []:
        try:
            models = with_bristle(problem, start.state.u)
        except (ContactLost, SimulationFailed):
            continue
        locals_ = tuple(model.local[: model.size(problem.joint)] for model in models)
        begun.append((State(start.state.u, locals_, ()), models, [0.0]))
    if "sigma_0" in problem.names:
        for factor in STIFFNESSES:
            u = best[0].state.u.copy()
            u[problem.names.index("sigma_0")] += np.log(factor)
            begun.append((State(np.clip(u, *limits), best[0].state.locals, ()), best[1], widths[-NEXT:]))

    def followed(k: int) -> Solution | None:
        state, models, own = begun[k]
        return coarse_to_fine(problem.evaluator(models, sigmas), state, limits, own)

    for found, (_, models, _) in zip(in_parallel(followed, [1.0] * len(begun)), begun, strict=True):
        if found is not None and found.state.cost < best[0].state.cost:
            best = found, models
    return best


def maximum_likelihood(
    mechanism: Mechanism | Problem,
    recording: Recording | None = None,
    *,
    start: Mapping[str, float] | None = None,
    known: Found | None = None,
    starts: Sequence[Solution] = (),
    thorough: bool = True,
    **options,
) -> Estimate:
    """Estimate the free parameters by maximum likelihood on simulated trajectories.

    Minimises sum_signals sum_samples ((model - measured) / sigma)^2 / 2 over the parameters, the initial states and,
    with ``inputs="joint"``, the spline coefficients of the noisy inputs of every trial.

    Args:
        mechanism: the model, or a :class:`Problem`.
        recording: what was measured; not with a problem.
        start: parameter values to start from as well, by name (a trained PE's).
        known: a minimum of the problem's likelihood at its noise levels, which the search is to beat, with the models
            of its trials.
        starts: what a search over short windows found before (``details["starts"]`` of an estimate), best first.
        thorough: look for others around the minimum that was found.
        options: see :class:`Problem`.

    Returns:
        The estimate with 95 % intervals of the data alone: from the curvature of the likelihood, widened where that
        has several minima or where its neighbourhood tells less; from its profile where a parameter is told poorly.

    Raises:
        UserError: names, bounds or signals that do not fit the mechanism.
    """
    began = time.perf_counter()
    if isinstance(mechanism, Problem):
        problem = mechanism
    elif recording is None:
        raise UserError("no recording to estimate from", where="maximum_likelihood", fix="give a recording")
    else:
        problem = Problem(mechanism, recording, **options)
    before = problem.simulations
    anew = not starts
    starts = list(starts) or find_start(problem, start, asis=known is None)
    sigmas = first_sigmas(problem, starts[0].state) if starts else dict(problem.sigmas)
    best = _whole(problem, starts, sigmas, known)
    if best is None:
        return failed(problem, began, before)
    if thorough:
        best = _ringing(problem, sigmas, best, anew)
    solution, models = best
    minima = [solution]
    if thorough:
        evaluate = problem.evaluator(models, sigmas)
        minima = cycled(evaluate, solution, problem.space.limits, resolutions(problem))
        solution = minima[0]
    estimated = len(problem.given) < len(problem.sigmas)
    if not estimated:
        evaluate = problem.evaluator(models, sigmas)
        solution = levenberg_marquardt(evaluate, solution.state, problem.space.limits, iterations=20)
    for left in reversed(range(NOISE_ROUNDS if estimated else 0)):
        new = estimated_sigmas(problem, models, solution.state)
        change = max(abs(np.log(new[name] / sigmas[name])) for name in new)
        sigmas = new
        evaluate = problem.evaluator(models, sigmas)
        first = evaluate(solution.state.u, solution.state.locals, True)
        if first is None:
            break
        last = change < SETTLED or not left
        solution = levenberg_marquardt(evaluate, first, problem.space.limits, **({"iterations": 20} if last else FINE))
        if last:
            break
    beside: list[State] = []
    if len(minima) > 1:
        evaluate = problem.evaluator(models, sigmas)
        beside = neighbours(evaluate, solution.state, problem.space.limits)
    spent = time.perf_counter() - began, problem.simulations - before
    white = explained(problem, solution.state)
    found = finish(problem, models, solution, sigmas, *spent, minima=minima, beside=beside, white=white)
    return replace(found, details=found.details | {"starts": tuple(starts), "prior": problem.prior.about})
