"""Friction along a given motion: the force of a law and its effects at a contact, and its derivatives.

Where the motion is given each bristle is a scalar recursion. Over a step of length h, v, load and clocks held at their
means, z' = A + B z is linear for every law, and

    z(h) = z e^(B h) + A (e^(B h) - 1) / B,

exact however stiff the bristle is (Hairer and Wanner, Solving Ordinary Differential Equations II: exponential Euler).
Derivatives in parameters are those of this recursion, carried along with it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property, lru_cache

import numpy as np
import sympy as sp
from numba import njit

from ..physics.base import SESSION, TIME, TRIAL
from ..physics.mechanism import Mechanism

SMALL = 1e-4  # |B h| below which series stand for differences: both err by less than 1e-8 there
LEAST = 1e-150  # speed that stands for 0, where powers of it have derivatives that are 0 times infinity
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
        self._made: dict = {}

    def force(self, motion: Motion, values: Sequence[float]) -> np.ndarray:
        """F at the samples of a motion, shape (n,).

        Args:
            motion: q, v, a, inputs and clocks by name, shape (n,), even steps in ``t``; what is missing is 0.
            values: of the parameters, SI units.
        """
        t, along = motion["t"], self._along(motion)
        force, rates = self._compiled
        if rates is None:
            return np.broadcast_to(np.asarray(force(*along, *values), float), t.shape)
        z, here = self.bristle(motion, values), _at(rates, along, values, len(t))
        return np.broadcast_to(np.asarray(force(*along, z, here[0][0] + here[1][0] * z, *values), float), t.shape)

    def bristle(self, motion: Motion, values: Sequence[float]) -> np.ndarray:
        """z at the samples of a motion, as :meth:`force` has it, shape (n,); of a law with a bristle."""
        t, along, rates = motion["t"], self._along(motion), self._compiled[1]
        origin, slope = _at(rates, _middle(along), values, len(t) - 1)
        return bristles(origin[0], slope[0], float(t[1] - t[0]))

    def _along(self, motion: Motion) -> list:
        return [motion.get(name, 0.0) for name in self.symbols]

    @cached_property
    def _compiled(self):
        """F, and A and B of the bristle's rate; None where there is none."""
        only, p = self.mechanism.only, [par.symbol for par in self.mechanism.parameters]
        motion = list(self.symbols.values())
        if not only.memory:
            return _function((*motion, *p), only.friction), None
        return _function((*motion, only.z, only.zdot, *p), only.friction), _function((*motion, *p), self._rates)

    @cached_property
    def _rates(self) -> tuple[sp.Expr, sp.Expr]:
        """A and B of z' = A + B z."""
        only = self.mechanism.only
        return only.bristle_rate.subs(only.z, 0), sp.diff(only.bristle_rate, only.z)

    def columns(self, motion: Motion, values: Sequence[float | np.ndarray], names: Sequence[str]) -> np.ndarray:
        """dF/dp of named parameters, shape (n, names).

        Args:
            values: as of :meth:`force`; some of them may have several values, shape (g, 1). Then the result has shape
                (n, g * names): the names at the first of these values, at the second and so on.
        """
        t, count = motion["t"], len(names)
        if not names:
            return np.zeros((len(t), 0))
        along = self._along(motion)
        at = list(self.symbols).index("v")
        along[at] = np.where(along[at] == 0.0, LEAST, along[at])
        g = max(np.size(x) for x in values)
        forces, rates, bends = self._slopes(tuple(names), self._neutral(values))

        def spread(made: list[np.ndarray], n: int) -> np.ndarray:
            """Rows of each name, shape (1 or g, n), as rows of each value and name, shape (g * names, n)."""
            return np.stack([np.broadcast_to(x, (g, n)) for x in made], axis=1).reshape(g * count, n)

        if rates is None:
            return spread(_at(forces, along, values, len(t)), len(t)).T
        step, middle = float(t[1] - t[0]), _middle(along)
        origin, slope = _at(rates, middle, values, len(t) - 1)
        made = _at(bends, middle, values, len(t) - 1)
        if len(origin) != len(slope) or len(origin) > 1:  # values that differ bend the bristle's own path, too
            origin, slope = (np.repeat(np.broadcast_to(x, (g, len(t) - 1)), count, axis=0) for x in (origin, slope))
        z, changes = tangents(origin, slope, spread(made[:count], len(t) - 1), spread(made[count:], len(t) - 1), step)
        A, B = _at(rates, along, values, len(t))
        # With several paths their rows are those of values and names; forces want those of values.
        paths = z[::count] if len(z) > 1 else z
        found = _at(forces, [*along, paths, A + B * paths], values, len(t))
        by_z, by_rate = (spread([x] * count, len(t)) for x in found[:2])
        total = spread(found[2:], len(t)) + by_z * changes
        if by_rate.any():
            here = _at(bends, along, values, len(t))
            slopes, path = spread([B] * count, len(t)), spread([paths] * count, len(t))
            total += by_rate * (spread(here[:count], len(t)) + spread(here[count:], len(t)) * path + slopes * changes)
        return total.T

    def _neutral(self, values: Sequence[float | np.ndarray]) -> frozenset[str]:
        """Strengths that are neutral: without them the equations are shorter, and what shapes them is not in them."""
        table = self.mechanism.parameters
        return frozenset(p.name for p, x in zip(table, values, strict=True) if np.size(x) == 1 and p.neutral == x)

    def _slopes(self, names: tuple[str, ...], neutral: frozenset[str]):
        """Compiled: dF/dp; with a bristle dF/dz, dF/dz' and dF/dp, then A and B, then dA/dp and dB/dp."""
        if (names, neutral) in self._made:
            return self._made[names, neutral]
        only, table = self.mechanism.only, {par.name: par for par in self.mechanism.parameters}
        off = {table[n].symbol: sp.nsimplify(table[n].neutral) for n in neutral}
        motion, symbols = tuple(self.symbols.values()), tuple(par.symbol for par in table.values())
        p = [table[n].symbol for n in names]

        def compiled(arguments: tuple, expressions: Sequence[sp.Expr]):
            return _function(arguments, tuple(sp.sympify(e).xreplace(off) for e in expressions))

        made: tuple = (compiled((*motion, *symbols), [_slope(only.friction, x) for x in p]), None, None)
        if only.memory:
            made = (
                compiled(
                    (*motion, only.z, only.zdot, *symbols), [_slope(only.friction, x) for x in (only.z, only.zdot, *p)]
                ),
                compiled((*motion, *symbols), self._rates),
                compiled((*motion, *symbols), [_slope(e, x) for e in self._rates for x in p]),
            )
        self._made[names, neutral] = made
        return made

    def by_signal(self, motion: Motion, values: Sequence[float], name: str, size: float) -> np.ndarray:
        """dF/d signal at every sample, shape (n,): of a bristle as if the signal changed for longer than it needs."""
        sides = [self.force({**motion, name: motion[name] + d}, values) for d in (size, -size)]
        return (sides[0] - sides[1]) / (2 * size)


_slope = lru_cache(maxsize=4096)(sp.diff)


@lru_cache(maxsize=1024)
def _function(arguments: tuple[sp.Symbol, ...], expr: sp.Expr | tuple[sp.Expr, ...]):
    return sp.lambdify(arguments, expr, modules=["scipy", "numpy"], cse=True)


def _middle(along: Sequence) -> list:
    """Signals at the middles of steps."""
    return [0.5 * (x[1:] + x[:-1]) if isinstance(x, np.ndarray) else x for x in along]


def _at(functions, along: Sequence, values: Sequence, n: int) -> list[np.ndarray]:
    """Compiled expressions along a motion, each of shape (1, n), or (g, n) where a value that it holds has g."""
    found = []
    for x in functions(*along, *values):
        x = np.asarray(x, float)
        found.append(np.ascontiguousarray(np.broadcast_to(x, (x.shape[0] if x.ndim == 2 else 1, n))))
    return found


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


@njit(cache=True)
def tangents(
    origin: np.ndarray, slope: np.ndarray, by_origin: np.ndarray, by_slope: np.ndarray, step: float
) -> tuple[np.ndarray, np.ndarray]:
    """z as of :func:`bristles` and its derivatives, those of origin and slope given.

    Args:
        origin, slope: of one path for all rows, shape (1, n), or of each, shape (rows, n).
        by_origin, by_slope: shape (rows, n).

    Returns:
        z, shape (1 or rows, n + 1), and its derivatives, shape (rows, n + 1).
    """
    rows, n = by_origin.shape
    paths = len(origin)
    z, change = np.zeros((paths, n + 1)), np.zeros((rows, n + 1))
    for path in range(paths):
        z[path] = bristles(origin[path], slope[path], step)
    for row in range(rows):
        A, B, Z = origin[row % paths], slope[row % paths], z[row % paths]
        for k in range(n):
            if -B[k] * step > 1.0:
                change[row, 0] = -(by_origin[row, k] + by_slope[row, k] * Z[0]) / B[k]
                break
    grown, reach, bend = np.zeros(n), np.zeros(n), np.zeros(n)
    for row in range(rows):
        A, B, Z = origin[row % paths], slope[row % paths], z[row % paths]
        if row < paths:
            for k in range(n):
                x = B[k] * step
                grown[k] = np.exp(x)
                if abs(x) > SMALL:
                    reach[k] = (grown[k] - 1.0) / B[k]
                    bend[k] = (x * grown[k] - grown[k] + 1.0) / B[k] ** 2
                else:
                    reach[k] = step * (1.0 + 0.5 * x)
                    bend[k] = step**2 * (0.5 + x / 3.0)
        for k in range(n):
            own = (Z[k] * step * grown[k] + A[k] * bend[k]) * by_slope[row, k] + reach[k] * by_origin[row, k]
            change[row, k + 1] = change[row, k] * grown[k] + own
    return z, change
