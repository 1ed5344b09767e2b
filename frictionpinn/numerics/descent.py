"""Descent of a likelihood with a few global unknowns and many that belong to one trial each.

By Levenberg and Marquardt's method; where it is rugged from a coarse resolution in time to the single sample, and back.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.optimize import lsq_linear

from .quadratic import FAINT, LONGEST_STEP, SAME_MINIMUM, Evaluate, Known, Limits, State, reduced
from .stops import past_stops

NEAR = 1e-3  # damping of a search that is to stay in its minimum
STUCK, MOST_REJECTED = 1e12, 8  # damping beyond which no step will help; rejected steps in a row: from 0 to 1e6
TRUSTED = 0.75, 1.5  # decrease over that predicted
SMALL = 5.0  # times the decrease asked for: two steps in a row that gain less end the search (the cost has kinks)
MOVES = 50  # times at most are stops moved, a budget: each gains that much in a trial
ROUGHLY: dict[str, Any] = {"iterations": 20, "decrease": 0.1}  # of a search at a coarse resolution
CLOSELY: dict[str, Any] = {"iterations": 20, "decrease": 0.03}  # at the sample; noise levels are refined afterwards

# Reasons of solutions that no descent ended: values to start from, a budget spent, a minimum that is known; of one that
# came to an end, and to none.
GIVEN, BUDGET, KNOWN = "as given", "budget", "known"
ENDED, UNFINISHED = "converged", "too many iterations"


@dataclass(frozen=True)
class Solution:
    """Where a search ended, and why: "converged", "stuck", "too many iterations"; or one of the reasons above."""

    state: State
    reason: str


def _step(
    state: State, damping: float, limits: Limits, held: Collection[int] = ()
) -> tuple[np.ndarray, list[np.ndarray], float] | None:
    """Damped Gauss-Newton step (global, local) and the decrease that the quadratic model predicts for it.

    It minimises the model within the limits, and is shortened to ``LONGEST_STEP``. Damped are the steps of u with the
    local unknowns following (in S, whose diagonal grows) and those of the local unknowns by themselves: damped in H, a
    parameter that a trial's own unknowns nearly stand for would hardly move. The local unknowns of the trials ``held``
    follow alone. An unknown that hardly shows would go far, and hold back all the others: ``FAINT`` keeps it near.
    """
    S, g, back = reduced(state)
    n = len(state.u)
    S[np.diag_indices(n)] = S.diagonal() * (1 + damping) + FAINT
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
    own = [0.0 if k in held else 1 / (1 + damping) for k in range(len(back))]
    dl = [np.zeros(0) if X is None else -X[:, n] * share - X[:, :n] @ du for X, share in zip(back, own, strict=True)]
    decrease = 0.0
    for piece, d in zip(state.pieces, dl, strict=True):
        decrease -= float(du @ piece.grad_g + 0.5 * du @ piece.gg @ du)
        if len(d):
            decrease -= float(d @ piece.grad_l + 0.5 * d @ piece.ll @ d + du @ piece.gl @ d)
    return du, dl, decrease


def levenberg_marquardt(evaluate: Evaluate, start: State, limits: Limits, **options: Any) -> Solution:
    """Minimise the cost within bounds on the global unknowns, and go on where stops can be moved to gain.

    Each time the descent ends (:func:`_descended`, which has the ``options``), stops are moved past samples
    (:func:`.stops.past_stops`).
    """
    found = _descended(evaluate, start, limits, **options)
    for _ in range(MOVES):
        moved = None if found.reason == KNOWN else past_stops(evaluate, found.state, SAME_MINIMUM)
        if moved is None:
            break
        found = _descended(evaluate, moved, limits, **options)
    return found


def _descended(
    evaluate: Evaluate,
    start: State,
    limits: Limits,
    *,
    iterations: int = 60,
    decrease: float = 3e-3,
    damping: float = NEAR,
    known: Sequence[Known] = (),
) -> Solution:
    """Minimise the cost within bounds on the global unknowns.

    A trial step for which the model cannot be simulated is rejected like one that raises the cost. Where it raises that
    of some trials, their own unknowns follow the parameters alone before anything is damped: noisy motion turns round a
    sample later than measured and dry friction changes sign there, a wall that holds up one trial and no other. Steps
    end at the bounds: each minimises the quadratic model within them. The search ends where the undamped model promises
    less than ``decrease`` (in units of the log-likelihood, see :attr:`State.unit`), where two steps in a row gain
    hardly more, or after ``iterations``. Damping that grows from nothing begins where it matters to what is told worst.

    Args:
        evaluate: the cost, see :meth:`frictionpinn.identify.Problem.evaluator`.
        start: with derivatives.
        limits: bounds of u.
        iterations, decrease: steps at most, and what is worth one.
        damping: of the first step. Without any it goes far, as a search for more than the nearest minimum should;
            little holds fast what differs little from all else (drag beside viscous friction).
        known: minima: a search that the undamped model leads into one of them ends.

    Source: Nielsen, Damping parameter in Marquardt's method, IMM-REP-1999-05 (1999), for the damping.
    """
    state, growth, small, holds = start, 2.0, 0, True
    trust = False  # the last step came out as predicted: the next is taken with derivatives at once
    for _ in range(iterations):
        worth = decrease * state.unit
        full = _step(state, 0.0, limits)
        if full is not None and abs(full[2]) < worth:
            return Solution(state, ENDED)
        if full is not None and any(minimum.holds(state.u + full[0], state.cost - full[2]) for minimum in known):
            return Solution(state, KNOWN)
        rejected, held = 0, frozenset[int]()
        while True:
            step, better = _step(state, damping, limits, held), None
            if step is not None:
                u = np.clip(state.u + step[0], *limits)
                locals_ = [x + d for x, d in zip(state.locals, step[1], strict=True)]
                better = evaluate(u, locals_, trust, strict=True)
            gain = state.cost - better.cost if better else -np.inf
            if step is not None and better is not None and gain > 0:
                ratio = gain / max(step[2], 1e-300)
                damping = max(damping * max(1 / 5, 1 - (2 * ratio - 1) ** 3), 1e-12)
                growth, curved = 2.0, trust
                trust = TRUSTED[0] < ratio < TRUSTED[1]
                break
            trust = False
            if holds and step is not None and better is not None and not held:
                risen = enumerate(zip(step[1], state.pieces, better.pieces, strict=True))
                held = frozenset(k for k, (d, was, now) in risen if len(d) and now.cost > was.cost)
                if held:
                    continue
            damping, growth = max(damping * growth, NEAR), growth * 2
            rejected += 1
            if damping > STUCK or rejected > MOST_REJECTED:
                return Solution(state, "stuck")
        if held and gain < SMALL * worth:
            holds = False  # the parameters have come through: what is left is what the trials' own unknowns can do
        small = small + 1 if gain < SMALL * worth and not held else 0
        found = better if curved else evaluate(better.u, better.locals, True, ran=better)
        if found is None:
            return Solution(replace(better, pieces=state.pieces), "stuck")
        state = found
        if small > 1:
            return Solution(state, ENDED)
    return Solution(state, UNFINISHED)


def coarse_to_fine(
    evaluate: Evaluate,
    first: State,
    limits: Limits,
    widths: Sequence[float],
    known: Sequence[Known] = (),
) -> Solution | None:
    """Follow the minimum from the unknowns ``first`` at a coarse resolution in time to a finer one.

    Each of ``widths``, s, the coarsest first, starts where the one before ended. Returns the minimum at the last; None
    where the model cannot be simulated there.

    Args:
        evaluate, first, limits: what is minimised, from where, and within which bounds.
        widths: resolutions in time.
        known: minima at the sample, see :func:`levenberg_marquardt`.
    """
    found: Solution | None = None
    state = first
    for width in widths:
        at = partial(evaluate, width=width)
        begun = at(state.u, state.locals, True)
        damping, how = 0.0 if found is None else NEAR, ROUGHLY if width else CLOSELY | {"known": known}
        found = None if begun is None else levenberg_marquardt(at, begun, limits, damping=damping, **how)
        state = state if found is None else found.state
    return found
