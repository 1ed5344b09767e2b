"""Descent of a likelihood with a few global unknowns and many that belong to one trial each.

By Levenberg and Marquardt's method; where it is rugged from a coarse resolution in time to the single sample, and back.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.linalg.lapack import dposv
from scipy.optimize import lsq_linear

from .jumps import Jump
from .simulate import Simulation
from .stops import past_stops

LONGEST_STEP = 1.0  # in log u: a parameter changes by at most a factor e in one step
FAINT = 0.01  # added to the curvature in log u: that of an unknown told to ten powers of e, which tells nothing
NEAR = 1e-3  # damping of a search that is to stay in its minimum
STUCK, MOST_REJECTED = 1e12, 8  # damping beyond which no step will help; rejected steps in a row: from 0 to 1e6
TRUSTED = 0.75, 1.5  # decrease over that predicted
SMALL = 5.0  # times the decrease asked for: two steps in a row that gain less end the search (the cost has kinks)
SAME_MINIMUM = 0.2  # log-likelihood (:attr:`State.unit`): a point that is as near to a minimum as that lies in it
MOVES = 50  # times at most are stops moved, a budget: each gains that much in a trial
ROUGHLY: dict[str, Any] = {"iterations": 20, "decrease": 0.1}  # of a search at a coarse resolution
CLOSELY: dict[str, Any] = {"iterations": 20, "decrease": 0.03}  # at the sample; noise levels are refined afterwards

# Reasons of solutions that no descent ended: values to start from, a budget spent, a minimum that is known; and of one
# that came to no end.
GIVEN, BUDGET, KNOWN, UNFINISHED = "as given", "budget", "known", "too many iterations"


@dataclass(frozen=True)
class Piece:
    """Contribution of one trial to the cost: value, gradient and Gauss-Newton matrix, split into global and local.

    Attributes:
        cost: half the sum of squares (or of the robust cost).
        residuals: signal -> model minus measurement, shape (n,), SI units.
        gg, gl, ll: blocks of the Gauss-Newton matrix, (n_g, n_g), (n_g, n_l), (n_l, n_l); empty without derivatives.
        grad_g, grad_l: gradient, (n_g,), (n_l,); empty without derivatives.
        run: the simulation, where it was asked to be ``strict``: derivatives can be added to it.
        steps: that the integrator took for it.
        rows: with derivatives, number of residuals of the outputs at their resolution, in units of their noise the sum
            of their squares, and of the products of neighbours.
        jumps, smooth: with derivatives, at the sample: where what is simulated jumps, and, if it does, ``ll`` and
            ``grad_l`` without the samples beside.
    """

    cost: float
    residuals: dict[str, np.ndarray]
    gg: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    gl: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    ll: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    grad_g: np.ndarray = field(default_factory=lambda: np.zeros(0))
    grad_l: np.ndarray = field(default_factory=lambda: np.zeros(0))
    run: Simulation | None = field(default=None, repr=False)
    steps: int = 0
    rows: tuple[float, float, float] = (0.0, 0.0, 0.0)
    jumps: tuple[Jump, ...] = ()
    smooth: tuple[np.ndarray, np.ndarray] | None = None


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

    @property
    def unit(self) -> float:
        """Difference in cost that is 1 in log-likelihood: more where residuals exceed the noise, or keep their sign.

        With their mean square s and the correlation rho of neighbours, which keep their sign for pi / acos(rho) samples
        (Rice, Bell Syst. Tech. J. 24, 1945), white noise for 2: s (pi / 2) / acos(rho).
        """
        count, squares, products = np.sum([piece.rows for piece in self.pieces], axis=0)
        if squares == 0:
            return 1.0
        rho = min(max(products / squares, 0.0), 1 - 1 / count)
        return float(max(squares / count * (np.pi / 2) / np.arccos(rho), 1.0))


@dataclass(frozen=True)
class Solution:
    """Where a search ended, and why: "converged", "stuck", "too many iterations"; or one of the reasons above."""

    state: State
    reason: str


Evaluate = Callable[..., State | None]  # see Problem.evaluator
Limits = tuple[np.ndarray, np.ndarray]  # bounds of u


def reduced(state: State) -> tuple[np.ndarray, np.ndarray, list]:
    """Eliminate the local unknowns: Schur complement (n_g, n_g), its gradient (n_g,), and what back-substitution needs.

    With H = [[A, B], [B', C]] and C block diagonal over trials, S = A - sum_b B_b C_b^-1 B_b'. Back-substitution needs
    C_b^-1 [B_b', g_b] of every trial, None where it has no unknowns.

    Raises:
        numpy.linalg.LinAlgError: a trial's own block is not positive definite.
    """
    n = len(state.u)
    S, g = np.zeros((n, n)), np.zeros(n)
    back: list[np.ndarray | None] = []
    for piece in state.pieces:
        S += piece.gg
        g += piece.grad_g
    for piece in state.pieces:
        if not len(piece.grad_l):
            back.append(None)
            continue
        scale = 1 / np.sqrt(piece.ll.diagonal())
        matrix = piece.ll * scale[:, None] * scale
        matrix[np.diag_indices_from(matrix)] = 1 + 1e-13
        right = np.column_stack([piece.gl.T, piece.grad_l]) * scale[:, None]
        X, fault = dposv(matrix, right)[1:]  # without checks that take ten times as long for a small matrix
        if fault:
            raise np.linalg.LinAlgError(f"not positive definite: minor {fault}")
        X = X * scale[:, None]
        S -= piece.gl @ X[:, :n]
        g -= piece.gl @ X[:, n]
        back.append(X)
    return S, g, back


def invert(information: np.ndarray) -> np.ndarray:
    """Inverse of a symmetric positive matrix whose entries differ by decades; huge entries where it is singular."""
    scale = 1 / np.sqrt(np.maximum(information.diagonal(), 1e-300))
    scaled = information * scale[:, None] * scale
    values, vectors = np.linalg.eigh((scaled + scaled.T) / 2)
    values = np.maximum(values, 1e-14)
    return (vectors / values) @ vectors.T * scale[:, None] * scale


def moved(
    state: State, step: np.ndarray, limits: Limits, longest: float = LONGEST_STEP
) -> tuple[np.ndarray, list[np.ndarray]]:
    """Global unknowns after a step from a minimum, (n_g,), and the local ones of every trial as the model moves them.

    The step is shortened to ``longest`` and ends at the limits. With the quadratic model's minimum at the state, x_l
    moves by -C^-1 B' times the step of u.
    """
    back, n = reduced(state)[2], len(state.u)
    u = np.clip(state.u + step * min(1.0, longest / max(np.abs(step).max(), 1e-12)), *limits)
    return u, [x if X is None else x - X[:, :n] @ (u - state.u) for x, X in zip(state.locals, back, strict=True)]


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


@dataclass(frozen=True)
class Known:
    """A minimum as other searches ask of it.

    Attributes:
        u, S: global unknowns, shape (n,), and the information on them, shape (n, n).
        cost, unit: of its state.
    """

    u: np.ndarray
    S: np.ndarray
    cost: float
    unit: float

    @classmethod
    def of(cls, state: State) -> Known:
        """That of a state with derivatives."""
        return cls(state.u, reduced(state)[0], state.cost, state.unit)

    def holds(self, u: np.ndarray, cost: float) -> bool:
        """Whether a point lies in it: as near as a fraction of its errors, and about as low."""
        d, worth = u - self.u, SAME_MINIMUM * self.unit
        return bool(0.5 * d @ self.S @ d < worth and abs(cost - self.cost) < worth)


def levenberg_marquardt(evaluate: Evaluate, start: State, limits: Limits, **options: Any) -> Solution:
    """Minimise the cost within bounds on the global unknowns, and go on where stops can be moved to gain.

    Each time the descent ends (:func:`_descended`, which has the ``options``), stops are moved by whole samples
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
            return Solution(state, "converged")
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
            return Solution(state, "converged")
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


def same_minimum(best: State, state: State) -> bool:
    """Whether a state lies in the minimum of ``best``."""
    return Known.of(best).holds(state.u, state.cost)
