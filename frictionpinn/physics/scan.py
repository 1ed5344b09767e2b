"""Values of an effect's hidden parameters to try, as multiples of what the data cover."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

SCALES = {
    "stroke": "range of the slip position",
    "place": "slip position: 0 is the lowest visited, 1 the highest",
    "speed": "largest slip speed",
    "load": "mean normal force",
    "duration": "length of the longest trial, s",
    "interval": "median sampling interval, s",
    "frequency": "one over the length of the longest trial, Hz",
}

DECADES = 2.0  # half-width of a default search range: two decades to either side of the start


@dataclass(frozen=True)
class Scan:
    """``count`` values from ``low`` to ``high`` times a scale of the data (see ``SCALES``).

    Spacing is log, linear, or inverse: even in 1 / value, as wavelengths are told apart.
    """

    of: str
    low: float
    high: float
    count: int
    spacing: str = "log"

    def values(self, scales: Mapping[str, tuple[float, float]]) -> np.ndarray:
        """The values, SI units, shape (count,); ``scales`` as :func:`data_scales` returns them."""
        offset, size = scales[self.of]
        if self.spacing == "inverse":
            return offset + size / np.linspace(1 / self.low, 1 / self.high, self.count)
        space = np.geomspace if self.spacing == "log" else np.linspace
        return offset + size * space(self.low, self.high, self.count)


def data_scales(
    t: Sequence[np.ndarray], position: Sequence[np.ndarray], speed: Sequence[np.ndarray], load: Sequence[np.ndarray]
) -> dict[str, tuple[float, float]]:
    """Offset and size of every scale, SI units.

    Args:
        t: times of each trial, s.
        position, speed, load: slip position, slip velocity and normal force of each trial.
    """
    lowest, highest = min(float(x.min()) for x in position), max(float(x.max()) for x in position)
    duration = max(float(x[-1] - x[0]) for x in t)
    stroke = highest - lowest
    return {
        "stroke": (0.0, stroke),
        "place": (lowest, stroke),
        "speed": (0.0, max(float(np.abs(v).max()) for v in speed)),
        "load": (0.0, float(np.mean(np.concatenate([np.ravel(n) for n in load])))),
        "duration": (0.0, duration),
        "interval": (0.0, float(np.median(np.concatenate([np.diff(x) for x in t])))),
        "frequency": (0.0, 1.0 / duration),
    }
