"""From where a search ended to the estimate: noise levels, covariance, intervals, outcome, advice."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence

import numpy as np

from ..numerics.whiteness import correlation_time
from .advice import advise, invert, lowest, untold, widening
from .minima import information_of
from .problem import Problem
from .profile import profiled
from .result import AT_BOUND, CONVERGED, FAILED, NO_EXCITATION, STOPPED, UNEXPLAINED, UNIDENTIFIED, Estimate, interval
from .solve import Solution, State, reduced
from .space import Space
from .trial import TrialModel

RISE = 1.920729  # half the 95 % quantile of chi-squared with one degree of freedom
BUDGET = "budget"  # why a search ended that ran out of simulations
SHARP = 0.25  # standard error over the value (of mu_s: its excess over mu_c), beyond which a likelihood is no parabola
WIDEST = 4.0  # factor by which a standard error grows at most for what its neighbours tell


def estimated_sigmas(problem: Problem, models: Sequence[TrialModel], state: State) -> dict[str, float]:
    """Noise standard deviations from the residuals, degrees of freedom taken off; given ones stay."""
    result = {}
    for name in problem.sigmas:
        rows = [piece.residuals[name] for piece in state.pieces if name in piece.residuals]
        r = np.concatenate(rows) if rows else np.zeros(0)
        r = r[~np.isnan(r)]
        used = sum(_freedom(model, name, problem.sigmas) for model in models)
        if name in problem.channels.outputs:
            used += (len(problem.names) + sum(len(m.states) for m in models)) / len(problem.channels.outputs)
        keep = name in problem.given or len(r) < 2 * used + 5
        floor = 1e-6 * float(np.sqrt(np.mean(r**2))) if len(r) else 0.0
        result[name] = problem.sigmas[name] if keep else max(problem.loss.sigma(r, len(r) - used), floor, 1e-12)
    return result


def _freedom(model: TrialModel, name: str, sigmas: Mapping[str, float]) -> float:
    """Spline coefficients that one input signal determines: trace of its share of the normal matrix."""
    for item in model.inputs:
        if name in item.names:
            parts = [
                design.T @ design / sigmas[signal] ** 2
                for design, signal in zip(item.basis.design, item.names, strict=True)
                if signal in sigmas
            ]
            own = [signal for signal in item.names if signal in sigmas].index(name)
            return float(np.trace(np.linalg.solve(sum(parts), parts[own])))
    return 0.0


def finish(
    problem: Problem,
    models: Sequence[TrialModel],
    solution: Solution,
    sigmas: dict[str, float],
    seconds: float,
    n_simulations: int,
    estimator: str = "maximum_likelihood",
    minima: Sequence[Solution] = (),
    beside: Sequence[State] = (),
    profiles: bool = True,
    white: bool = True,
) -> Estimate:
    """Assemble the estimate from where the search ended.

    ``minima`` are what was found, ``beside`` points where the data may tell less: both widen the intervals.
    These are those of the data alone, without the prior: from the likelihood's curvature where a parameter is told to
    ``SHARP`` of itself, else from its profile, to one side or to both.
    """
    state, space = solution.state, problem.space
    information = information_of(minima or [solution], state, problem.prior.information)
    low, high = space.limits
    width = np.where(np.isfinite(high - low), np.maximum(high - low, 1e-12), 1.0)
    at = (state.u - low < 1e-4 * width) | (high - state.u < 1e-4 * width)
    rows: dict[str, list[np.ndarray]] = {}
    for piece in state.pieces:
        for name in problem.channels.outputs:
            rows.setdefault(name, []).append(np.nan_to_num(piece.residuals[name] / sigmas[name]))
    flat = np.concatenate([r for columns in rows.values() for r in columns])
    factor = widening(rows) * problem.loss.inflation(flat)
    mask = untold(space, state.u, information / factor) & ~at & (solution.reason != BUDGET)  # there: where it got
    covariance = covariance_of(space, state.u, information, mask, at) * factor
    covariance = _widened(space, state.u, covariance, beside, factor)
    p = space.to_values(state.u)
    ends = at & at_limits(problem, p)
    errors = np.sqrt(np.diag(covariance))
    positive = space.scales == 0
    slides = any(motion.fast.any() for motion in problem.motions)
    fastest = max(float(np.abs(motion.v_slip).max()) for motion in problem.motions) if slides else 0.0
    at_bound = {name: value for name, value, hit in zip(space.names, p.tolist(), at & ~ends, strict=True) if hit}
    limits = {name: value for name, value, hit in zip(space.names, p.tolist(), ends, strict=True) if hit}
    smooth = {name for model in models for item in model.inputs for name in item.names}
    rough = [name for name in problem.channels.input_names if problem.joint and name in sigmas and name not in smooth]
    ci95 = {n: interval(p[i], errors[i], bool(positive[i])) for i, n in enumerate(space.names)}
    ci95 |= {n: one_sided(state, space, space.names.index(n), factor) for n in limits}
    evaluate = problem.evaluator(models, sigmas, prior=False)
    for i, name in enumerate(space.names):
        blunt = positive[i] and name not in limits and not errors[i] < SHARP * _own(space, state.u)[i]
        if profiles and blunt and (slides or not at[i]):
            ci95[name] = profiled(problem, evaluate, state, name, factor=factor, iterations=6).ci95
    at_bound = {name: value for name, value in at_bound.items() if name in problem.bounded}
    told = {n: ends for n, ends in ci95.items() if positive[space.names.index(n)] and n not in at_bound}
    outcome = CONVERGED if solution.reason in ("converged", "stuck") else STOPPED
    open_ended = [
        n
        for n, (low_end, high_end) in told.items()
        if low_end <= lowest(space, p, n) and (np.isinf(high_end) or space.below[space.names.index(n)] >= 0)
    ]
    outcome = outcome if white else UNEXPLAINED
    outcome = AT_BOUND if at_bound else UNIDENTIFIED if mask.any() or open_ended else outcome
    outcome = NO_EXCITATION if not slides or mask.all() else outcome
    memory_time = max(correlation_time(columns) for columns in rows.values())
    advice = advise(
        problem.mechanism, space, p, covariance, mask, at_bound, limits, rough, fastest, memory_time, told, white
    )
    details = {"state": state, "models": tuple(models), "iterations": solution.iterations, "reason": solution.reason,
               "minima": tuple(minima)}  # fmt: skip
    return Estimate(
        estimator, space.names, dict(zip(space.names, p.tolist(), strict=True)),
        {name: problem.mechanism.units[name] for name in space.names}, covariance,
        ci95, outcome, advice, state.cost, n_simulations, seconds, sigmas,
        {model.trial: piece.residuals for model, piece in zip(models, state.pieces, strict=True)},
        details | {"values": space.to_values(state.u).tolist()},
    )  # fmt: skip


def _own(space: Space, u: np.ndarray) -> np.ndarray:
    """What each parameter is told beside: itself, or its excess over the one that it must exceed, shape (n,)."""
    p = space.to_values(u)
    return np.array([p[i] - (p[lower] if lower >= 0 else 0.0) for i, lower in enumerate(space.below)])


def at_limits(problem: Problem, p: np.ndarray) -> np.ndarray:
    """Which free parameters are strengths of effects at a physical limit (no drag, all of the dry friction)."""
    table = {par.name: par for par in problem.mechanism.parameters}
    pars = [table[name] for name in problem.names]
    return np.array([par.neutral is not None and v in (par.low, par.high) for par, v in zip(pars, p, strict=True)])


def one_sided(state: State, space: Space, i: int, factor: float) -> tuple[float, float]:
    """95 % interval, SI units, of a parameter at its bound: how far inside the cost rises by 1.92 (times ``factor``).

    The others move with it: with slope g and curvature S of the profile, g d + S d^2 / 2 = 1.92 at the distance d.
    """
    S, gradient, _ = reduced(state)
    curvature, slope = 1 / max(float(invert(S)[i, i]), 1e-300), abs(float(gradient[i]))
    rise = RISE * factor
    d = 2 * rise / (slope + np.sqrt(slope**2 + 2 * curvature * rise))
    low, high = space.limits
    inside = state.u.copy()
    upwards = state.u[i] - low[i] < high[i] - state.u[i]
    inside[i] = np.clip(state.u[i] + (d if upwards else -d), low[i], high[i])
    ends = sorted([float(space.to_values(state.u)[i]), float(space.to_values(inside)[i])])
    return ends[0], ends[1]


def _widened(space: Space, u: np.ndarray, covariance: np.ndarray, beside: Sequence[State], factor: float) -> np.ndarray:
    """Scale the covariance, shape (n, n), so that no relative error is below what the data would tell beside.

    One slip more or less in a recording changes what it tells threefold, and the noise decides which side is fitted.
    """
    own = np.sqrt(covariance.diagonal()) / _units(space, u)
    largest = np.ones(len(u))
    for state in beside:
        T = space.jacobian(state.u)
        there = np.sqrt(np.maximum((T @ invert(reduced(state)[0]) @ T.T).diagonal() * factor, 0.0))
        largest = np.fmax(largest, there / _units(space, state.u) / own)
    largest = np.minimum(largest, WIDEST)
    return covariance * np.outer(largest, largest)


def _units(space: Space, u: np.ndarray) -> np.ndarray:
    return np.where(space.scales > 0, 1.0, np.abs(space.to_values(u)))


def covariance_of(
    space: Space, u: np.ndarray, information: np.ndarray, hidden: np.ndarray, held: np.ndarray | None = None
) -> np.ndarray:
    """Covariance of the parameters in SI units, shape (n, n).

    NaN for those that are ``held`` (at a bound: the others are given them) and those ``hidden`` in the data (unknown:
    the others' errors include that).
    """
    held = np.zeros(len(u), dtype=bool) if held is None else held
    inner = np.flatnonzero(~held)
    result = np.full((len(u), len(u)), np.nan)
    T = space.jacobian(u)[np.ix_(inner, inner)]
    result[np.ix_(inner, inner)] = T @ invert(information[np.ix_(inner, inner)]) @ T.T
    result[hidden, :] = result[:, hidden] = np.nan
    return result


def failed(problem: Problem, began: float, before: int) -> Estimate:
    """The estimate of a problem that could not be simulated at any start."""
    n, nan = len(problem.names), float("nan")
    advice = "no start within the bounds could be simulated: check bounds, units and the mechanism's parameters"
    return Estimate(
        "maximum_likelihood", problem.names, dict.fromkeys(problem.names, nan),
        {name: problem.mechanism.units[name] for name in problem.names}, np.full((n, n), nan),
        dict.fromkeys(problem.names, (nan, nan)), FAILED, (advice,), nan, problem.simulations - before,
        time.perf_counter() - began, dict(problem.sigmas),
    )  # fmt: skip
