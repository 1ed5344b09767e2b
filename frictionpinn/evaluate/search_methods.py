"""Search methods that people use: Nelder-Mead, a genetic algorithm, nonlinear least squares by finite differences.

All search the same coordinates within the same bounds, from the same start and on the same simulator as maximum
likelihood, with the inputs fixed at their smoothed paths: what differs is the method. Least squares minimises the
squares alone: it has neither the robust loss of a law that jumps nor what is known beforehand, as the others' cost has.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy import optimize

from ..identify.problem import Problem
from ..identify.result import STOPPED, Estimate, Minimum
from ..identify.uncertainty import failed, finish
from ..numerics.descent import BUDGET, ENDED
from ..numerics.quadratic import State

NO_MODEL = 1e12  # cost of parameters at which the mechanism cannot be simulated


class OutOfBudget(Exception):
    """No simulation is left. Not a StopIteration: scipy maps over steps, and a map that meets one ends silently."""


@dataclass(frozen=True)
class Improvement:
    """The best parameters that a search method had found after so many seconds and simulations of the recording.

    ``values`` are by name, SI units; ``cost`` is the negative log-likelihood there.
    """

    seconds: float
    simulations: int
    cost: float
    values: dict[str, float]


class Objective:
    """Cost of a parameter vector u, counted, with every improvement.

    Args:
        problem: that is solved.
        budget: most simulations of the whole recording.

    Attributes:
        limits: bounds of u.
        models, locals: of the trials, and their unknowns: the initial states, held where they start.
        u: the best so far, shape (n,).
        path: the best so far over time.
    """

    def __init__(self, problem: Problem, budget: float):
        self.problem, self.budget, self.limits = problem, budget, problem.space.limits
        self.models = problem.trials
        self.locals = [model.local[: model.size(False)] for model in self.models]
        self.evaluate = problem.evaluator(self.models)
        self.began, self.count = time.perf_counter(), 0
        self.u = np.zeros(0)
        self.path: list[Improvement] = []

    def state(self, u: np.ndarray, derivatives: bool = False) -> State | None:
        """The problem's state at u, moved inside the bounds; None where it cannot be simulated."""
        self.count += 1
        return self.evaluate(np.clip(u, *self.limits), self.locals, derivatives)

    def _note(self, u: np.ndarray, cost: float) -> None:
        if cost < (self.path[-1].cost if self.path else np.inf):
            self.u = np.clip(u, *self.limits)
            values = self.problem.space.named(self.u)
            self.path.append(Improvement(time.perf_counter() - self.began, self.count, cost, values))
        if self.count >= self.budget:
            raise OutOfBudget

    def __call__(self, u: np.ndarray) -> float:
        state = self.state(u)
        cost = NO_MODEL if state is None else state.cost
        self._note(u, cost)
        return cost

    def residuals(self, u: np.ndarray) -> np.ndarray:
        """Weighted residuals of all signals and trials, NaN as 0; no prior among them."""
        state = self.state(u)
        if state is None:
            size = sum(model.y.size for model in self.models)
            return np.full(size, np.sqrt(2 * NO_MODEL / size))
        self._note(u, state.cost)
        parts = [
            np.nan_to_num(piece.residuals[name] / self.problem.sigmas[name])
            for piece in state.pieces
            for name in self.problem.channels.outputs
        ]
        return np.concatenate(parts)


Method = Callable[[Objective, np.ndarray, int], bool]  # objective, start, seed -> whether it ended by itself


def _nelder_mead(objective: Objective, start: np.ndarray, seed: int) -> bool:
    options = {"xatol": 1e-4, "fatol": 1e-4, "maxiter": 100_000, "maxfev": 100_000, "adaptive": True}
    bounds = list(zip(*objective.limits, strict=True))
    return bool(optimize.minimize(objective, start, method="Nelder-Mead", bounds=bounds, options=options).success)


def _least_squares(objective: Objective, start: np.ndarray, seed: int) -> bool:
    low, high = objective.limits
    inner = np.clip(start, low + 1e-9, high - 1e-9)
    found = optimize.least_squares(objective.residuals, inner, bounds=(low, high), x_scale=np.maximum(high - low, 1e-6))
    return found.status > 0


def _genetic(objective: Objective, start: np.ndarray, seed: int) -> bool:
    from pymoo.algorithms.soo.nonconvex.ga import GA
    from pymoo.core.problem import ElementwiseProblem
    from pymoo.optimize import minimize
    from pymoo.termination.default import DefaultSingleObjectiveTermination

    low, high = objective.limits

    class Wrapped(ElementwiseProblem):
        def __init__(self):
            super().__init__(n_var=len(low), n_obj=1, xl=low, xu=high)

        def _evaluate(self, x, out, *args, **kwargs):
            out["F"] = objective(x)

    rng = np.random.default_rng(seed)
    population = rng.uniform(low, high, size=(100, len(low)))
    population[0] = np.clip(start, low, high)
    end = DefaultSingleObjectiveTermination(n_max_gen=200, n_max_evals=10**9)
    minimize(Wrapped(), GA(pop_size=100, sampling=population), end, seed=seed, verbose=False)
    return True


METHODS: dict[str, Method] = {"nelder_mead": _nelder_mead, "least_squares": _least_squares, "genetic": _genetic}


def search(
    method: str,
    problem: Problem,
    *,
    start: Mapping[str, float] | None = None,
    seed: int = 0,
    simulations: float = np.inf,
) -> Estimate:
    """Estimate the parameters by one of ``METHODS``.

    Args:
        method: nelder_mead (scipy, adaptive), least_squares (scipy, trust region, two-point differences) or genetic
            (pymoo's GA, population of 100, at most 200 generations; its first individual is the start).
        problem: model, data and bounds.
        start: parameter values, SI units; those not named start from the scale of the data.
        seed: of the genetic algorithm.
        simulations: most simulations of the whole recording.

    Returns:
        The estimate, with the ``path`` to it. Its intervals come from the curvature there and take the inputs as known
        exactly.

    Raises:
        KeyError: an unknown method.
    """
    objective = Objective(problem, simulations)
    before, u = problem.simulations, problem.space.to_search(problem.start | dict(start or {}))
    try:
        done = METHODS[method](objective, u, seed)
    except OutOfBudget:
        done = False
    seconds = time.perf_counter() - objective.began
    state = objective.state(objective.u, derivatives=True) if objective.path else None
    count = problem.simulations - before
    if state is None:
        return replace(failed(problem, seconds, count), estimator=method)
    minimum = Minimum(state, ENDED if done else BUDGET, objective.models)
    found, _ = finish(problem, minimum, dict(problem.sigmas), seconds, count, profiles=False)
    outcome = found.outcome if done else STOPPED
    return replace(found, estimator=method, outcome=outcome, minimum=None, path=tuple(objective.path))
