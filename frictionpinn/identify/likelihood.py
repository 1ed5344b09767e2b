"""Maximum likelihood on simulated trajectories, noisy inputs estimated with the parameters.

Two things make this likelihood rugged. Errors add up over a trial: a static friction a little off moves a stop, and all
that follows is another motion. And what is sampled jumps: a stop one sample late costs the whole jump of the
acceleration, and a small change of the parameters changes nothing. Laws without memory are not asked beside a jump that
the samples show (:func:`frictionpinn.numerics.jumps.beside_jumps`), and wherever a descent ends it tries to move stops
past samples (:mod:`frictionpinn.numerics.stops`). So the search goes

1. over whole trials, noisy inputs among the unknowns, held to the motion that was measured and let go of, each minimum
   the start of the next (:mod:`frictionpinn.identify.tether`), at the noise levels that the residuals show
   (:func:`_settled`): from the sample, or where that is too rugged from a coarse resolution in time;
2. around what was found, with a bristle in each trial's own unknowns (:func:`lowest_of_trials`), and by ways that show
   lower minima of the parameters (:func:`lowest_around`). Trials share the parameters alone: the likelihood has its
   minima trial by trial: hardly any search ends in the lowest of every trial, but among a few each trial has been
   there, and they are put together (:func:`frictionpinn.numerics.minima.assembled`);
3. where that leaves what is not white, once more from a coarse resolution, unless the motion is imposed and no error
   adds up, and from other starts, too: a design over what the sliding samples do not tell and a grid over what moves
   together, those that fit best held by the shortest tether (:func:`_elsewhere`). Where the profile of a parameter that
   is told poorly then goes lower, around that.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.stats import f

from ..data.recording import Recording
from ..errors import UserError
from ..numerics.descent import CLOSELY, KNOWN, Solution, coarse_to_fine, levenberg_marquardt
from ..numerics.minima import AT_ONCE, KICKS, assembled, carried, lowest_of_trials
from ..numerics.parallel import in_parallel
from ..numerics.quadratic import SAME_MINIMUM, Evaluate, Known, State, moved, reduced
from ..numerics.whiteness import SIGNIFICANCE
from ..physics.base import plain_name
from ..physics.mechanism import Mechanism
from ..progress import counted
from .problem import Problem
from .result import Estimate, Minimum
from .start import coarse_design, ridge_grid
from .tether import Found, Path, Seen, followed, lowest, tethered
from .trial import TrialModel
from .uncertainty import failed, finish, neighbours

Best = tuple[Solution, tuple[TrialModel, ...], dict[str, float]]  # a minimum, models of the trials, noise levels
BEST = 4  # of the points of a design, and of a grid: these are followed
# Times the stiffness of the fit: a ring that lasts k periods fits one off as well, at (1 -+ 1/k)^2; k is 3 to 6.
STIFFNESSES = (0.5, 2.0, 0.7, 1.4)
# Times the Stribeck velocity of the fit: much friction at rest that is soon lost, or less that is lost later, may fit.
STRIBECK_VELOCITIES = (0.5, 2.0)
UNTOLD_REST = 3.0  # standard deviations of the noise: from where samples tell that a body moves
BARELY = 3e-5  # m/s or rad/s: three times the usual v_t, slip that mobilises all the friction of a law without memory
LOUD = 20.0  # times the noise by differences: residuals under a tether that are larger set the level
REFITS, NOISE_ROUNDS, SETTLED = 4, 4, 0.01  # fits from below, rounds of noise levels at most; change that ends these


def maximum_likelihood(
    mechanism: Mechanism | Problem,
    recording: Recording | None = None,
    *,
    start: Mapping[str, float] | None = None,
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
        thorough: look for others around the minimum that was found.
        profiles: follow the likelihood's profile where a parameter is told poorly; else its curvature tells.
        options: see :class:`Problem`.

    Returns:
        The estimate with 95 % intervals of the data alone: from the curvature of the likelihood, widened where its
        neighbourhood tells less; from its profile where a parameter is told poorly.

    Raises:
        UserError: names, bounds or signals that do not fit the mechanism.
    """
    began = time.perf_counter()
    if isinstance(mechanism, Problem):
        if recording is not None or options:
            raise UserError("a problem has its recording and options", where="maximum_likelihood",
                            received=", ".join([*["recording"][: recording is not None], *options]),
                            allowed="start, thorough, profiles", fix="give them to the problem")  # fmt: skip
        problem = mechanism
    elif recording is None:
        raise UserError("no recording to estimate from", where="maximum_likelihood", fix="give a recording")
    else:
        problem = Problem(mechanism, recording, **options)
    before = problem.simulations
    given = [problem.start] if start is None else [problem.start, problem.start | dict(start)]
    us, held, sigmas = [problem.space.to_search(p) for p in given], tethered(problem), dict(problem.sigmas)
    path, seen = Path(problem, held, sigmas, coarse=held is None and bool(problem.mechanism.free)), Seen()
    ends = followed(path, us, path.stages, seen)
    if not ends and held is not None:  # too rugged at the sample
        coarse = replace(path, coarse=True)
        ends = followed(coarse, us, coarse.stages, {})
        alone = _best(problem, ends, sigmas, thorough=False)
        ends = [alone[:2], *ends[1:]] if alone and _explains(problem, alone) else []
        sigmas = alone[2] if alone else sigmas
    best = _best(problem, ends, sigmas, thorough)
    if best is None or not _white(problem, best[0].state):  # another start may explain more
        found, sigmas = _elsewhere(problem, held, us, seen)
        again = best and _minimum(problem, best[1], best[0].state, sigmas, **CLOSELY)
        here = [(again, best[1])] if best and again else []
        if found and not (here and here[0][0].state.cost < found[0][0].state.cost + SAME_MINIMUM):
            best = _best(problem, [*found, *here], sigmas, thorough)
    if best is None:
        return failed(problem, time.perf_counter() - began, problem.simulations - before)
    for left in range(REFITS)[::-1]:
        solution, models, sigmas = best
        beside = neighbours(problem.evaluator(models, sigmas), solution.state, problem.space.limits) if thorough else []
        white = _explains(problem, best)
        spent = time.perf_counter() - began, problem.simulations - before
        minimum = Minimum(solution.state, solution.reason, models)
        estimate, profiled = finish(problem, minimum, sigmas, *spent, beside=beside, profiles=profiles, white=white)
        below = left and profiled is not solution.state and _minimum(problem, models, profiled, sigmas)
        if not below or below.state.cost > solution.state.cost - SAME_MINIMUM * solution.state.unit:
            break
        best = _best(problem, [(below, models)], sigmas, thorough) or best
    return estimate


def _best(problem: Problem, ends: Sequence[Found], sigmas: dict[str, float], thorough: bool) -> Best | None:
    """The best of the ends of searches, which comes first, at the noise levels that its residuals show; if it is to be
    ``thorough``, the lowest minimum around it. None where there are no ends."""
    if not ends:
        return None
    (first, models), *others = ends
    solution, sigmas = _settled(problem, models, first, sigmas)
    if thorough:
        costs = problem.evaluator(models, sigmas), problem.apart(models, sigmas)
        lower = lowest_around(problem, *costs, solution, [end.state for end, _ in others])
        solution, sigmas = _settled(problem, models, lower, sigmas)
    return solution, models, sigmas


def lowest_around(
    problem: Problem, evaluate: Evaluate, alone: Sequence[Evaluate], found: Solution, others: Sequence[State] = ()
) -> Solution:
    """The lowest minimum around one that was found, put together from each trial's best.

    That is first made the lowest that each trial's own unknowns allow (:func:`lowest_of_trials`), where a bristle makes
    these rugged. Searches begin many and a few standard errors away, in directions drawn at random from what the data
    leave open: when a body stops and breaks away differs there. A contact rings, which resolutions next to the sample
    do not blur: with a bristle, other stiffnesses are followed from the next one. And what begins at rest may slide
    either way at once (:func:`beginnings`). Each way begins with its farthest searches and ends where a pair of them
    comes back: from nearer by, more would.

    Args:
        problem, evaluate, alone: what is solved, its cost, and that of every trial by itself.
        found: a minimum of it.
        others: where other searches for it ended, at whatever noise levels.
    """
    limits, widths = problem.space.limits, problem.resolutions
    if problem.simulator.bristles:
        found = lowest_of_trials(evaluate, alone, found, limits, widths)
    values, vectors = np.linalg.eigh(reduced(found.state)[0])
    errors = vectors / np.sqrt(np.maximum(values, 1.0))  # what is hardly told is moved by a factor e
    directions = np.random.default_rng(0).standard_normal((len(KICKS), len(values)))

    def away(step: np.ndarray) -> State:
        return replace(found.state, u=np.clip(found.state.u + step, *limits))

    kicks = [away(kick * errors @ z) for kick, z in zip(KICKS, directions, strict=True)]
    ways = [(kicks, widths[-1:])]
    for at in np.eye(len(values))[[plain_name(name) == "sigma_0" for name in problem.names]]:
        ways.append(([away(np.log(factor) * at) for factor in STIFFNESSES], widths[-2:]))
    covariance = errors @ errors.T
    for k in np.flatnonzero([plain_name(name) == "v_s" for name in problem.names]):
        ridge = covariance[:, k] / covariance[k, k]
        beside = [moved(found.state, np.log(f) * ridge, limits, longest=np.inf) for f in STRIBECK_VELOCITIES]
        ways.append(([replace(found.state, u=u, locals=tuple(own)) for u, own in beside], widths[-1:]))
    ways += [([state], widths[-1:]) for state in beginnings(problem, found.state)]

    def followed(begun: Sequence[tuple[State, list[float]]], known: list[Known]) -> list[Solution | None]:
        def follow(k: int) -> Solution | None:
            return coarse_to_fine(evaluate, begun[k][0], limits, begun[k][1], known)

        return in_parallel(follow, [1.0] * len(begun), "minima around the fit")

    ends = [found]
    while ways:
        begun = [(k, first, own) for k, (firsts, own) in enumerate(ways) for first in firsts[:AT_ONCE]]
        made = followed([(first, own) for _, first, own in begun], [Known.of(end.state) for end in ends])
        elsewhere = [(k, end) for (k, *_), end in zip(begun, made, strict=True) if end is None or end.reason != KNOWN]
        ends += [end for _, end in elsewhere if end is not None]
        left = {k for k, _ in elsewhere}
        ways = [(firsts[AT_ONCE:], own) for k, (firsts, own) in enumerate(ways) if k in left and firsts[AT_ONCE:]]
    ends.sort(key=lambda end: end.state.cost)
    offered = carried([*others, *(end.state for end in ends[1:])], ends[0].state.u, limits)
    return assembled(evaluate, ends[0], offered, limits)


def beginnings(problem: Problem, state: State) -> list[State]:
    """The state with every trial that may begin at rest doing so, and barely sliding one way and the other.

    The first samples of the acceleration show on which side of zero the velocity begins, and no search crosses that:
    dry friction turns round there. None where every trial's samples tell that it moves."""
    velocities = {c.signals[1] for c in problem.mechanism.free}
    level = {name: UNTOLD_REST * problem.sigmas.get(name, np.inf) for name in velocities}
    at = [[k for k, name in enumerate(model.states) if name in velocities and abs(x[k]) < level[name]]
          for model, x in zip(problem.trials, state.locals, strict=True)]  # fmt: skip
    if not any(at):
        return []
    made = []
    for velocity in (0.0, BARELY, -BARELY):
        locals_ = tuple(x.copy() for x in state.locals)
        for x, own in zip(locals_, at, strict=True):
            x[own] = velocity
        made.append(replace(state, locals=locals_))
    return made


def _white(problem: Problem, state: State) -> bool:
    """Whether what a fit leaves of the outputs is white."""
    return state.white(problem.channels.outputs, round(problem.resolutions[0] / problem.interval))


def _explains(problem: Problem, best: Best) -> bool:
    """Whether a fit leaves noise alone, and hides nothing in noisy inputs."""
    return _white(problem, best[0].state) and not _drawn_away(problem, best[1], best[0].state)


def _drawn_away(problem: Problem, models: Sequence[TrialModel], state: State) -> bool:
    """Whether noisy inputs are found farther from what was measured than their noise explains (F-test): what a model
    lacks may hide there, as a constant force does, and leave the outputs white.

    Outputs draw an input's spline towards the truth, by less than it errs alone (Hausman, Econometrica 46 (1978)).
    """
    away, left, told, rest = 0.0, 0.0, 0, 0
    for model, local in zip(models, state.locals, strict=True):
        for item, values in zip(model.inputs, model.coefficients(local), strict=True):
            if not set(item.names) & set(model.sensed):  # of others the spline is the truth, not what a sensor shows
                levels, seen = [problem.sigmas.get(name, np.inf) for name in item.names], np.isfinite(item.y)
                weight, alone = seen / np.array(levels)[:, None], item.basis.values(item.coefficients)
                away += float(np.sum(((item.basis.values(values) - alone) * weight) ** 2))
                left += float(np.nansum(((item.y - alone) * weight) ** 2))
                told, rest = told + item.basis.size, rest + int(seen.sum()) - item.basis.size
    return told > 0 < rest and left > 0 and float(f.sf(away / told * rest / left, told, rest)) < SIGNIFICANCE


def _elsewhere(
    problem: Problem, held: Problem | None, us: Sequence[np.ndarray], seen: Seen
) -> tuple[list[Found], dict[str, float]]:
    """Fits of the whole trials from a coarse resolution on, best first, and noise levels to begin with: from the starts
    ``us`` and from others that a design holds, without what comes to minima that were ``seen`` at the noise levels of
    the problem."""
    path = Path(problem, held, problem.sigmas, coarse=bool(problem.mechanism.free))
    design = [u for u in coarse_design(problem) if not any(np.array_equal(u, given) for given in us)]
    us = [*us, *lowest(path, design, BEST)] if path.coarse or not seen else lowest(path, design, BEST)
    if not (first := followed(path, us, path.stages[:1], {})):
        return [], dict(problem.sigmas)
    best = first[0][0].state  # around it a grid is laid, and its residuals tell the noise
    grid, sigmas = lowest(path, ridge_grid(problem.space, best.u, problem.fixed), BEST), _louder(problem, best)
    known, path = seen if sigmas == problem.sigmas else {}, replace(path, sigmas=sigmas)
    if len(path.stages) == 1 and sigmas == problem.sigmas:  # the first were followed to the end
        return [*first, *followed(path, grid, path.stages, known)], sigmas
    return followed(path, [*us, *grid], path.stages, known), sigmas


def _minimum(
    problem: Problem, models: Sequence[TrialModel], state: State, sigmas: Mapping[str, float], **how: Any
) -> Solution | None:
    """The minimum from a state on, at these noise levels; None where it cannot be simulated."""
    evaluate = problem.evaluator(models, sigmas)
    first = evaluate(state.u, state.locals, True)
    return None if first is None else levenberg_marquardt(evaluate, first, problem.space.limits, **how)


def _settled(
    problem: Problem, models: Sequence[TrialModel], solution: Solution, sigmas: dict[str, float]
) -> tuple[Solution, dict[str, float]]:
    """The minimum at the noise levels that its residuals show, and these."""
    if len(problem.given) == len(problem.sigmas):
        return _minimum(problem, models, solution.state, sigmas, iterations=20) or solution, sigmas
    for left in counted(range(NOISE_ROUNDS)[::-1], "noise levels"):
        before, sigmas = sigmas, _sigmas_of(problem, models, solution.state)
        change = max(abs(np.log(sigmas[name] / before[name])) for name in sigmas)
        last = change < SETTLED or not left
        found = _minimum(problem, models, solution.state, sigmas, **({"iterations": 20} if last else CLOSELY))
        solution = solution if found is None else found
        if last or found is None:
            break
    return solution, sigmas


def _louder(problem: Problem, state: State) -> dict[str, float]:
    """Noise levels to begin other searches with: of what is left under the shortest tether where that is far louder.
    Differences, by which the search would weigh signals, see nothing of filtered noise or of what a model lacks."""
    result = dict(problem.sigmas)
    for name in set(problem.channels.outputs) - set(problem.given):
        r = state.left(name)
        level = problem.loss.sigma(r, len(r)) if len(r) else 0.0
        result[name] = level if level > LOUD * result[name] else result[name]
    return result


def _sigmas_of(problem: Problem, models: Sequence[TrialModel], state: State) -> dict[str, float]:
    """Noise levels from the residuals of the whole trials, degrees of freedom taken off; given ones stay.

    An output loses its share of the parameters and initial states, an input the spline coefficients that it determines:
    the trace of its share of the normal matrix, over what the rows tell (an acceleration alone tells no position)."""
    result, outputs = dict(problem.sigmas), problem.channels.outputs
    for name in set(problem.sigmas) - set(problem.given):
        r, used = state.left(name), 0.0
        for item in (item for model in models for item in model.inputs if name in item.names):
            designs = zip(item.names, item.basis.design, strict=True)
            parts = {own: A.T @ A / problem.sigmas[own] ** 2 for own, A in designs if own in problem.sigmas}
            used += float(np.trace(np.linalg.pinv(sum(parts.values()), hermitian=True) @ parts[name]))
        if name in outputs:
            used += (len(problem.names) + sum(len(m.states) for m in models)) / len(outputs)
        if len(r) >= 2 * used + 5:
            floor = 1e-6 * float(np.sqrt(np.mean(r**2)))
            result[name] = max(problem.loss.sigma(r, len(r) - used), floor, 1e-12)
    return result
