"""Profile likelihood: an interval for a parameter whose likelihood is not quadratic."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import UserError
from .advice import invert
from .problem import Problem
from .result import Estimate
from .solve import Evaluate, State, levenberg_marquardt, reduced

THRESHOLD = 1.920729  # half the 95 % quantile of chi-squared with one degree of freedom
FARTHEST = 12  # steps to either side
LONGEST = 0.5  # in the search's logarithms: of a step; 12 of them reach a factor of 400


@dataclass(frozen=True)
class Profile:
    """Cost of the best fit at fixed values of one parameter.

    Attributes:
        name, unit: of the parameter.
        values: where it was held, SI units, increasing, shape (n,).
        cost: rise of the cost above its least value, shape (n,).
        ci95: where the rise is 1.92; infinite (0 below) where it stays lower within the bounds.
    """

    name: str
    unit: str
    values: np.ndarray
    cost: np.ndarray
    ci95: tuple[float, float]

    def __str__(self) -> str:
        low, high = self.ci95
        rows = "\n".join(f"  {v:.5g} {c:.2f}" for v, c in zip(self.values, self.cost, strict=True))
        return f"{self.name} in [{low:.4g}, {high:.4g}] {self.unit} (95 %); value, rise of the cost:\n{rows}"


def profile(problem: Problem, estimate: Estimate, name: str, step: float = 0.7) -> Profile:
    """Profile likelihood of a parameter around an estimate by maximum likelihood of this problem.

    Args:
        problem: the problem that was solved.
        estimate: its solution.
        name: parameter.
        step: distance between the values tried, in standard errors.

    Raises:
        UserError: an unknown name, or an estimate that failed or came from another method.

    Source: Raue et al., Structural and practical identifiability analysis, Bioinformatics 25 (2009).
    """
    if name not in problem.names:
        raise UserError("unknown parameter", where="profile", received=name, allowed=", ".join(problem.names))
    if "state" not in estimate.details:
        raise UserError(
            "no fit to start from", where="profile", received=estimate.outcome, allowed="maximum_likelihood"
        )
    evaluate = problem.evaluator(estimate.details["models"], estimate.sigmas, prior=False)
    return profiled(problem, evaluate, estimate.details["state"], name, step=step)


def profiled(
    problem: Problem,
    evaluate: Evaluate,
    state: State,
    name: str,
    *,
    factor: float = 1.0,
    step: float = 0.7,
    iterations: int = 15,
) -> Profile:
    """The profile of a parameter from a fit of these trials on.

    Args:
        problem: its parameters and their space.
        evaluate: of the data alone, without the prior.
        state: the fit, with derivatives.
        name: parameter.
        factor: on the rise that bounds the interval: more than 1 where residuals are correlated.
        step: see :func:`profile`.
        iterations: of the search at each value at most.
    """
    i = problem.names.index(name)
    found = {state.u[i]: state.cost - problem.prior.cost(state.u)}
    size = float(np.clip(step / np.sqrt(max(1e-12, _curvature(state, i))), 1e-4, LONGEST))
    rise = THRESHOLD * factor
    for side in (-1.0, 1.0):
        current: State | None = state
        for k in range(1, FARTHEST + 1):
            low, high = (limit.copy() for limit in problem.space.limits)
            target = float(np.clip(state.u[i] + side * k * size, low[i], high[i]))
            if current is None or target in found:
                break
            low[i] = high[i] = target
            current = _conditional(evaluate, current, i, target, (low, high), iterations)
            if current is None:
                break
            found[target] = current.cost
            if current.cost - min(found.values()) > rise:
                break
    us = np.array(sorted(found))
    costs = np.array([found[u] for u in us]) - min(found.values())
    values = np.array([problem.space.to_values(np.where(np.arange(len(state.u)) == i, u, state.u))[i] for u in us])
    nothing = problem.space.to_values(np.where(np.arange(len(state.u)) == i, -700.0, state.u))[i]
    open_low = -np.inf if problem.space.scales[i] else float(nothing)
    return Profile(name, problem.mechanism.units[name], values, costs, _crossings(values, costs, rise, open_low))


def _curvature(state: State, i: int) -> float:
    S = reduced(state)[0]
    return 1 / max(float(invert(S)[i, i]), 1e-300)


def _conditional(
    evaluate: Evaluate, state: State, i: int, target: float, limits: Sequence[np.ndarray], iterations: int
) -> State | None:
    """The best fit with unknown i held, from the neighbouring one moved along its conditional optimum."""
    S, _, back = reduced(state)
    covariance = invert(S)
    du = covariance[:, i] / covariance[i, i] * (target - state.u[i])
    u = np.clip(state.u + du, *limits)
    locals_ = [x if X is None else x - X[:, : len(u)] @ (u - state.u) for x, X in zip(state.locals, back, strict=True)]
    first = evaluate(u, locals_, True)
    if first is None:
        return None
    return levenberg_marquardt(evaluate, first, (limits[0], limits[1]), iterations=iterations, decrease=0.05).state


def _crossings(values: np.ndarray, rise: np.ndarray, limit: float, open_low: float) -> tuple[float, float]:
    """Where the rise passes the limit to both sides of its least value; ``open_low`` or infinity where it does not."""
    best = int(np.argmin(rise))
    low, high = open_low, np.inf
    if best > 0 and rise[:best].max() > limit:
        inside = int(np.flatnonzero(rise[:best] > limit).max())
        low = float(np.interp(limit, rise[[inside + 1, inside]], values[[inside + 1, inside]]))
    if best < len(rise) - 1 and rise[best + 1 :].max() > limit:
        inside = best + 1 + int(np.flatnonzero(rise[best + 1 :] > limit).min())
        high = float(np.interp(limit, rise[[inside - 1, inside]], values[[inside - 1, inside]]))
    return low, high
