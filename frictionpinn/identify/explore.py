"""Several minima of one likelihood: how they are found, and what they mean for the uncertainty."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .advice import invert
from .solve import Evaluate, Solution, State, levenberg_marquardt, reduced

OFFSETS, LONGEST = (0.8, 1.6, 2.4), 1.0  # standard errors; in log u: where to restart
SHORT, LONG = 5, 15  # iterations of a search that may be given up, and that is worth finishing
ROUNDS, WORTH = 2, 1.0  # of restarts at most; gain in log-likelihood that is worth another
NEAR, FORGOTTEN, SAME = 4.0, 6.0, 0.02  # log-likelihood: worth finishing, counted at all; in log u: the same minimum


def explore(evaluate: Evaluate, found: Solution, limits: tuple[np.ndarray, np.ndarray]) -> list[Solution]:
    """Restart along the direction that the data tell least, on both sides, while that finds a lower minimum.

    There the likelihood is rugged on the scale of its standard errors: a slip that sets in just above or just below
    the breakaway force makes a kink that stops a descent.

    Returns:
        the minima found, best first.
    """
    minima = [found]
    for _ in range(ROUNDS):
        best = minima[0]
        for side in _beside(evaluate, best.state, limits):
            first = evaluate(side.u, side.locals, True)
            if first is None:
                continue
            other = descend(evaluate, first, limits, minima[0].state.cost)
            minima.append(other)
        minima.sort(key=lambda solution: solution.state.cost)
        if minima[0].state.cost > best.state.cost - WORTH:
            break
    return minima


def descend(evaluate: Evaluate, first: State, limits: tuple[np.ndarray, np.ndarray], rival: float) -> Solution:
    """Levenberg-Marquardt search that is given up early where it does not come near the cost ``rival``."""
    found = levenberg_marquardt(evaluate, first, limits, iterations=SHORT)
    if found.reason == "converged" or found.state.cost > rival + NEAR:
        return found
    return levenberg_marquardt(evaluate, found.state, limits, iterations=LONG)


def _beside(evaluate: Evaluate, state: State, limits: tuple[np.ndarray, np.ndarray]) -> list[State]:
    """The lowest point on each side along the weakest direction, local unknowns moved as the quadratic model says."""
    S, _, back = reduced(state)
    values, vectors = np.linalg.eigh(S)
    direction, n = vectors[:, 0] / np.sqrt(max(values[0], 1e-12)), len(state.u)
    result = []
    for side in (-1.0, 1.0):
        tried = []
        for size in OFFSETS:
            u = np.clip(state.u + np.clip(side * size * direction, -LONGEST, LONGEST), *limits)
            locals_ = [
                x if X is None else x - X[:, :n] @ (u - state.u) for x, X in zip(state.locals, back, strict=True)
            ]
            tried.append(evaluate(u, locals_, False))
        simulated = [other for other in tried if other is not None]
        if simulated:
            result.append(min(simulated, key=lambda other: other.cost))
    return result


def information_of(minima: Sequence[Solution]) -> np.ndarray:
    """Information on u, shape (n_g, n_g), of a likelihood with several minima: Laplace's approximation at each.

    The covariance is sum_k w_k (S_k^-1 + d_k d_k') with d_k the distance from the best and w_k in proportion to
    exp(-cost_k) / sqrt(det S_k); with one minimum it is S^-1.
    """
    best = minima[0].state
    parts: list[tuple[np.ndarray, np.ndarray, float]] = []
    for solution in minima:
        state = solution.state
        if state.cost > best.cost + FORGOTTEN or any(np.abs(state.u - u).max() < SAME for u, _, _ in parts):
            continue
        S = reduced(state)[0]
        sign, logdet = np.linalg.slogdet(S)
        if sign > 0 or not parts:
            parts.append((state.u, S, best.cost - state.cost - 0.5 * logdet))
    if len(parts) == 1:
        return parts[0][1]
    weights = np.exp(np.array([w for _, _, w in parts]) - max(w for _, _, w in parts))
    weights /= weights.sum()
    covariance = sum(
        w * (invert(S) + np.outer(u - best.u, u - best.u)) for w, (u, S, _) in zip(weights, parts, strict=True)
    )
    return invert(np.asarray(covariance))
