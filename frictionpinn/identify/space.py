"""The unknown parameters of an estimation, and the coordinates in which they are searched."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import sympy as sp

from ..errors import UserError, nearest
from ..physics.base import Parameter
from ..physics.mechanism import Mechanism

LEAST_GAP = 1e-3  # of the lower bound: two parameters that must not cross stay this far apart


@dataclass(frozen=True)
class Space:
    """Free parameters p and the vector u in which they are searched.

    u is log p; log(p - p_below) for a parameter that must not fall below another free one (mu_s above mu_c); and
    p / scale for a parameter that may be zero or negative (the strength of an effect, a place).

    Attributes:
        names: free parameters, in the mechanism's order.
        low, high: their bounds, SI units, shape (n,); -inf and inf where there is none.
        below: index of the free parameter that each must exceed, or -1.
        scales: 0 for a logarithmic parameter, else the unit in which it is searched.
    """

    names: tuple[str, ...]
    low: np.ndarray
    high: np.ndarray
    below: tuple[int, ...]
    scales: np.ndarray

    @classmethod
    def build(
        cls,
        mechanism: Mechanism,
        names: Sequence[str],
        bounds: Mapping[str, Sequence[float]],
        fixed: Mapping[str, float],
        sizes: Mapping[str, float] | None = None,
    ) -> Space:
        """Check names and bounds against the mechanism's parameters.

        Args:
            sizes: name -> unit in which it is searched if it may be zero; by default half the width of its bounds.

        Raises:
            UserError: an unknown name, bounds that are empty or outside the parameter's physical range.
        """
        check_names(mechanism, (*names, *bounds))
        table = {par.name: par for par in mechanism.parameters}
        ordered = tuple(name for name in table if name in names)
        if not ordered:
            raise UserError("nothing to estimate", where="free", allowed=", ".join(table))
        low = np.array([table[name].low for name in ordered], dtype=float)
        high = np.array([table[name].high for name in ordered], dtype=float)
        for i, name in enumerate(ordered):
            if bounds.get(name) is None:
                continue
            pair = tuple(float(value) for value in bounds[name])
            if len(pair) != 2 or not low[i] <= pair[0] < pair[1] <= high[i]:
                raise UserError(
                    "impossible bounds",
                    where=f"bounds.{name}",
                    received=pair,
                    allowed=f"two numbers, the lower first, within {low[i]:g} to {high[i]:g}",
                )
            low[i], high[i] = pair
        below = [-1] * len(ordered)
        for upper, lower in _order(mechanism):
            if upper in ordered and lower in ordered:
                below[ordered.index(upper)] = ordered.index(lower)
            elif upper in ordered and lower in fixed:
                i = ordered.index(upper)
                low[i] = max(low[i], fixed[lower] * (1 + LEAST_GAP))
            elif lower in ordered and upper in fixed:
                i = ordered.index(lower)
                high[i] = min(high[i], fixed[upper] * (1 - LEAST_GAP))
        sizes = sizes or {}
        scales = [
            sizes.get(name) or _scale(low[i], high[i], table[name].neutral) if _linear(table[name]) else 0.0
            for i, name in enumerate(ordered)
        ]
        return cls(ordered, low, high, tuple(below), np.array(scales))

    def to_search(self, p: np.ndarray) -> np.ndarray:
        """Return u, shape (n,), of parameters p, shape (n,); p is moved inside the bounds first."""
        p = np.clip(p, self.low, self.high)
        u = np.empty(len(p))
        for i, lower in enumerate(self.below):
            if self.scales[i]:
                u[i] = p[i] / self.scales[i]
            elif lower >= 0:
                u[i] = math.log(max(p[i] - p[lower], LEAST_GAP * p[lower]))
            else:
                u[i] = math.log(max(p[i], 1e-300))
        return np.clip(u, *self.limits)

    def to_values(self, u: np.ndarray) -> np.ndarray:
        """Return the parameters p, SI units, shape (n,), at u, shape (n,)."""
        p = np.where(self.scales > 0, u * self.scales, np.exp(np.minimum(u, 700.0)))
        return np.array([p[i] + (p[lower] if lower >= 0 else 0.0) for i, lower in enumerate(self.below)])

    def jacobian(self, u: np.ndarray) -> np.ndarray:
        """Return dp/du, shape (n, n)."""
        own = np.where(self.scales > 0, self.scales, np.exp(np.minimum(u, 700.0)))
        result = np.diag(own)
        for i, lower in enumerate(self.below):
            if lower >= 0:
                result[i] += result[lower]
        return result

    @property
    def limits(self) -> tuple[np.ndarray, np.ndarray]:
        """Bounds of u, two arrays of shape (n,)."""
        low, high = self.low.copy(), self.high.copy()
        for i, lower in enumerate(self.below):
            if lower >= 0:
                low[i] = max(self.low[i] - self.high[lower], LEAST_GAP * max(self.low[lower], 1e-12))
                high[i] = self.high[i] - self.low[lower]
        with np.errstate(divide="ignore"):
            logs = np.log(np.maximum(low, 1e-300)), np.log(np.maximum(high, 1e-300))
        unit = np.where(self.scales > 0, self.scales, 1.0)
        signed = self.scales > 0
        return np.where(signed, low / unit, logs[0]), np.where(signed, high / unit, logs[1])


def check_names(mechanism: Mechanism, names: Iterable[str]) -> None:
    """Raise :class:`UserError` for a name that is no parameter of the mechanism."""
    table = [par.name for par in mechanism.parameters]
    for name in names:
        if name not in table:
            fix = nearest(name, table) or "use one of these"
            raise UserError("unknown parameter", where=f"free.{name}", allowed=", ".join(table), fix=fix)


def check_fixed(mechanism: Mechanism, fixed: Mapping[str, float]) -> None:
    """Raise :class:`UserError` for a known parameter whose value is no number of its physical range."""
    table = {par.name: par for par in mechanism.parameters}
    for name, value in fixed.items():
        par = table[name]
        number = isinstance(value, int | float | np.number) and not isinstance(value, bool)
        if not number or not par.low <= value <= par.high:
            unit = "" if par.unit == "1" else f" {par.unit}"
            raise UserError("impossible value", where=f"fixed.{name}", received=value,
                            allowed=f"a number from {par.low:g} to {par.high:g}{unit}")  # fmt: skip


def _order(mechanism: Mechanism) -> list[tuple[str, str]]:
    """Pairs (upper, lower) of parameters that the law keeps in order."""
    names = {par.symbol: par.name for par in mechanism.parameters}
    pairs = []
    for expr in mechanism.law.constraints(mechanism.law.symbols):
        upper = [s for s in expr.free_symbols if sp.diff(expr, s) == 1]
        lower = [s for s in expr.free_symbols if sp.diff(expr, s) == -1]
        if len(upper) == len(lower) == 1 and len(expr.free_symbols) == 2:
            pairs.append((names[upper[0]], names[lower[0]]))
    return pairs


def _linear(par: Parameter) -> bool:
    return par.low < 0 or par.low == par.neutral


def _scale(low: float, high: float, neutral: float | None) -> float:
    width = high - low
    if math.isfinite(width):
        return width / 2
    return max(abs(neutral or 0.0), 1.0)
