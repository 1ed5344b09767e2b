"""A trained network with memory as plain numbers: what a simulation integrates and an export writes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..numerics.parallel_bristles import rates_of, reach_of


@dataclass(frozen=True)
class StateFriction:
    """Friction of bristles in parallel, see :mod:`..numerics.parallel_bristles`.

    Attributes:
        tables: T_1 .. T_K and r at the knots, shape (K + 1, velocities, loads).
        grid: v0, first and step of asinh(v / v0), first load and step.
        elements: rows kappa, c, gap, n, shape (4, K).
    """

    tables: np.ndarray
    grid: np.ndarray
    elements: np.ndarray

    @property
    def states(self) -> int:
        """K, the number of bristles."""
        return self.elements.shape[1]

    def rates(self, v: float, N: float, z: np.ndarray) -> np.ndarray:
        """F and z' of slip velocity, load and states of shape (K,): an array of shape (K + 1,)."""
        out = np.empty(self.states + 1)
        rates_of(v, N, np.ascontiguousarray(z), self.tables, self.grid, self.elements, out)
        return out

    def steady(self, v: np.ndarray, N: np.ndarray) -> np.ndarray:
        """F where every bristle has settled at slip velocity and load, arrays of one shape."""
        found = np.empty(np.shape(v))
        for place in np.ndindex(found.shape):
            found[place] = self.rates(float(v[place]), float(N[place]), self.settled(float(v[place]), float(N[place])))[
                0
            ]
        return found

    def reach(self, v: float, N: float) -> np.ndarray:
        """s of every bristle, m, shape (K,)."""
        out = np.empty(self.states)
        reach_of(v, N, self.tables, self.grid, self.elements, out)
        return out

    def settled(self, v: float, N: float) -> np.ndarray:
        """States in steady sliding, shape (K,): sgn(v) s(v, N)."""
        return np.sign(v) * self.reach(v, N)
