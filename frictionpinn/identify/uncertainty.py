"""From where a search ended to the estimate: information, covariance, intervals."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..numerics.descent import BUDGET
from ..numerics.quadratic import Evaluate, Limits, State, invert, moved, reduced
from ..numerics.whiteness import NORMAL_95, correlation_time
from ..progress import counted
from .culprit import culprit
from .problem import Problem
from .profile import RISE_95, profiled
from .result import CORRELATED, FAILED, Estimate, Minimum, verdict
from .space import Space

ESTIMATOR = "maximum_likelihood"
UNTOLD = 1.0  # standard error of a logarithm: a 95 % interval of a factor 50
SHARP = 0.25  # standard error over the value (of mu_s: its excess over mu_c), beyond which a likelihood is no parabola
BESIDE = 4.0  # standard errors to the neighbours, where a rugged likelihood may tell much less
WIDEST = 4.0  # factor by which a standard error grows at most for what its neighbours tell


def neighbours(evaluate: Evaluate, state: State, limits: Limits) -> list[State]:
    """Points on both sides of a minimum along the weakest direction, with derivatives: what the data would tell there.

    One slip more or less in a recording changes what it tells threefold, and the noise decides which side is fitted.
    """
    values, vectors = np.linalg.eigh(reduced(state)[0])
    step = BESIDE * vectors[:, 0] / np.sqrt(max(values[0], 1e-12))
    found = [evaluate(*moved(state, side * step, limits), True) for side in (-1.0, 1.0)]
    return [other for other in found if other is not None]


def widened(space: Space, u: np.ndarray, covariance: np.ndarray, beside: Sequence[State], factor: float) -> np.ndarray:
    """Scale the covariance, shape (n, n), so that no relative error is below what the data would tell ``beside``.

    ``factor`` is that on the inverse of the information there.
    """

    def unit(u: np.ndarray) -> np.ndarray:
        return np.where(space.scales > 0, 1.0, np.abs(space.to_values(u)))

    own, largest = np.sqrt(covariance.diagonal()) / unit(u), np.ones(len(u))
    for state in beside:
        T = space.jacobian(state.u)
        there = np.sqrt(np.maximum((T @ invert(reduced(state)[0]) @ T.T).diagonal() * factor, 0.0))
        largest = np.fmax(largest, there / unit(state.u) / own)
    largest = np.minimum(largest, WIDEST)
    return covariance * np.outer(largest, largest)


def untold(space: Space, u: np.ndarray, information: np.ndarray) -> np.ndarray:
    """Mask of the parameters that do not move the output, or no differently than the others, shape (n,).

    ``information`` is that on the search vector u, shape (n, n).
    """
    T = space.jacobian(u)
    covariance = T @ invert(information) @ T.T
    value = np.where(space.scales > 0, space.scales, space.to_values(u))
    error = np.sqrt(np.maximum(covariance.diagonal(), 0.0)) / np.maximum(np.abs(value), 1e-300)
    alone = np.sqrt(np.maximum(information.diagonal(), 0.0))
    return ~((error <= UNTOLD) & (alone * UNTOLD > 1.0))


def covariance_of(
    space: Space, u: np.ndarray, information: np.ndarray, hidden: np.ndarray, held: np.ndarray | None = None
) -> np.ndarray:
    """Covariance of the parameters in SI units, shape (n, n).

    NaN for those that are ``held`` (at a bound: the others are given them) and those ``hidden`` in the data (unknown:
    the others' errors include that).
    """
    inner = np.arange(len(u)) if held is None else np.flatnonzero(~held)
    result = np.full((len(u), len(u)), np.nan)
    T = space.jacobian(u)[np.ix_(inner, inner)]
    result[np.ix_(inner, inner)] = T @ invert(information[np.ix_(inner, inner)]) @ T.T
    result[hidden, :] = result[:, hidden] = np.nan
    return result


def interval(value: float, std: float, positive: bool) -> tuple[float, float]:
    """95 % interval, symmetric in the logarithm of a positive parameter; NaN where there is none."""
    if not (np.isfinite(value) and np.isfinite(std)):
        return (np.nan, np.nan)
    if positive and value > 0:
        reach = float(np.exp(min(NORMAL_95 * std / value, 700.0)))
        return (float(value / reach), float(value * reach))
    return (float(value - NORMAL_95 * std), float(value + NORMAL_95 * std))


def one_sided(space: Space, state: State, i: int, rise: float) -> tuple[float, float]:
    """95 % interval, SI units, of parameter i at its bound: how far inside the cost rises by ``rise``.

    The others move with it: with slope g and curvature S of the profile, g d + S d^2 / 2 = rise at the distance d.
    """
    S, gradient, _ = reduced(state)
    curvature, slope = 1 / max(float(invert(S)[i, i]), 1e-300), abs(float(gradient[i]))
    d = 2 * rise / (slope + np.sqrt(slope**2 + 2 * curvature * rise))
    (low, high), inside = space.limits, state.u.copy()
    upwards = state.u[i] - low[i] < high[i] - state.u[i]
    inside[i] = np.clip(state.u[i] + (d if upwards else -d), low[i], high[i])
    least, most = sorted(float(space.to_values(u)[i]) for u in (state.u, inside))
    return least, most


def finish(
    problem: Problem,
    minimum: Minimum,
    sigmas: dict[str, float],
    seconds: float,
    simulations: int,
    *,
    beside: Sequence[State] = (),
    profiles: bool = True,
    white: bool = True,
) -> tuple[Estimate, State]:
    """The estimate from where the search ended, and the lowest fit that it or its profiles have seen.

    Intervals are those of the data alone, without the prior: from the likelihood's curvature where a parameter is told
    to ``SHARP`` of itself, else from its profile, to one side or to both. They are widened for points ``beside``
    where the data may tell less, and for residuals that stay correlated.

    Args:
        problem, minimum: what was solved, and where the search ended.
        sigmas: noise levels there, SI units.
        seconds, simulations: that it took.
        beside: see :func:`neighbours`.
        profiles: whether profiles may be asked for.
        white: whether the residuals are noise.
    """
    state, space = minimum.state, problem.space
    names, p, positive = space.names, space.to_values(state.u), space.scales == 0
    low, high = space.limits
    near = np.where(positive & np.isfinite(high - low), 1e-4 * (high - low), 0.0)  # one that may be 0 ends there
    at = (state.u - low <= near) | (high - state.u <= near)
    value, ends = space.named(state.u), np.flatnonzero(at)
    table = {par.name: par for par in problem.mechanism.parameters}
    physical = [space.low[i] == table[n].low if state.u[i] - low[i] <= near[i] else space.high[i] == table[n].high
                for i, n in enumerate(names)]  # fmt: skip
    at_limit = [names[i] for i in ends if table[names[i]].linear and physical[i]]
    at_bound = [names[i] for i in ends if names[i] in problem.bounded and names[i] not in at_limit]

    outputs = problem.channels.outputs
    rows = {name: [np.nan_to_num(piece.residuals[name] / sigmas[name]) for piece in state.pieces] for name in outputs}
    memory = max(correlation_time(own) for own in rows.values())
    factor = memory if memory > CORRELATED else 1.0
    factor *= problem.loss.inflation(np.concatenate([state.left(name) / sigmas[name] for name in outputs]))
    information = reduced(state)[0] - problem.prior.information
    mask = untold(space, state.u, information / factor) & ~at & (minimum.reason != BUDGET)  # there: where it got
    covariance = widened(space, state.u, covariance_of(space, state.u, information, mask, at) * factor, beside, factor)

    slides = any(motion.fast.any() for motion in problem.motions)
    evaluate = problem.evaluator(minimum.models, sigmas, prior=False)
    ci95, lowest, errors = {}, state, np.sqrt(np.diag(covariance))
    for i, name in enumerate(counted(names, "intervals")):
        least, most = interval(p[i], errors[i], bool(positive[i]))
        ci95[name] = max(least, table[name].low), min(most, table[name].high)
        blunt = positive[i] and not errors[i] < SHARP * space.own(state.u)[i]
        if name in at_limit:
            ci95[name] = one_sided(space, state, i, RISE_95 * factor)
        elif profiles and blunt and (slides or not at[i]):
            profile = profiled(problem, evaluate, state, name, RISE_95 * factor, iterations=6)
            lowest, (least, most) = min(lowest, profile.lowest, key=lambda end: end.cost), profile.ci95
            ci95[name] = min(least, p[i]), max(most, p[i])  # the prior, or a minimum that the profile left, holds it

    hidden = [names[i] for i in np.flatnonzero(mask)]
    outcome, advice = verdict(problem, minimum, covariance, ci95, hidden, at_limit, at_bound, memory, white)
    return Estimate(
        ESTIMATOR, names, value, {name: problem.mechanism.read_in[name] for name in names}, covariance, ci95, outcome,
        advice, state.cost, simulations, seconds, sigmas,
        {model.trial: piece.residuals for model, piece in zip(minimum.models, state.pieces, strict=True)},
        problem.prior.about, minimum,
    ), lowest  # fmt: skip


def failed(problem: Problem, seconds: float, simulations: int) -> Estimate:
    """The estimate of a problem that could not be simulated at any start."""
    names, nan = problem.names, float("nan")
    why = culprit(problem) or "check bounds, units and the mechanism's parameters"
    advice = f"no start within the bounds could be simulated: {why}"
    return Estimate(
        ESTIMATOR, names, dict.fromkeys(names, nan), {name: problem.mechanism.read_in[name] for name in names},
        np.full((len(names), len(names)), nan), dict.fromkeys(names, (nan, nan)), FAILED, (advice,), nan, simulations,
        seconds, dict(problem.sigmas),
    )  # fmt: skip
