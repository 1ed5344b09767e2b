"""Whether samples still are where model and noise levels expect them, from the innovations of a short while."""

from __future__ import annotations

import math
from collections import deque

WINDOW = 0.2  # s: short beside a motion; a sensor that fails or a surface that changes is told within it
FACTOR = 2.0  # errors may be so many times those told: beyond, a 95 % interval holds less than two thirds
QUANTILE = 4.7534  # of the normal distribution, one-sided: one window in a million by chance
MOST = 1e6  # of a degree of freedom: what is larger tells no more, and would drown the sum in rounding


def limit(freedom: int) -> float:
    """Value that a chi-squared variable exceeds once in a million times, above it by at most a sixth.

    Source: Wilson and Hilferty, The distribution of chi-square, PNAS 17 (1931).
    """
    spread = 2 / (9 * freedom)
    return freedom * (1 - spread + QUANTILE * math.sqrt(spread)) ** 3


class Consistency:
    """Sum of the normalised innovations squared, e'S^-1 e, over the last ``WINDOW`` seconds.

    It is chi-squared with as many degrees of freedom as there were readings, where model and noise levels are right
    (Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, 5.4). Samples are
    inconsistent where it exceeds ``FACTOR`` squared times its limit: the errors are larger than a factor of ``FACTOR``
    and chance explain. More samples a second make that surer, not stricter.
    """

    def __init__(self):
        self.clear()

    def clear(self) -> None:
        """Forget all samples."""
        self._kept: deque[tuple[float, float, int]] = deque()
        self._sum, self._freedom = 0.0, 0

    def add(self, t: float, square: float, freedom: int) -> bool:
        """Take in a sample; return whether those of the window are consistent.

        Args:
            t: time, s.
            square: its normalised innovation squared; one that is no number counts as the largest.
            freedom: its degrees of freedom, 0 where nothing was measured.
        """
        most = MOST * freedom
        square = float(square) if square <= most else most
        self._kept.append((t, square, freedom))
        self._sum, self._freedom = self._sum + square, self._freedom + freedom
        while self._kept[0][0] <= t - WINDOW:
            _, old, readings = self._kept.popleft()
            self._sum, self._freedom = self._sum - old, self._freedom - readings
        return not self._freedom or self._sum <= FACTOR**2 * limit(self._freedom)
