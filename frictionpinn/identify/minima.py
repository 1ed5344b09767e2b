"""Several minima of one likelihood, and what they mean for the uncertainty."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from .advice import invert
from .solve import Evaluate, Solution, State, reduced

LONGEST = 1.0  # in log u: of a step beside a minimum
FAR = 4.0  # standard errors: the neighbours, where a rugged likelihood may tell much less
SETTLED = 0.2  # log-likelihood: a point that is as near to the minimum as that lies in it
FORGOTTEN, SAME = 6.0, 0.02  # log-likelihood: a minimum farther behind counts no more; in log u: the same minimum


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


def returned(best: State) -> Callable[[State], bool]:
    """Whether a state lies in the minimum of ``best``: as near as a fraction of its errors, and about as low."""
    S = reduced(best)[0]

    def visited(state: State) -> bool:
        d = state.u - best.u
        return bool(0.5 * d @ S @ d < SETTLED and abs(state.cost - best.cost) < SETTLED)

    return visited


def neighbours(evaluate: Evaluate, state: State, limits: tuple[np.ndarray, np.ndarray]) -> list[State]:
    """Points on both sides along the weakest direction, with derivatives: what the data would tell there."""
    direction = _weakest(state)[1]
    found = [evaluate(*moved(state, side * FAR * direction, limits), True) for side in (-1.0, 1.0)]
    return [other for other in found if other is not None]


def information_of(
    minima: Sequence[Solution], final: State | None = None, known: np.ndarray | float = 0.0
) -> np.ndarray:
    """Information on u, shape (n_g, n_g), of a likelihood with several minima: Laplace's approximation at each.

    The covariance is sum_k w_k (S_k^-1 + d_k d_k') with d_k the distance from the best and w_k in proportion to
    exp(-cost_k) / sqrt(det S_k); with one minimum it is S^-1.

    Args:
        minima: best first.
        final: the best after a last refinement, at other noise levels: its cost does not compare with the others'.
        known: information in each S_k that is no data's, shape (n_g, n_g): the prior's.
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
            parts.append((state.u, S - known, best.cost - cost - 0.5 * logdet))
    if len(parts) == 1:
        return parts[0][1]
    weights = np.exp(np.array([w for _, _, w in parts]) - max(w for _, _, w in parts))
    weights /= weights.sum()
    covariance = sum(
        w * (invert(S) + np.outer(u - final.u, u - final.u)) for w, (u, S, _) in zip(weights, parts, strict=True)
    )
    return invert(np.asarray(covariance))
