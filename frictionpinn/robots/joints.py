"""Friction of a robot's joints inside a stage of an implicit step, their bristles eliminated joint by joint.

A stage gives each joint q, v, a and load. What a joint remembers (its bristle z) then obeys R(z_known + h w, w, v,
load) = 0 in its own rates w alone, whatever the other joints do: it is solved before Newton's step of the motion, to
which it leaves F and, by the implicit function theorem, the whole derivatives of F in q, v, a and load.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numba import njit

from ..errors import UserError
from ..numerics.bristle import resting_states, steady_bristles
from ..numerics.codegen import Kernels, pointer
from ..numerics.integrator import OPTIONS, back_substitute, factorize
from ..physics.base import SESSION, TIME, TRIAL
from ..physics.mechanism import Mechanism

SEEN = ("q", "q_dot", "q_ddot", "load_in")  # what a joint's friction sees of the motion
# Corrections relative to rate and slip velocity: of a solution, and of one that only rounding moves.
SOLVED, ROUNDED, LEAST = 1e-12, 1e-9, 1e-12
ROUNDS = 50  # of Newton in one joint; laws whose bristle rate is linear in z need one
TINY = 1e-9  # slip velocity, rad/s, at which a bristle carries its static friction: far below any Stribeck velocity


@dataclass(frozen=True)
class Joints:
    """Friction of joints, each a mechanism of its own.

    Attributes:
        mechanisms: of each joint (:class:`~frictionpinn.physics.robot_joint.RobotJoint`, its law, its effects).
        values: parameters of each, in the order of its mechanism, SI units.
    """

    mechanisms: tuple[Mechanism, ...]
    values: tuple[np.ndarray, ...]

    @cached_property
    def _kernels(self) -> list[Kernels]:
        made: dict[str, Kernels] = {}  # equal equations are loaded once
        return [made.setdefault(kernels.key, kernels) for kernels in map(Kernels, self.mechanisms)]

    @cached_property
    def slices(self) -> tuple[slice, ...]:
        """Place of each joint's memory in the state of all."""
        ends = np.cumsum([0, *(kernels.sizes[0] for kernels in self._kernels)])
        return tuple(slice(int(a), int(b)) for a, b in pairwise(ends))

    @property
    def count(self) -> int:
        """Number of states of all joints together."""
        return self.slices[-1].stop

    @cached_property
    def bristles(self) -> tuple[int, ...]:
        """Of each joint the place of its bristle in the state of all, -1 where it has none."""
        return tuple(s.stop - 1 if mechanism.memory else -1
                     for s, mechanism in zip(self.slices, self.mechanisms, strict=True))  # fmt: skip

    @cached_property
    def _groups(self) -> list[tuple]:
        """Of joints with equal equations: functions, outputs, parameters, and where inputs, clocks and memory stand."""
        found = []
        for kernels in {kernels.key: kernels for kernels in self._kernels}.values():
            which = np.array([k for k, own in enumerate(self._kernels) if own is kernels])
            memory = np.array([[*range(s.start, s.stop)] for s in (self.slices[k] for k in which)], np.int64)
            found.append((*_functions(kernels), kernels.outputs, *_places(kernels), which,
                          np.stack([self.values[k] for k in which]), memory, kernels.sizes[2]))  # fmt: skip
        return found

    def at(self, t: float, seen: np.ndarray, known: np.ndarray, hg: float, w: np.ndarray):
        """Friction F, shape (joints,), and its derivatives in q, v, a and load, shape (joints, 4).

        Args:
            t: s.
            seen: q, v, a, load of each joint, shape (joints, 4).
            known: memory as the earlier stages leave it, shape (count,); the stage's is known + hg w.
            hg: step size times the stage's diagonal coefficient, s.
            w: rates of the memory, shape (count,): the guess, overwritten by the solution.
        """
        F, slopes = np.empty(len(seen)), np.empty((len(seen), 4))
        for group in self._groups:
            _eliminate(*group, t, seen, known, hg, w, F, slopes)
        return F, slopes

    def start(self, q: np.ndarray, v: np.ndarray, load: np.ndarray, needed: np.ndarray) -> np.ndarray:
        """Memory in steady sliding; of a joint at rest where it holds what is ``needed``, up to its static friction."""
        state = np.zeros(self.count)
        for k, (kernels, own) in enumerate(zip(self._kernels, self.slices, strict=True)):
            if own.start == own.stop:
                continue
            p, u, places = self.values[k], np.zeros(kernels.sizes[2]), _places(kernels)[0]
            u[places] = q[k], v[k], 0.0, load[k]
            rest = resting_states(kernels, np.zeros(own.stop - own.start), u, p)
            if self.bristles[k] >= 0:
                ends = []
                for speed in (v[k],) if v[k] else (-TINY, TINY):
                    u[places[1]] = speed
                    ends.append(float(steady_bristles(kernels, rest, u, p)[-1]))
                u[places[1]] = v[k]
                rest[-1] = ends[0] if v[k] else min(max(_holding(kernels, rest, u, p, needed[k]), ends[0]), ends[1])
            state[own] = rest
        return state


def _functions(kernels: Kernels) -> tuple:
    return (pointer(kernels.sensitivity.parameters), pointer(kernels.plain.outputs),
            pointer(kernels.sensitivity.output_derivatives))  # fmt: skip


def _places(kernels: Kernels) -> tuple[np.ndarray, np.ndarray]:
    """Where among the inputs the motion stands, and where the clocks, -1 for those that do not enter."""
    names = [symbol.name for symbol in kernels.symbols[2]]
    clocks = [names.index(c.name) if c.name in names else -1 for c in (TIME, SESSION, TRIAL)]
    return np.array([names.index(name) for name in SEEN]), np.array(clocks)


def _holding(kernels: Kernels, state: np.ndarray, u: np.ndarray, p: np.ndarray, needed: float) -> float:
    """z of a bristle at rest that carries a torque: its force is linear in z."""
    w, (_, outputs, derivatives) = np.zeros_like(state), _functions(kernels)
    force, slopes = np.zeros(kernels.outputs), np.zeros(kernels.outputs * sum(kernels.sizes))
    _call(outputs, state, w, u, p, force)
    _call(derivatives, state, w, u, p, slopes)
    per_z = slopes.reshape(kernels.outputs, -1)[2, len(state) - 1]
    return float(state[-1] + (needed - force[2]) / per_z)


@njit(**OPTIONS)
def _call(function, s, w, u, p, out):
    function(s, w, u, p, out)


@njit(**OPTIONS)
def _eliminate(
    parameters,
    outputs,
    derivatives,
    n_out,
    places,
    clocks,
    which,
    values,
    memory,
    n_u,
    t,
    seen,
    known,
    hg,
    w,
    F,
    slopes,
):
    """F and dF of the joints of one group; their w becomes the solution of their stage."""
    n, n_p = memory.shape[1], values.shape[1]
    u, s, own, delta = np.zeros(n_u), np.empty(n), np.empty(n), np.empty(n)
    out, force = np.zeros(n + 2 * n * n + 1 + n * (n_p + n_u)), np.zeros(n_out)
    width = 2 * n + n_p + n_u
    change, matrix, pivots = np.zeros(n_out * width), np.empty((n, n)), np.empty(n, np.int64)
    friction, by_u = 2 * width, n + 2 * n * n + 1 + n * n_p  # of a contact's outputs the third is its friction
    for g in range(which.shape[0]):
        joint, p = which[g], values[g]
        for c in range(4):
            u[places[c]] = seen[joint, c]
        for c in range(3):
            if clocks[c] >= 0:
                u[clocks[c]] = t if c < 2 else 1.0
        for i in range(n):
            own[i] = w[memory[g, i]]
        before, done = np.inf, n == 0
        for _ in range(ROUNDS):
            for i in range(n):
                s[i] = known[memory[g, i]] + hg * own[i]
            if n == 0:
                break
            parameters(s, own, u, p, out)
            for i in range(n):
                delta[i] = -out[i]
                for j in range(n):
                    matrix[i, j] = out[n + n * n + i * n + j] + hg * out[n + i * n + j]
            if not factorize(matrix, pivots) or done:
                break
            back_substitute(matrix, pivots, delta)
            size = 0.0
            for i in range(n):
                own[i] += delta[i]
                size = max(size, abs(delta[i]) / (LEAST + abs(own[i]) + abs(seen[joint, 1])))
            done = size < SOLVED or (size < ROUNDED and size >= before)  # once more: the matrix at the solution
            before = size
        outputs(s, own, u, p, force)
        derivatives(s, own, u, p, change)
        F[joint] = force[2] if done else np.nan
        for c in range(4):
            total = change[friction + 2 * n + n_p + places[c]]
            if n > 0:
                for i in range(n):
                    delta[i] = -out[by_u + i * n_u + places[c]]
                back_substitute(matrix, pivots, delta)
                for i in range(n):
                    total += delta[i] * (change[friction + n + i] + hg * change[friction + i])
            slopes[joint, c] = total
        for i in range(n):
            w[memory[g, i]] = own[i]


def joints_of(mechanisms: Sequence[Mechanism], values: Sequence[Sequence[float]]) -> Joints:
    """Joints from their mechanisms and values.

    Raises:
        UserError: a value that is missing or not finite.
    """
    for mechanism, own in zip(mechanisms, values, strict=True):
        for par, value in zip(mechanism.parameters, own, strict=True):
            if not np.isfinite(value):
                raise UserError("parameter without a finite value", where=par.name, received=value,
                                fix="give it a number")  # fmt: skip
    return Joints(tuple(mechanisms), tuple(np.asarray(own, float) for own in values))
