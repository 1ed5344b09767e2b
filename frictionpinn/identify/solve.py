"""Levenberg-Marquardt with a few global unknowns and many that belong to one trial each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.linalg.lapack import dposv
from scipy.optimize import lsq_linear

from .trial import Piece

LONGEST_STEP = 1.0  # in log u: a parameter changes by at most a factor e in one step
FAINT = 0.01  # added to the curvature in log u: that of an unknown told to ten powers of e, which tells nothing
STUCK, PATIENCE = 1e12, 5  # damping beyond which no step will help; rejected steps in a row
TRUSTED = 0.75, 1.5  # decrease over that predicted
SMALL = 5.0  # times the decrease asked for: two steps in a row that gain less end the search (the cost has kinks)


@dataclass(frozen=True)
class State:
    """Unknowns and the cost's local model there.

    Attributes:
        u: global unknowns, shape (n_g,).
        locals: local unknowns of every trial.
        pieces: contributions of every trial, the global columns in u.
    """

    u: np.ndarray
    locals: tuple[np.ndarray, ...]
    pieces: tuple[Piece, ...]

    @property
    def cost(self) -> float:
        """Half the sum of squares (or of the robust cost)."""
        return sum(piece.cost for piece in self.pieces)

    @property
    def curved(self) -> bool:
        """Whether it was computed with derivatives."""
        return all(len(piece.gg) for piece in self.pieces)


@dataclass(frozen=True)
class Solution:
    """Where the search ended, after how many evaluations with derivatives and without, and why."""

    state: State
    iterations: int
    evaluations: int
    reason: str


KNOWN = "known"  # reason of a solution that was given, not searched
Evaluate = Callable[..., State | None]  # (u, locals, derivatives, **options of Problem.evaluate)


def reduced(state: State, damping: float = 0.0) -> tuple[np.ndarray, np.ndarray, list]:
    """Eliminate the local unknowns: Schur complement (n_g, n_g), its gradient (n_g,), and what back-substitution needs.

    With H = [[A, B], [B', C]] and C block diagonal over trials, S = A - sum_b B_b C_b^-1 B_b'. Damping adds
    ``damping`` times the diagonal of H first.
    """
    n = len(state.u)
    S, g = np.zeros((n, n)), np.zeros(n)
    back: list[np.ndarray | None] = []
    for piece in state.pieces:
        S += piece.gg
        g += piece.grad_g
    S[np.diag_indices(n)] *= 1 + damping
    for piece in state.pieces:
        if not len(piece.grad_l):
            back.append(None)
            continue
        scale = 1 / np.sqrt(piece.ll.diagonal())
        matrix = piece.ll * scale[:, None] * scale
        matrix[np.diag_indices_from(matrix)] = 1 + damping + 1e-13
        right = np.column_stack([piece.gl.T, piece.grad_l]) * scale[:, None]
        X = _solved(matrix, right) * scale[:, None]
        S -= piece.gl @ X[:, :n]
        g -= piece.gl @ X[:, n]
        back.append(X)
    return S, g, back


def _solved(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """matrix^-1 right of a positive definite matrix, without checks that take ten times as long for a small one."""
    X, fault = dposv(matrix, right)[1:]
    if fault:
        raise np.linalg.LinAlgError(f"not positive definite: minor {fault}")
    return X


def _step(
    state: State, damping: float, limits: tuple[np.ndarray, np.ndarray]
) -> tuple[np.ndarray, list[np.ndarray], float] | None:
    """Damped Gauss-Newton step (global, local) and the decrease that the quadratic model predicts for it.

    It minimises the model within the limits, and is shortened to ``LONGEST_STEP``. An unknown that hardly shows would
    go far, and hold back all the others: ``FAINT`` keeps it near.
    """
    S, g, back = reduced(state, damping)
    n = len(state.u)
    S[np.diag_indices(n)] += FAINT
    low, high = np.minimum(limits[0] - state.u, 0.0), np.maximum(limits[1] - state.u, 0.0)
    free = low < high
    du = np.zeros(n)
    if free.any():
        scale = 1 / np.sqrt(np.maximum(S.diagonal()[free], 1e-300))
        try:
            lower = cholesky(S[np.ix_(free, free)] * scale[:, None] * scale, lower=True)
        except np.linalg.LinAlgError:
            return None
        right = solve_triangular(lower, -scale * g[free], lower=True)
        found = solve_triangular(lower, right, lower=True, trans="T") * scale
        if np.any(found < low[free]) or np.any(found > high[free]):
            box = low[free] / scale, high[free] / scale
            found = lsq_linear(lower.T, right, box, method="bvls").x * scale
        du[free] = found
    du *= min(1.0, LONGEST_STEP / max(np.abs(du).max(initial=0.0), 1e-300))
    dl = [np.zeros(0) if X is None else -X[:, n] - X[:, :n] @ du for X in back]
    decrease = 0.0
    for piece, d in zip(state.pieces, dl, strict=True):
        decrease -= float(du @ piece.grad_g + 0.5 * du @ piece.gg @ du)
        if len(d):
            decrease -= float(d @ piece.grad_l + 0.5 * d @ piece.ll @ d + du @ piece.gl @ d)
    return du, dl, decrease


def levenberg_marquardt(
    evaluate: Evaluate,
    start: State,
    limits: tuple[np.ndarray, np.ndarray],
    *,
    iterations: int = 60,
    relative: float = 1e-10,
    decrease: float = 3e-3,
    damping: float = 1e-3,
) -> Solution:
    """Minimise the cost within bounds on the global unknowns.

    A trial step for which the model cannot be simulated is rejected like one that raises the cost. Steps end at the
    bounds: each minimises the quadratic model within them. The search ends where the cost changes by less than
    ``relative`` of itself, or the undamped model promises less than ``decrease`` (in units of the log-likelihood).

    Args:
        evaluate: (u, locals, derivatives, **options) -> State, or None where the model cannot be simulated; options
            as of :meth:`Problem.evaluate`.
        start: with derivatives.
        limits: bounds of u.

    Source: Nielsen, Damping parameter in Marquardt's method, IMM-REP-1999-05 (1999), for the damping.
    """
    state, growth, evaluations, small, reason = start, 2.0, 0, 0, "too many iterations"
    trust = False  # the last step came out as predicted: the next is taken with derivatives at once
    low, high = limits
    for iteration in range(iterations):
        full = _step(state, 0.0, limits)
        if full is not None and abs(full[2]) < decrease:
            return Solution(state, iteration, evaluations, "converged")
        rejected = 0
        while True:
            step = _step(state, damping, limits)
            better = None
            if step is not None:
                u = np.clip(state.u + step[0], low, high)
                locals_ = [x + d for x, d in zip(state.locals, step[1], strict=True)]
                better, evaluations = evaluate(u, locals_, trust, strict=True), evaluations + 1
            gain = state.cost - better.cost if better else -np.inf
            if step is not None and better is not None and gain > 0:
                ratio = gain / max(step[2], 1e-300)
                damping = max(damping * max(1 / 5, 1 - (2 * ratio - 1) ** 3), 1e-12)
                growth, known = 2.0, trust
                trust = TRUSTED[0] < ratio < TRUSTED[1]
                break
            trust = False
            damping, growth = max(damping, 1e-9) * growth, growth * 2
            rejected += 1
            if damping > STUCK or rejected > PATIENCE:
                return Solution(state, iteration, evaluations, "stuck")
        small = small + 1 if gain < max(relative * state.cost, SMALL * decrease) else 0
        found = better if known else evaluate(better.u, better.locals, True, ran=better)
        state = found if found is not None else replace(better, pieces=state.pieces)
        if small > 1 or found is None:
            return Solution(state, iteration + 1, evaluations, "converged" if found else "stuck")
    return Solution(state, iterations, evaluations, reason)
