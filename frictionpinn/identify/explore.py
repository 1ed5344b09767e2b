"""Several minima of one likelihood: how they are found, and what they mean for the uncertainty."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from .advice import invert
from .parallel import in_parallel
from .solve import KNOWN, Evaluate, Solution, State, levenberg_marquardt, reduced

OFFSETS, LONGEST = (0.8, 1.6, 2.4), 1.0  # standard errors; in log u: where to restart
FAR = 4.0  # standard errors: the neighbours, where a rugged likelihood may tell much less
LEFT = 2.5  # log-likelihood: a point that lies by more above the quadratic model belongs to another minimum
SHORT, LONG = 5, 15  # iterations of a search that may be given up, and that is worth finishing
ENOUGH = 0.03  # gain in log-likelihood below which a search ends: the best minimum is refined later
SETTLED = 0.2  # log-likelihood: a restart that is as near to the minimum as that has returned to it
ROUNDS, WORTH = 3, 1.0  # of restarts at most; gain in log-likelihood that is worth another
SLIGHT = 0.1  # of what is left beyond noise: a gain below is not worth another round either
PAIRS, SPREAD = 1, 1.5  # of restarts on opposite sides; their distance in standard errors
NEAR, FORGOTTEN, SAME = 4.0, 6.0, 0.02  # log-likelihood: worth finishing, counted at all; in log u: the same minimum


def explore(evaluate: Evaluate, found: Solution, limits: tuple[np.ndarray, np.ndarray]) -> list[Solution]:
    """Restart around the minimum, as far as the data leave it open, while that finds a lower one.

    There the likelihood is rugged on the scale of its standard errors: a slip that sets in just above or just below
    the breakaway force makes a kink that stops a descent.

    Returns:
        the minima found, best first.
    """
    minima, generator = [found], np.random.default_rng(0)
    for _ in range(ROUNDS):
        best = minima[0]
        points, back = _around(evaluate, best.state, limits, generator), returned(best.state)

        def restarted(k: int, points=points, best=best, visited=back) -> Solution | None:
            u, locals_ = points[k]
            first = evaluate(u, locals_, True)
            if first is None:
                return None
            found = descend(evaluate, first, limits, best.state.cost, visited)
            return best if found.reason == KNOWN else found

        others = in_parallel(restarted, [1.0] * len(points))
        minima = sorted([*minima, *(o for o in others if o is not None)], key=lambda solution: solution.state.cost)
        if not points or minima[0].state.cost > best.state.cost - max(WORTH, SLIGHT * _misfit(best.state)):
            break
    return minima


def _misfit(state: State) -> float:
    """Cost beyond that of noise alone, half a unit for every sample; above 0 only where the model lacks something."""
    count = sum(int(np.count_nonzero(~np.isnan(r))) for piece in state.pieces for r in piece.residuals.values())
    return state.cost - 0.5 * count


def _weakest(state: State) -> tuple[np.ndarray, np.ndarray]:
    """Information, shape (n_g, n_g), and the step of one standard error where it is least, shape (n_g,)."""
    S = reduced(state)[0]
    values, vectors = np.linalg.eigh(S)
    return S, vectors[:, 0] / np.sqrt(max(values[0], 1e-12))


def moved(state: State, step: np.ndarray, limits: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, list]:
    """Global unknowns after a step, shape (n_g,), and the local ones of every trial as the quadratic model moves them.

    With the model's minimum at the state, x_l moves by -C^-1 B' times the step of u.
    """
    back, n = reduced(state)[2], len(state.u)
    u = np.clip(state.u + step * min(1.0, LONGEST / max(np.abs(step).max(), 1e-12)), *limits)
    return u, [x if X is None else x - X[:, :n] @ (u - state.u) for x, X in zip(state.locals, back, strict=True)]


def descend(
    evaluate: Evaluate,
    first: State,
    limits: tuple[np.ndarray, np.ndarray],
    rival: float,
    visited: Callable[[State], bool] | None = None,
) -> Solution:
    """Levenberg-Marquardt search, given up early where it does not come near the cost ``rival`` or is ``visited``."""
    found = levenberg_marquardt(evaluate, first, limits, iterations=SHORT, decrease=ENOUGH, visited=visited)
    if found.reason in ("converged", KNOWN) or found.state.cost > rival + NEAR:
        return found
    return levenberg_marquardt(evaluate, found.state, limits, iterations=LONG, decrease=ENOUGH, visited=visited)


def returned(best: State) -> Callable[[State], bool]:
    """Whether a state lies in the minimum of ``best``: as near as a fraction of its errors, and about as low."""
    S = reduced(best)[0]

    def visited(state: State) -> bool:
        d = state.u - best.u
        return bool(0.5 * d @ S @ d < SETTLED and abs(state.cost - best.cost) < SETTLED)

    return visited


def _around(
    evaluate: Evaluate, state: State, limits: tuple[np.ndarray, np.ndarray], generator: np.random.Generator
) -> list[tuple[np.ndarray, list]]:
    """Unknowns (global, local) to restart from: none where nothing lies beside the minimum.

    Points drawn from the quadratic model, in opposite pairs, and those that have left the minimum along its weakest
    direction.
    """
    sides = _beside(evaluate, state, limits)
    if not sides:
        return []
    values, vectors = np.linalg.eigh(reduced(state)[0])
    scale = vectors / np.sqrt(np.maximum(values, 1e-12))
    draws = [SPREAD * scale @ generator.standard_normal(len(state.u)) for _ in range(PAIRS)]
    return [*((side.u, list(side.locals)) for side in sides),
            *(moved(state, sign * draw, limits) for draw in draws for sign in (1.0, -1.0))]  # fmt: skip


def _beside(evaluate: Evaluate, state: State, limits: tuple[np.ndarray, np.ndarray]) -> list[State]:
    """The first point on each side along the weakest direction that has left the minimum, if there is one.

    Local unknowns move as the quadratic model says. Where the cost rises as it does, nothing lies beside.
    """
    direction, result = _weakest(state)[1], []
    for side in (-1.0, 1.0):
        for size in OFFSETS:
            other = evaluate(*moved(state, side * size * direction, limits), False)
            if other is not None and other.cost > state.cost + size**2 / 2 + LEFT:
                result.append(other)
                break
    return result


def neighbours(evaluate: Evaluate, state: State, limits: tuple[np.ndarray, np.ndarray]) -> list[State]:
    """Points on both sides along the weakest direction, with derivatives: what the data would tell there."""
    direction = _weakest(state)[1]
    found = [evaluate(*moved(state, side * FAR * direction, limits), True) for side in (-1.0, 1.0)]
    return [other for other in found if other is not None]


def information_of(minima: Sequence[Solution], final: State | None = None) -> np.ndarray:
    """Information on u, shape (n_g, n_g), of a likelihood with several minima: Laplace's approximation at each.

    The covariance is sum_k w_k (S_k^-1 + d_k d_k') with d_k the distance from the best and w_k in proportion to
    exp(-cost_k) / sqrt(det S_k); with one minimum it is S^-1.

    Args:
        minima: best first.
        final: the best after a last refinement, at other noise levels: its cost does not compare with the others'.
    """
    best = minima[0].state
    final = final or best
    parts: list[tuple[np.ndarray, np.ndarray, float]] = []
    for solution in minima:
        state, cost = (final, best.cost) if solution is minima[0] else (solution.state, solution.state.cost)
        if cost > best.cost + FORGOTTEN or any(np.abs(state.u - u).max() < SAME for u, _, _ in parts):
            continue
        S = reduced(state)[0]
        sign, logdet = np.linalg.slogdet(S)
        if sign > 0 or not parts:
            parts.append((state.u, S, best.cost - cost - 0.5 * logdet))
    if len(parts) == 1:
        return parts[0][1]
    weights = np.exp(np.array([w for _, _, w in parts]) - max(w for _, _, w in parts))
    weights /= weights.sum()
    covariance = sum(
        w * (invert(S) + np.outer(u - final.u, u - final.u)) for w, (u, S, _) in zip(weights, parts, strict=True)
    )
    return invert(np.asarray(covariance))
