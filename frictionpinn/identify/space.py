"""The unknown parameters of an estimation: the coordinates in which they are searched, and what is known of them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import UserError
from ..physics.base import beside, plain_name
from ..physics.beforehand import EXCESS, SPREADS
from ..physics.mechanism import Mechanism

LEAST_GAP = 1e-3  # of the lower bound: two parameters that must not cross stay this far apart
TINY, HUGE = 1e-300, 700.0  # values below which and exponents beyond which a logarithm has no number


@dataclass(frozen=True)
class Space:
    """Free parameters p and the vector u in which they are searched.

    u is log p; log(p - p_below) for a parameter that must not fall below another free one (mu_s above mu_c); and
    p / scale for a parameter that may be zero or negative (the strength of an effect, a place, viscous friction).

    Attributes:
        names: free parameters, in the mechanism's order.
        low, high: their bounds, SI units, shape (n,); -inf and inf where there is none.
        below: index of the free parameter that each must exceed, or -1.
        scales: 0 for a logarithmic parameter, else the unit in which it is searched, SI units, shape (n,).
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
        bounds: Mapping[str, Sequence[float] | None],
        fixed: Mapping[str, float],
        sizes: Mapping[str, float],
    ) -> Space:
        """Check names and bounds against the mechanism's parameters.

        Args:
            mechanism, names: the parameters, and which are free.
            bounds: name -> (low, high), SI units; the physical range where there are none.
            fixed: name -> value of those that are known, SI units.
            sizes: name -> unit in which it is searched if it may be zero; where that is 0, half its bounds' width.

        Raises:
            UserError: an unknown name, bounds that are empty or outside the parameter's physical range.
        """
        mechanism.check_names((*names, *bounds), "free")
        table = {par.name: par for par in mechanism.parameters}
        ordered = tuple(name for name in table if name in names)
        if not ordered:
            raise UserError("nothing to estimate", where="free", allowed=", ".join(table))
        low = np.array([table[name].low for name in ordered], dtype=float)
        high = np.array([table[name].high for name in ordered], dtype=float)
        for i, name in enumerate(ordered):
            given = bounds.get(name)
            if given is None:
                continue
            pair = tuple(float(value) for value in given)
            if len(pair) != 2 or not low[i] <= pair[0] < pair[1] <= high[i]:
                raise UserError("impossible bounds", where=f"bounds.{name}", received=pair,
                                allowed=f"two numbers, the lower first, within {low[i]:g} to {high[i]:g}")  # fmt: skip
            low[i], high[i] = pair
        below = [-1] * len(ordered)
        for upper, lower in mechanism.law.order:
            if upper in ordered and lower in ordered:
                below[ordered.index(upper)] = ordered.index(lower)
            elif upper in ordered and lower in fixed:
                i = ordered.index(upper)
                low[i] = max(low[i], fixed[lower] * (1 + LEAST_GAP))
            elif lower in ordered and upper in fixed:
                i = ordered.index(lower)
                high[i] = min(high[i], fixed[upper] * (1 - LEAST_GAP))
        widths = zip(ordered, high - low, strict=True)
        scales = [(sizes[name] or width / 2) if table[name].linear else 0.0 for name, width in widths]
        return cls(ordered, low, high, tuple(below), np.array(scales))

    def to_search(self, values: Mapping[str, float] | np.ndarray) -> np.ndarray:
        """Return u, shape (n,), of parameters, SI units, by name or shape (n,); they are moved inside the bounds."""
        given = [values[name] for name in self.names] if isinstance(values, Mapping) else values
        p = np.clip(np.asarray(given, dtype=float), self.low, self.high)
        u = np.empty(len(p))
        for i, lower in enumerate(self.below):
            if self.scales[i]:
                u[i] = p[i] / self.scales[i]
            elif lower >= 0:
                u[i] = math.log(max(p[i] - p[lower], LEAST_GAP * p[lower]))
            else:
                u[i] = math.log(max(p[i], TINY))
        return np.clip(u, *self.limits)

    def to_values(self, u: np.ndarray) -> np.ndarray:
        """Return the parameters p, SI units, shape (n,), at u, shape (n,)."""
        own = self.own(u)
        return np.array([x + (own[lower] if lower >= 0 else 0.0) for x, lower in zip(own, self.below, strict=True)])

    def named(self, u: np.ndarray) -> dict[str, float]:
        """Return the parameters by name, SI units, at u, shape (n,)."""
        return dict(zip(self.names, self.to_values(u).tolist(), strict=True))

    def own(self, u: np.ndarray) -> np.ndarray:
        """Return p, or its excess over the parameter that it must exceed, SI units, shape (n,), at u, shape (n,)."""
        return np.where(self.scales > 0, u * self.scales, np.exp(np.minimum(u, HUGE)))

    def jacobian(self, u: np.ndarray) -> np.ndarray:
        """Return dp/du, shape (n, n)."""
        result = np.diag(np.where(self.scales > 0, self.scales, self.own(u)))
        for i, lower in enumerate(self.below):
            if lower >= 0:
                result[i] += result[lower]
        return result

    @property
    def bounds(self) -> dict[str, tuple[float, float]]:
        """name -> (low, high), SI units."""
        return dict(zip(self.names, zip(self.low.tolist(), self.high.tolist(), strict=True), strict=True))

    def reaching(self, values: Mapping[str, float]) -> dict[str, tuple[float, float]]:
        """The bounds moved out as far as these values, SI units."""
        return {name: (min(low, values[name]), max(high, values[name])) for name, (low, high) in self.bounds.items()}

    @property
    def limits(self) -> tuple[np.ndarray, np.ndarray]:
        """Bounds of u, two arrays of shape (n,)."""
        low, high = self.low.copy(), self.high.copy()
        for i, lower in enumerate(self.below):
            if lower >= 0:
                low[i] = max(self.low[i] - self.high[lower], LEAST_GAP * max(self.low[lower], 1e-12))
                high[i] = self.high[i] - self.low[lower]
        with np.errstate(divide="ignore"):
            logs = np.log(np.maximum(low, TINY)), np.log(np.maximum(high, TINY))
        signed = self.scales > 0
        unit = np.where(signed, self.scales, 1.0)
        return np.where(signed, low / unit, logs[0]), np.where(signed, high / unit, logs[1])


@dataclass(frozen=True)
class Prior:
    """What is known of static friction and Stribeck velocity before any recording, as rows A u = b of unit deviation.

    log((mu_s - mu_c) / mu_c) is about log 0.5, and v_s about a fiftieth of the slip velocity (root mean square), both
    log-normal. Few samples tell these two: where a search has one of them at an end of its range, the other shows no
    more, and from a likelihood so flat no descent comes back. Intervals are those of the likelihood alone.

    Attributes:
        rows: A, shape (n, n_u).
        target: b, shape (n,).
        about: name -> what is expected, in words.
        expected: name -> value about which a prior is put, SI units.
    """

    rows: np.ndarray
    target: np.ndarray
    about: dict[str, str]
    expected: Mapping[str, float]

    @classmethod
    def of(cls, space: Space, expected: Mapping[str, float], fixed: Mapping[str, float]) -> Prior:
        """The prior of those of the two that are free in the space and expected somewhere."""
        rows: list[np.ndarray] = []
        target: list[float] = []
        about: dict[str, str] = {}
        kept = {name: value for name, value in expected.items() if plain_name(name) in SPREADS}
        for i, name in ((i, name) for i, name in enumerate(space.names) if name in kept):
            own, mu_c, lower = plain_name(name), beside(name, "mu_c"), space.below[i]
            row, spread = np.eye(len(space.names))[i], SPREADS[own]
            if own == "mu_s" and lower >= 0:
                row[lower], value = -1.0, np.log(EXCESS)
                about[name] = (
                    f"{1 + EXCESS:g} {mu_c}, its excess over {mu_c} within a factor of {np.exp(2 * spread):.2g}"
                )
            else:
                middle = (1 + EXCESS) * fixed[mu_c] if own == "mu_s" and mu_c in fixed else float(expected[name])
                value = np.log(middle)
                about[name] = f"{middle:.2g}, within a factor of {np.exp(2 * spread):.2g}"
            rows.append(row / spread)
            target.append(value / spread)
        return cls(np.array(rows).reshape(len(rows), len(space.names)), np.array(target), about, kept)

    @property
    def information(self) -> np.ndarray:
        """What it adds to the information on u, shape (n_u, n_u)."""
        return self.rows.T @ self.rows

    def distance(self, u: np.ndarray) -> np.ndarray:
        """A u - b at u, shape (n,): half its square is what the prior costs."""
        return self.rows @ u - self.target
