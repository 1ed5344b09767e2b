"""What trials that no fit saw say of a fit."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import wraps
from typing import TypeVar

import numpy as np

from ..identify.problem import Problem
from ..identify.solve import FAINT, Evaluate, State, coarse_to_fine, cycled, levenberg_marquardt, reduced
from ..identify.trial import Piece, TrialModel
from ..numerics.parallel import in_parallel
from ..numerics.simulate import ContactLost, SimulationFailed
from .bench import NEAR, REFIT, Bench
from .fit import Fit

T = TypeVar("T")


def _once(work: Callable[[Bench, Fit], T]) -> Callable[[Bench, Fit], T]:
    """The work done once for every fit of a bench: the same few are judged again and again."""

    @wraps(work)
    def told(bench: Bench, fit: Fit) -> T:
        key = (work.__name__, id(fit.state), fit.names, tuple(fit.values.items()), tuple(fit.sigmas.items()))
        if key not in bench.judged:
            bench.judged[key] = fit.state, work(bench, fit)  # the state is kept, that no other gets its id
        return bench.judged[key][1]

    return told


@_once
def check(bench: Bench, fit: Fit) -> Fit | None:
    """The held-out trials with the fit's parameters: only their own unknowns are estimated."""
    found = checking(bench, fit)
    if found is None:
        return None
    problem, models, first, evaluate = found
    solution = coarse_to_fine(evaluate, first, (first.u, first.u), problem.resolutions)
    if solution is None:
        return None
    return Fit(fit.names, fit.values, models, solution.state, fit.sigmas)


def checking(bench: Bench, fit: Fit) -> tuple[Problem, tuple[TrialModel, ...], State, Evaluate] | None:
    """The held-out trials at the fit's parameters: their problem, models, first state, and how it is evaluated.

    None without such trials, or where they cannot be simulated.
    """
    if bench.checked is None:
        return None
    simulator = fit.models[0].simulator
    models = bench.equipped(bench.checked.trials, simulator)
    problem = bench.problem_of(bench.checked, fit.names, fit.values, simulator)
    problem = problem.varied(trials=models, prior=False)  # the prior is counted once, with the fitted trials
    u = problem.space.to_search(np.array([fit.values[name] for name in problem.names]))
    bristle = _with_bristle(problem, u)
    evaluate = problem.evaluator(bristle, fit.sigmas)
    first = evaluate(u, [model.local[: model.size(problem.joint)] for model in bristle], True)
    return None if first is None else (problem, bristle, first, evaluate)


def held_out_gain(bench: Bench, before: Fit, after: Fit, enough: float) -> float | None:
    """Log-likelihood that the held-out trials gain; None without such trials.

    Where it is not ``enough`` with the parameters as fitted, those of a law with memory may move within their errors:
    what the fitted trials leave open (a static friction above all that they show) may not refuse an effect on trials
    that tell it. Other laws leave nothing so open.
    """
    if bench.checked is None:
        return None
    after = replace(after, sigmas=before.sigmas)
    both = before, after
    old, new = in_parallel(lambda k: check(bench, both[k]), [1.0, 1.0])
    if old is None or new is None:
        return None if new is not None else -np.inf
    gain = old.state.cost - new.state.cost
    if gain >= enough or not bench.mechanism.memory:
        return gain
    pair = in_parallel(lambda k: surprise(bench, both[k]), [1.0, 1.0])
    return gain if pair[0] is None or pair[1] is None else max(gain, pair[0] - pair[1])


def bent(bench: Bench, old: Fit, new: Fit) -> bool:
    """Whether a lower minimum loses far more on the held-out trials than it gains on the fitted ones.

    A needle of static friction may follow the noise of a few breakaways.
    """
    if bench.checked is None:
        return False
    both = old, new
    checked = in_parallel(lambda k: check(bench, both[k]), [1.0, 1.0])
    if checked[0] is None or checked[1] is None:
        return False
    return checked[1].state.cost - checked[0].state.cost > old.state.cost - new.state.cost + NEAR


def compared_gains(bench: Bench, before: Fit, fits: Sequence[Fit]) -> list[float]:
    """Log-likelihood that the held-out trials gain by each fit, by which rivals are compared; 0 without such trials.

    That of :func:`surprise` for laws with memory: with the parameters as fitted a slip that sets in a little late costs
    more than what tells the rivals apart.
    """
    judged = [before, *(replace(fit, sigmas=before.sigmas) for fit in fits)]
    told: list[float | None] = [None] * len(judged)
    if bench.mechanism.memory:
        told = in_parallel(lambda k: surprise(bench, judged[k]), [1.0] * len(judged))
    reference = told[0]
    return [
        (held_out_gain(bench, before, fit, -np.inf) or 0.0) if reference is None or own is None else reference - own
        for fit, own in zip(fits, told[1:], strict=True)
    ]


@_once
def surprise(bench: Bench, fit: Fit) -> float | None:
    """Negative log-likelihood of the held-out trials given the fitted ones, the parameters integrated out.

    With S the information of the fit on u, and C(u) the held-out trials' cost at their own best unknowns, Laplace's
    approximation is min_u C(u) + (u - u_fit)' S (u - u_fit) / 2, plus half of log det (C'' + S) / det S. None without
    such trials, or where they cannot be simulated.
    """
    found = checking(bench, fit) if fit.state.curved else None
    if found is None:
        return None
    problem, _, first, plain = found
    n, at = len(first.u), first.u
    S = reduced(fit.state)[0] + FAINT * np.eye(n)

    def evaluate(u, locals_, derivatives, ran: State | None = None, **options):
        inner = None if ran is None else replace(ran, pieces=ran.pieces[:-1])
        state = plain(u, locals_[:-1], derivatives, ran=inner, **options)
        return None if state is None else _known(state, S, at)

    solution = levenberg_marquardt(evaluate, _known(first, S, at), problem.space.limits, **REFIT)
    # A slip a little early or late makes minima.
    state = cycled(evaluate, solution, problem.space.limits, problem.resolutions)[0].state
    if not state.curved:
        return None
    change = np.linalg.slogdet(reduced(state)[0])[1] - np.linalg.slogdet(S)[1]
    return state.cost + 0.5 * float(change)


def _known(state: State, S: np.ndarray, at: np.ndarray) -> State:
    """The state with what the fit knows as one more piece, without unknowns of its own."""
    d = state.u - at
    piece = Piece(0.5 * float(d @ S @ d), {}, gg=S, gl=np.zeros((len(d), 0)), grad_g=S @ d)
    return State(state.u, (*state.locals, np.zeros(0)), (*state.pieces, piece))


def _with_bristle(problem: Problem, u: np.ndarray) -> tuple[TrialModel, ...]:
    if not problem.mechanism.law.memory:
        return problem.trials
    try:
        return problem.models_at(u)
    except (ContactLost, SimulationFailed):
        return problem.trials
