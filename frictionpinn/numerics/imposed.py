"""Friction along a given motion: the force of a law and its effects at a contact, and its derivatives.

Where the motion is given each bristle is a scalar recursion. Over a step of length h, v, load and clocks held at their
means, z' = A + B z is linear for every law, and

    z(h) = z e^(B h) + A (e^(B h) - 1) / B,

exact however stiff the bristle is (Hairer and Wanner, Solving Ordinary Differential Equations II: exponential Euler).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property, lru_cache

import numpy as np
import sympy as sp
from numba import njit

from ..physics.base import SESSION, TIME, TRIAL
from ..physics.mechanism import Mechanism

STEP = 1e-6  # of a value, for central differences: rounding and curvature both stay below 1e-9 of a derivative
Motion = Mapping[str, np.ndarray]
CLOCKS = {"t": TIME, "session": SESSION, "trial": TRIAL}


class ImposedFriction:
    """F(t) of a mechanism with one contact whose motion is imposed.

    Args:
        mechanism: without inertia and without states of effects other than a bristle.

    Attributes:
        names: of its parameters, in the order of ``values``.
    """

    def __init__(self, mechanism: Mechanism):
        self.mechanism = mechanism
        self.names = tuple(par.name for par in mechanism.parameters)
        (moving,) = mechanism.system.moving
        self.symbols = dict(zip(moving.signals, moving.symbols, strict=True))
        self.symbols |= {item.name: item.symbol for item in mechanism.system.inputs} | CLOCKS

    @cached_property
    def _compiled(self):
        only, p = self.mechanism.only, [par.symbol for par in self.mechanism.parameters]
        motion = list(self.symbols.values())
        if not only.memory:
            return _function((*motion, *p), only.friction), None
        slope = sp.diff(only.bristle_rate, only.z)
        origin = only.bristle_rate.subs(only.z, 0)
        force = _function((*motion, only.z, only.zdot, *p), only.friction)
        return force, (_function((*motion, *p), origin), _function((*motion, *p), slope))

    def force(self, motion: Motion, values: Sequence[float]) -> np.ndarray:
        """F at the samples of a motion, shape (n,).

        Args:
            motion: q, v, a, inputs and clocks by name, shape (n,), even steps in ``t``; what is missing is 0.
            values: of the parameters, SI units.
        """
        t = motion["t"]
        along = [motion.get(name, 0.0) for name in self.symbols]
        force, rates = self._compiled
        if rates is None:
            return np.broadcast_to(np.asarray(force(*along, *values), float), t.shape)
        middle = [0.5 * (x[1:] + x[:-1]) if isinstance(x, np.ndarray) else x for x in along]
        origin, slope = (np.broadcast_to(np.asarray(f(*middle, *values), float), t[1:].shape) for f in rates)
        z = bristles(np.ascontiguousarray(origin), np.ascontiguousarray(slope), float(t[1] - t[0]))
        here = [np.broadcast_to(np.asarray(f(*along, *values), float), t.shape) for f in rates]
        return np.broadcast_to(np.asarray(force(*along, z, here[0] + here[1] * z, *values), float), t.shape)

    def columns(self, motion: Motion, values: Sequence[float], names: Sequence[str]) -> np.ndarray:
        """dF/dp of named parameters, shape (n, names): of a bristle, whose path they change, by central differences."""
        t = motion["t"]
        if not names:
            return np.zeros((len(t), 0))
        if self._compiled[1] is None:
            slopes = self._slopes(tuple(names))(*(motion.get(name, 0.0) for name in self.symbols), *values)
            return np.stack([np.broadcast_to(np.asarray(slope, float), t.shape) for slope in slopes], axis=1)
        made = []
        for name in names:
            k, sides = self.names.index(name), []
            size = STEP * (abs(values[k]) or 1.0)
            for sign in (1, -1):
                moved = list(values)
                moved[k] += sign * size
                sides.append(self.force(motion, moved))
            made.append((sides[0] - sides[1]) / (2 * size))
        return np.stack(made, axis=1)

    def _slopes(self, names: tuple[str, ...]):
        """Compiled dF/dp of a force without memory."""
        p = {par.name: par.symbol for par in self.mechanism.parameters}
        force = self.mechanism.only.friction
        return _function((*self.symbols.values(), *p.values()), tuple(_slope(force, p[name]) for name in names))

    def by_signal(self, motion: Motion, values: Sequence[float], name: str, size: float) -> np.ndarray:
        """dF/d signal at every sample, shape (n,): of a bristle as if the signal changed for longer than it needs."""
        sides = [self.force({**motion, name: motion[name] + d}, values) for d in (size, -size)]
        return (sides[0] - sides[1]) / (2 * size)


_slope = lru_cache(maxsize=4096)(sp.diff)


@lru_cache(maxsize=1024)
def _function(arguments: tuple[sp.Symbol, ...], expr: sp.Expr | tuple[sp.Expr, ...]):
    return sp.lambdify(arguments, expr, modules="numpy", cse=True)


@njit(cache=True)
def bristles(origin: np.ndarray, slope: np.ndarray, step: float) -> np.ndarray:
    """z at every sample, from z' = origin + slope z over the steps between them, shape (n,) -> (n + 1,).

    It starts where the first step that slips by its own bristle's length would have brought it.
    """
    z = np.zeros(len(origin) + 1)
    for k in range(len(origin)):
        if -slope[k] * step > 1.0:  # settled within that step
            z[0] = -origin[k] / slope[k]
            break
    for k in range(len(origin)):
        x = slope[k] * step
        grown = np.exp(x)
        z[k + 1] = z[k] * grown + origin[k] * ((grown - 1.0) / slope[k] if abs(x) > 1e-9 else step)
    return z
