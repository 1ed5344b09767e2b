"""Profile likelihood: an interval for a parameter whose likelihood is not quadratic."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..errors import UserError
from ..numerics.descent import levenberg_marquardt
from ..numerics.quadratic import Evaluate, State, invert, moved, reduced
from ..show import readable_unit
from .problem import Problem
from .result import Estimate

RISE_95 = 1.920729  # of the cost at the ends of a 95 % interval: half the quantile of chi-squared with one freedom
STEP = 0.7  # standard errors between the values tried
STEEP = 4.0  # times the parabola's rise, twice as steep: beyond, a stop was lost, and a nearer end is the parabola's
FARTHEST, LONGEST = 12, 0.5  # steps to either side; length of one in log u at most: 12 reach a factor of 400


@dataclass(frozen=True)
class Profile:
    """Cost of the best fit at fixed values of one parameter.

    Attributes:
        name, unit: of the parameter.
        values: where it was held, SI units, increasing, shape (n,).
        cost: rise of the cost above its least value, shape (n,).
        ci95: where the rise is 1.92; infinite (0 below) where it stays lower within the bounds.
        lowest: the best of these fits.
    """

    name: str
    unit: str
    values: np.ndarray
    cost: np.ndarray
    ci95: tuple[float, float]
    lowest: State = field(repr=False)

    def __str__(self) -> str:
        low, high = self.ci95
        rows = "\n".join(f"  {v:.5g} {c:.2f}" for v, c in zip(self.values, self.cost, strict=True))
        unit = readable_unit(self.unit)
        return f"{self.name} in [{low:.4g}, {high:.4g}] {unit} (95 %); value, rise of the cost:\n{rows}"


def profile(problem: Problem, estimate: Estimate, name: str) -> Profile:
    """Profile likelihood of a parameter around an estimate by maximum likelihood of this problem.

    Args:
        problem, estimate: what was solved, and its solution.
        name: parameter.

    Raises:
        UserError: an unknown name, or an estimate that failed or came from another method.

    Source: Raue et al., Structural and practical identifiability analysis, Bioinformatics 25 (2009).
    """
    if name not in problem.names:
        raise UserError("unknown parameter", where="profile", received=name, allowed=", ".join(problem.names))
    if estimate.minimum is None:
        raise UserError("no fit to start from", where="profile", received=estimate.outcome, allowed="that of a fit")
    evaluate = problem.evaluator(estimate.minimum.models, estimate.sigmas, prior=False)
    return profiled(problem, evaluate, estimate.minimum.state, name, RISE_95, iterations=15)


def profiled(problem: Problem, evaluate: Evaluate, state: State, name: str, rise: float, iterations: int) -> Profile:
    """The profile of a parameter from a fit ``state`` on: every value from the fit at the one before, to either side.

    ``evaluate`` is the cost of the data alone; where that has risen by more than ``rise`` the profile ends.
    """
    space, i = problem.space, problem.names.index(name)
    prior = problem.prior.distance(state.u)
    found, lowest = {state.u[i]: state.cost - 0.5 * float(prior @ prior)}, state
    curvature = 1 / max(float(invert(reduced(state)[0])[i, i]), 1e-300)
    size = float(np.clip(STEP / np.sqrt(max(1e-12, curvature)), 1e-4, LONGEST))
    for side in (-1.0, 1.0):
        current = state
        for k in range(1, FARTHEST + 1):
            low, high = (limit.copy() for limit in space.limits)
            target = float(np.clip(state.u[i] + side * k * size, low[i], high[i]))
            if target in found:
                break
            low[i] = high[i] = target
            covariance = invert(reduced(current)[0])  # the others move along their conditional optimum
            along = covariance[:, i] / covariance[i, i] * (target - current.u[i])
            first = evaluate(*moved(current, along, (low, high), longest=np.inf), True)
            if first is None:
                break
            current = levenberg_marquardt(evaluate, first, (low, high), iterations=iterations, decrease=0.05).state
            lowest = current if current.cost < min(found.values()) else lowest
            found[target] = current.cost
            if current.cost - min(found.values()) > rise:
                break

    def value(u: float) -> float:
        return float(space.to_values(np.where(np.arange(len(state.u)) == i, u, state.u))[i])

    us = np.array(sorted(found))
    costs, parabola = np.array([found[u] for u in us]) - min(found.values()), curvature * (us - state.u[i]) ** 2 / 2
    best, above = int(np.argmin(costs)), np.flatnonzero(costs > rise)
    least = 0.0 if space.below[i] < 0 else float(space.to_values(state.u)[space.below[i]])
    ends = [-np.inf if space.scales[i] else least, np.inf]  # where the cost stays lower within the bounds
    for side, beyond in ((-1, above[above < best][-1:]), (1, above[above > best][:1])):
        for k, inside in zip(beyond, beyond - side, strict=True):
            end = np.interp(rise, costs[[inside, k]], us[[inside, k]])
            if costs[k] > rise + STEEP * parabola[k]:
                end = side * max(side * us[inside], side * state.u[i] + np.sqrt(2 * rise / curvature))
            ends[side > 0] = value(end)
    values = np.array([value(u) for u in us])
    return Profile(name, problem.mechanism.read_in[name], values, costs, (ends[0], ends[1]), lowest)
