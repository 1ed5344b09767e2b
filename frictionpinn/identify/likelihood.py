"""Maximum likelihood on simulated trajectories, noisy inputs estimated with the parameters.

Two things make this likelihood rugged. Errors add up over a trial: a static friction a little off moves a stop, and all
that follows is another motion. And what is sampled jumps: a stop one sample late costs the whole jump of the
acceleration, and a small change of the parameters changes nothing (laws without memory are not asked beside a jump, see
:func:`frictionpinn.identify.build.beside_jumps`). So the search goes

1. over short windows, each begun anew from what was measured, at a coarse resolution in time: a design over what the
   sliding samples do not tell, the best refined (:func:`frictionpinn.identify.start.find_start`);
2. over whole trials, noisy inputs among the unknowns, from that resolution to the single sample, each minimum the start
   of the next (:func:`_whole`); at the sample alone, which shows how fast a contact rings (:func:`_ringing`); and back
   and down again (:func:`frictionpinn.identify.solve.cycled`);
3. at the noise levels that the residuals show, until these settle.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..data.recording import Recording
from ..errors import UserError
from ..numerics.parallel import in_parallel
from ..numerics.simulate import ContactLost, SimulationFailed
from ..numerics.whiteness import SIGNIFICANCE, whiteness
from ..physics.mechanism import Mechanism
from .problem import Problem
from .result import Estimate, Minimum
from .solve import CLOSELY, GIVEN, Solution, State, coarse_to_fine, cycled, levenberg_marquardt, same_minimum
from .start import find_start
from .trial import TrialModel
from .uncertainty import failed, finish, neighbours

RIVAL = 15.0  # log-likelihood over windows: a start that is worse by more is not tried on the whole trials
AS_NEAR = 4.0  # log-likelihood at the coarsest resolution: another start that is as near is followed as well
ELSEWHERE = 0.1  # in log u: starts that are closer are the same
# Times the stiffness of the fit: a ring that lasts k periods fits one off as well, at (1 -+ 1/k)^2; k is 3 to 6.
STIFFNESSES, NEXT = (0.5, 0.7, 1.4, 2.0), 2  # and resolutions next to the sample, which do not blur it, to follow from
LOUD = 20.0  # times the noise by differences: residuals over windows that are larger set the level
NOISE_ROUNDS, SETTLED = 4, 0.01  # rounds of noise estimation at most; relative change that ends them

Found = tuple[Solution, tuple[TrialModel, ...]]  # where a search ended, and the models of the trials there


def maximum_likelihood(
    mechanism: Mechanism | Problem,
    recording: Recording | None = None,
    *,
    start: Mapping[str, float] | None = None,
    known: Found | None = None,
    starts: Sequence[Solution] = (),
    thorough: bool = True,
    profiles: bool = True,
    **options: Any,
) -> Estimate:
    """Estimate the free parameters by maximum likelihood on simulated trajectories.

    Minimises sum_signals sum_samples ((model - measured) / sigma)^2 / 2 over the parameters, the initial states and,
    with ``inputs="joint"``, the spline coefficients of the noisy inputs of every trial.

    Args:
        mechanism: the model, or a :class:`Problem`.
        recording: what was measured; not with a problem.
        start: parameter values to start from as well, by name (a trained PE's), SI units.
        known: a minimum of the problem's likelihood at its noise levels, which the search is to beat, with the models
            of its trials.
        starts: what a search over short windows found before (``minimum.starts`` of an estimate), best first.
        thorough: look for others around the minimum that was found.
        profiles: follow the likelihood's profile where a parameter is told poorly; else its curvature tells.
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
    before, limits = problem.simulations, problem.space.limits
    anew = not starts
    starts = tuple(starts or find_start(problem, start, asis=known is None))
    sigmas = _sigmas_over_windows(problem, starts[0].state) if starts else dict(problem.sigmas)
    best = _whole(problem, starts, sigmas, known)
    if best is None:
        return failed(problem, time.perf_counter() - began, problem.simulations - before)
    if thorough:
        best = _ringing(problem, sigmas, best, anew)
    solution, models = best
    minima = [solution]
    if thorough:
        minima = cycled(problem.evaluator(models, sigmas), solution, limits, problem.resolutions)
        solution = minima[0]

    if len(problem.given) == len(problem.sigmas):
        solution = levenberg_marquardt(problem.evaluator(models, sigmas), solution.state, limits, iterations=20)
    else:
        for left in reversed(range(NOISE_ROUNDS)):
            new = _sigmas_of(problem, models, solution.state)
            change = max(abs(np.log(new[name] / sigmas[name])) for name in new)
            sigmas = new
            evaluate = problem.evaluator(models, sigmas)
            first = evaluate(solution.state.u, solution.state.locals, True)
            if first is None:
                break
            last = change < SETTLED or not left
            how = {"iterations": 20} if last else CLOSELY
            solution = levenberg_marquardt(evaluate, first, limits, **how)
            if last:
                break

    evaluate = problem.evaluator(models, sigmas)
    beside = neighbours(evaluate, solution.state, limits) if len(minima) > 1 else []
    rows = {name: [piece.residuals[name] for piece in solution.state.pieces] for name in problem.channels.outputs}
    white = whiteness(rows, round(problem.resolutions[0] / problem.interval)) > SIGNIFICANCE
    minimum = Minimum(solution.state, tuple(models), solution.reason, tuple(minima), starts)
    spent = time.perf_counter() - began, problem.simulations - before
    return finish(problem, minimum, sigmas, *spent, beside=beside, profiles=profiles, white=white)


def _whole(
    problem: Problem, starts: Sequence[Solution], sigmas: Mapping[str, float], known: Found | None
) -> Found | None:
    """Fit the whole trials from the starts at the coarsest resolution, and from the best of these down to the sample.

    Another is followed, too, where it is about as good there but elsewhere. ``known`` is returned where it is better.
    """
    limits, widths = problem.space.limits, problem.resolutions
    distinct: list[State] = []
    coarse: list[Found] = []
    for start in starts:
        poor = start.state.cost > starts[0].state.cost + RIVAL and start.reason != GIVEN
        if poor or any(_alike(start.state, other) for other in distinct):
            continue
        distinct.append(start.state)
        begun = _begun(problem, start.state.u)
        if begun is not None:
            found = coarse_to_fine(problem.evaluator(begun[1], sigmas), begun[0], limits, widths[:1])
            coarse += [] if found is None else [(found, begun[1])]
    coarse.sort(key=lambda pair: pair[0].state.cost)
    best = known
    for k, (first, models) in enumerate(coarse):
        lowest = coarse[0][0].state
        if k and (first.state.cost > lowest.cost + AS_NEAR or _alike(first.state, lowest)):
            continue
        found = coarse_to_fine(problem.evaluator(models, sigmas), first.state, limits, widths[1:]) or first
        if best is None or found.state.cost < best[0].state.cost:
            best = found, models
    return best


def _alike(start: State, other: State) -> bool:
    """Whether two starts are the same, as far as the windows tell."""
    near = np.abs(start.u - other.u).max() < ELSEWHERE
    return bool(near or (other.curved and same_minimum(other, start)))


def _begun(problem: Problem, u: np.ndarray) -> tuple[State, tuple[TrialModel, ...]] | None:
    """The whole trials at a search vector as they were measured, and their models; None where they cannot be."""
    try:
        models = problem.models_at(u)
    except (ContactLost, SimulationFailed):
        return None
    return State(u, tuple(model.local[: model.size(problem.joint)] for model in models), ()), models


def _ringing(problem: Problem, sigmas: Mapping[str, float], best: Found, anew: bool) -> Found:
    """The fit or a lower one, where a contact rings faster than the coarser resolutions show: a search at the single
    sample, if it is to be made ``anew``, and the fit with other stiffnesses, followed from the resolutions next to it.
    """
    limits, widths = problem.space.limits, problem.resolutions
    begun: list[tuple[State, tuple[TrialModel, ...], list[float]]] = []
    for start in find_start(problem, width=0.0)[:1] if anew else []:
        there = _begun(problem, start.state.u)
        begun += [] if there is None else [(*there, [0.0])]
    for k in (k for k, name in enumerate(problem.names) if name.rpartition(".")[2] == "sigma_0"):
        for factor in STIFFNESSES:
            u = best[0].state.u.copy()
            u[k] += np.log(factor)
            begun.append((State(np.clip(u, *limits), best[0].state.locals, ()), best[1], widths[-NEXT:]))

    def followed(k: int) -> Solution | None:
        state, models, own = begun[k]
        return coarse_to_fine(problem.evaluator(models, sigmas), state, limits, own)

    for found, (_, models, _) in zip(in_parallel(followed, [1.0] * len(begun)), begun, strict=True):
        if found is not None and found.state.cost < best[0].state.cost:
            best = found, models
    return best


def _sigmas_over_windows(problem: Problem, state: State) -> dict[str, float]:
    """Noise levels to begin the whole trials with: those of the residuals over windows where these are far larger.

    Differences see nothing of filtered noise or of what a model lacks, and the search would weigh signals by that.
    """
    result = dict(problem.sigmas)
    for name in set(problem.channels.outputs) - set(problem.given):
        r = np.concatenate([piece.residuals[name] for piece in state.pieces])
        r = r[~np.isnan(r)]
        level = problem.loss.sigma(r, len(r)) if len(r) else 0.0
        result[name] = level if level > LOUD * result[name] else result[name]
    return result


def _sigmas_of(problem: Problem, models: Sequence[TrialModel], state: State) -> dict[str, float]:
    """Noise levels from the residuals of the whole trials, degrees of freedom taken off; given ones stay.

    An output loses its share of the parameters and initial states, an input the spline coefficients that it determines:
    the trace of its share of the normal matrix.
    """
    result, outputs = dict(problem.sigmas), problem.channels.outputs
    for name in set(problem.sigmas) - set(problem.given):
        rows = [piece.residuals[name] for piece in state.pieces if name in piece.residuals]
        r = np.concatenate([np.zeros(0), *rows])
        r, used = r[~np.isnan(r)], 0.0
        for item in (item for model in models for item in model.inputs if name in item.names):
            parts = {
                own: design.T @ design / problem.sigmas[own] ** 2
                for design, own in zip(item.basis.design, item.names, strict=True)
                if own in problem.sigmas
            }
            used += float(np.trace(np.linalg.solve(sum(parts.values()), parts[name])))
        if name in outputs:
            used += (len(problem.names) + sum(len(m.states) for m in models)) / len(outputs)
        if len(r) >= 2 * used + 5:
            floor = 1e-6 * float(np.sqrt(np.mean(r**2)))
            result[name] = max(problem.loss.sigma(r, len(r) - used), floor, 1e-12)
    return result
