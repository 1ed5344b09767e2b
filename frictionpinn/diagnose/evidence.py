"""What trials that no fit saw say of a fit."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

import numpy as np

from ..identify.problem import Problem
from ..identify.solve import FAINT, Evaluate, State, coarse_to_fine, reduced
from ..identify.trial import Piece, TrialModel
from ..numerics.simulate import ContactLost, SimulationFailed
from .bench import Bench
from .fit import Fit


def check(bench: Bench, fit: Fit) -> Fit | None:
    """The held-out trials with the fit's parameters: only their own unknowns are estimated.

    None without such trials, or where they cannot be simulated.
    """
    found = _held_out(bench, fit)
    if found is None:
        return None
    problem, models, first, evaluate = found
    solution = coarse_to_fine(evaluate, first, (first.u, first.u), problem.resolutions)
    return None if solution is None else replace(fit, models=models, state=solution.state, minima=())


def surprise(bench: Bench, fit: Fit) -> float | None:
    """Negative log-likelihood of the held-out trials given the fitted ones, the parameters integrated out.

    With S the information of the fit on u, and C(u) the held-out trials' cost at their own best unknowns, Laplace's
    approximation is min_u C(u) + (u - u_fit)' S (u - u_fit) / 2, plus half of log det (C'' + S) / det S: what fitted
    trials leave open (a static friction above all that they hardly show) may be told by the held-out ones. None without
    such trials, or where they cannot be simulated.
    """
    found = _held_out(bench, fit) if fit.state.curved else None
    if found is None:
        return None
    problem, _, first, plain = found
    at, S = first.u, reduced(fit.state)[0] + FAINT * np.eye(len(first.u))

    def known(state: State) -> State:
        """The state with what the fit knows as one more piece, without unknowns of its own."""
        d = state.u - at
        piece = Piece(0.5 * float(d @ S @ d), {}, gg=S, gl=np.zeros((len(d), 0)), grad_g=S @ d)
        return State(state.u, (*state.locals, np.zeros(0)), (*state.pieces, piece))

    def evaluate(u, locals_, derivatives, ran: State | None = None, **options):
        inner = None if ran is None else replace(ran, pieces=ran.pieces[:-1])
        state = plain(u, locals_[:-1], derivatives, ran=inner, **options)
        return None if state is None else known(state)

    solution = coarse_to_fine(evaluate, known(first), problem.space.limits, problem.resolutions)
    if solution is None or not solution.state.curved:
        return None
    change = np.linalg.slogdet(reduced(solution.state)[0])[1] - np.linalg.slogdet(S)[1]
    return solution.state.cost + 0.5 * float(change)


def _held_out(bench: Bench, fit: Fit) -> tuple[Problem, tuple[TrialModel, ...], State, Evaluate] | None:
    """The held-out trials at the fit's parameters: their problem, models, first state, and how it is evaluated."""
    if bench.checked is None:
        return None
    problem = bench.problem_of(bench.checked, fit.names, fit.values, fit.models[0].simulator)
    problem = problem.varied(prior=False)  # counted once, with the fitted trials
    u, models = problem.space.to_search(fit.values), problem.trials
    with suppress(ContactLost, SimulationFailed):
        models = problem.models_at(u)
    evaluate = problem.evaluator(models, fit.sigmas)
    first = evaluate(u, tuple(model.local[: model.size(problem.joint)] for model in models), True)
    return None if first is None else (problem, models, first, evaluate)
