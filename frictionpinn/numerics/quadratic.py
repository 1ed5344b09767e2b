"""A likelihood with a few global unknowns and many that belong to one trial each, as its quadratic model has it.

The cost is a sum over trials. Each gives a gradient and a Gauss-Newton matrix at a state, from which its own unknowns
are eliminated.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg.lapack import dposv

from .jumps import Jump
from .simulate import Simulation
from .whiteness import SIGNIFICANCE, whiteness

LONGEST_STEP = 1.0  # in log u: a parameter changes by at most a factor e in one step
FAINT = 0.01  # added to the curvature in log u: that of an unknown told to ten powers of e, which tells nothing
LEAST = 1e-200  # information that counts as none: its inverse and the products of two such are still numbers
SAME_MINIMUM = 0.2  # log-likelihood (:attr:`State.unit`): a point that is as near to a minimum as that lies in it


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

    def left(self, name: str) -> np.ndarray:
        """What is left of a signal in all trials, SI units, samples that were not measured left out, shape (m,)."""
        r = np.concatenate([np.zeros(0), *(piece.residuals[name] for piece in self.pieces if name in piece.residuals)])
        return r[~np.isnan(r)]

    def white(self, names: Collection[str], span: int) -> bool:
        """Whether what is left of these signals is as white as noise, see :func:`.whiteness.whiteness`."""
        rows = {name: [p.residuals[name] for p in self.pieces if name in p.residuals] for name in names}
        return whiteness(rows, span) > SIGNIFICANCE

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
    scale = 1 / np.sqrt(np.maximum(information.diagonal(), LEAST))
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


def same_minimum(best: State, state: State) -> bool:
    """Whether a state lies in the minimum of ``best``."""
    return Known.of(best).holds(state.u, state.cost)
