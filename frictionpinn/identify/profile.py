"""Profile likelihood: an interval for a parameter whose likelihood is not quadratic."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import UserError
from .advice import invert
from .likelihood import _evaluator
from .problem import Problem
from .result import Estimate
from .solve import State, levenberg_marquardt, reduced

THRESHOLD = 1.920729  # half the 95 % quantile of chi-squared with one degree of freedom
FARTHEST = 12  # steps to either side


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
    state, i = estimate.details["state"], problem.names.index(name)
    evaluate = _evaluator(problem, estimate.details["models"], problem.joint, estimate.sigmas)
    found = {state.u[i]: state.cost}
    size = float(np.clip(step / np.sqrt(max(1e-12, _curvature(state, i))), 1e-4, 0.5))
    for side in (-1.0, 1.0):
        current: State | None = state
        for k in range(1, FARTHEST + 1):
            low, high = (limit.copy() for limit in problem.space.limits)
            target = state.u[i] + side * k * size
            if current is None or not low[i] <= target <= high[i]:
                break
            low[i] = high[i] = target
            current = _conditional(evaluate, current, i, target, (low, high))
            if current is None:
                break
            found[target] = current.cost
            if current.cost - min(found.values()) > THRESHOLD:
                break
    us = np.array(sorted(found))
    rise = np.array([found[u] for u in us]) - min(found.values())
    values = np.array([problem.space.to_values(np.where(np.arange(len(state.u)) == i, u, state.u))[i] for u in us])
    return Profile(name, problem.mechanism.units[name], values, rise, _crossings(values, rise))


def _curvature(state: State, i: int) -> float:
    S = reduced(state)[0]
    return 1 / max(float(invert(S)[i, i]), 1e-300)


def _conditional(evaluate, state: State, i: int, target: float, limits) -> State | None:
    """The best fit with unknown i held, from the neighbouring one moved along its conditional optimum."""
    S, _, back = reduced(state)
    covariance = invert(S)
    du = covariance[:, i] / covariance[i, i] * (target - state.u[i])
    u = np.clip(state.u + du, *limits)
    locals_ = [x if X is None else x - X[:, : len(u)] @ (u - state.u) for x, X in zip(state.locals, back, strict=True)]
    first = evaluate(u, locals_, True)
    if first is None:
        return None
    return levenberg_marquardt(evaluate, first, limits, iterations=15).state


def _crossings(values: np.ndarray, rise: np.ndarray) -> tuple[float, float]:
    best = int(np.argmin(rise))
    low, high = -np.inf if values[0] < 0 else 0.0, np.inf
    if best > 0 and rise[0] > THRESHOLD:
        inside = int(np.flatnonzero(rise[:best] > THRESHOLD).max())
        low = float(np.interp(THRESHOLD, rise[[inside + 1, inside]], values[[inside + 1, inside]]))
    if best < len(rise) - 1 and rise[-1] > THRESHOLD:
        inside = best + 1 + int(np.flatnonzero(rise[best + 1 :] > THRESHOLD).min())
        high = float(np.interp(THRESHOLD, rise[[inside - 1, inside]], values[[inside - 1, inside]]))
    return low, high
