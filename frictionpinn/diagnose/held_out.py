"""What trials that no fit saw say of a fit."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from ..identify.likelihood import beginnings
from ..identify.problem import Problem
from ..identify.tether import Path, followed, tethered
from ..identify.trial import TrialModel
from ..numerics.descent import CLOSELY, ENDED, Solution, coarse_to_fine, levenberg_marquardt
from ..numerics.minima import assembled, carried, lowest_of_trials
from ..numerics.parallel import in_parallel
from ..numerics.quadratic import FAINT, Evaluate, Piece, State, reduced
from ..numerics.simulate import ContactLost, SimulationFailed
from .bench import Bench
from .fit import Fit


@dataclass(frozen=True)
class Surprise:
    """Negative log-likelihood of the held-out trials, their own unknowns at their best.

    Attributes:
        fit: with the parameters as they were fitted, its state's cost.
        moved: with these integrated out: what the fitted trials leave open (a static friction above all that they
            hardly show) the held-out ones may tell. With S the information of the fit on u and C(u) their cost,
            Laplace's approximation is min_u C(u) + (u - u_fit)' S (u - u_fit) / 2 + log(det(C'' + S) / det S) / 2.
    """

    fit: Fit
    moved: float


def surprise(bench: Bench, fit: Fit) -> Surprise | None:
    """What trials that no fit saw say of a fit, found once; None without any, or where they cannot be simulated."""
    if fit not in bench.judged:
        bench.judged[fit] = _judged(bench, fit)
    return bench.judged[fit]


def check(bench: Bench, fit: Fit) -> Fit | None:
    """The held-out trials with a fit's parameters, only their own unknowns estimated, see :func:`surprise`."""
    found = surprise(bench, fit)
    return None if found is None else found.fit


def _judged(bench: Bench, fit: Fit) -> Surprise | None:
    """The held-out trials with the fit's parameters, and what they say of it.

    A slip a little early or late makes minima in the trials' own unknowns, fewer of them where the parameters may move
    as far as the fit leaves them open. So these unknowns are searched with the parameters as fitted, then both, and the
    unknowns to which that leads are tried with the parameters as fitted.
    """
    if (found := _held_out(bench, fit)) is None:
        return None
    problem, models, first, plain = found
    at, limits, widths = first.u, problem.space.limits, problem.resolutions
    held = own_unknowns(Path(problem, tethered(problem), fit.sigmas, coarse=True, given=True), models, first)
    moved = None
    if fit.state.curved:
        S = reduced(fit.state)[0] + FAINT * np.eye(len(at))

        def known(state: State) -> State:
            """The state with what the fit knows as one more piece, without unknowns of its own."""
            d = state.u - at
            piece = Piece(0.5 * float(d @ S @ d), {}, gg=S, gl=np.zeros((len(d), 0)), grad_g=S @ d)
            return State(state.u, (*state.locals, np.zeros(0)), (*state.pieces, piece))

        def evaluate(u, locals_, derivatives, ran=None, beside=None, **options):
            ran, beside = (s and replace(s, locals=s.locals[:-1], pieces=s.pieces[:-1]) for s in (ran, beside))
            state = plain(u, locals_[:-1], derivatives, ran=ran, beside=beside, **options)
            return None if state is None else known(state)

        starts = ((first, widths), (held.state, widths[-1:]))
        made = [coarse_to_fine(evaluate, known(state), limits, own) for state, own in starts]
        ends = sorted((s for s in made if s is not None and s.state.curved), key=lambda s: s.state.cost)
        if ends:
            offered = carried([end.state for end in ends[1:]], ends[0].state.u, limits)
            best = assembled(evaluate, ends[0], offered, limits).state
            held = assembled(plain, held, [own[:-1] for own in carried([best], at, limits)], (at, at))
            moved = best.cost + 0.5 * float(np.linalg.slogdet(reduced(best)[0])[1] - np.linalg.slogdet(S)[1])
    return Surprise(replace(fit, models=models, state=held.state), held.state.cost if moved is None else moved)


def own_unknowns(path: Path, models: Sequence[TrialModel], first: State) -> Solution:
    """Trials at given parameters, where they have nothing in common: the own unknowns of each, by itself.

    At the sample, along the path, which does not lose the motion where a breakaway is missed, and begun at rest; the
    best of these, and with a bristle the best around it.

    Args:
        path: of all trials, with the parameters given.
        models, first: the trials where a search begins, and their state there, with derivatives.
    """
    at = first.u, first.u

    def alone(problem: Problem, k: int) -> Problem:
        return problem.varied(trials=[problem.trials[k]], counted=True)

    def search(k: int) -> State:
        problem = alone(path.problem, k)
        evaluate, widths = problem.evaluator([models[k]], path.sigmas), problem.resolutions
        begun = State(first.u, (first.locals[k],), (first.pieces[k],))
        ends = [levenberg_marquardt(evaluate, begun, at, damping=0.0, **CLOSELY)]
        own = replace(path, problem=problem, held=path.held and alone(path.held, k))
        ends += [end for end, _ in followed(own, [first.u], own.stages, {})]
        best = min(ends, key=lambda end: end.state.cost)
        rests = [coarse_to_fine(evaluate, state, at, widths[-1:]) for state in beginnings(problem, best.state)]
        best = min([best, *filter(None, rests)], key=lambda end: end.state.cost)
        return (lowest_of_trials(evaluate, [evaluate], best, at, widths) if problem.simulator.bristles else best).state

    found = in_parallel(search, [float(len(model.t)) for model in models])
    whole = State(first.u, tuple(state.locals[0] for state in found), tuple(state.pieces[0] for state in found))
    return Solution(whole, ENDED)


def _held_out(bench: Bench, fit: Fit) -> tuple[Problem, tuple[TrialModel, ...], State, Evaluate] | None:
    """The held-out trials at the fit's parameters: problem, whose prior is counted already, models, state, cost."""
    if bench.checked is None:
        return None
    problem = bench.problem_of(bench.checked, fit.names, fit.values, fit.models[0].simulator).varied(prior=False)
    u, models = problem.space.to_search(fit.values), problem.trials
    with suppress(ContactLost, SimulationFailed):
        models = problem.models_at(u)
    evaluate = problem.evaluator(models, fit.sigmas)
    first = evaluate(u, tuple(model.local[: model.size(problem.joint)] for model in models), True)
    return None if first is None else (problem, models, first, evaluate)
