"""Butcher tableaus of the implicit one-step methods."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np


@dataclass(frozen=True)
class Tableau:
    """ESDIRK method: explicit first stage, one diagonal value gamma, stiffly accurate (b is the last row), L-stable.

    Attributes:
        a: stage coefficients, shape (stages, stages), lower triangular.
        error: b - b_hat, shape (stages,): weights of the embedded error estimate.
        order: order of the step.
        order_embedded: order of b_hat.
    """

    name: str
    a: np.ndarray
    error: np.ndarray
    order: int
    order_embedded: int

    @property
    def c(self) -> np.ndarray:
        """Stage times as fractions of the step, shape (stages,)."""
        return self.a.sum(axis=1)

    @property
    def order_error(self) -> int:
        """Power of the step size with which the error estimate of one step goes to 0."""
        return min(self.order, self.order_embedded) + 1


def _tableau(name: str, rows: list[list[float]], embedded: list[float], order: int, order_embedded: int) -> Tableau:
    a = np.zeros((len(rows), len(rows)))
    for i, row in enumerate(rows):
        a[i, : len(row)] = row
    return Tableau(name, a, a[-1] - np.asarray(embedded), order, order_embedded)


def tr_bdf2() -> Tableau:
    """TR-BDF2, order 2 with an embedded order 3. Source: Hosea and Shampine, Appl. Numer. Math. 20 (1996)."""
    g, w = 1 - sqrt(2) / 2, sqrt(2) / 4
    return _tableau("tr_bdf2", [[0], [g, g], [w, w, g]], [(1 - w) / 3, (3 * w + 1) / 3, g / 3], 2, 3)


def kvaerno3() -> Tableau:
    """Order 3, embedded order 2, both stiffly accurate. Source: Kvaerno, BIT 44 (2004)."""
    g = 0.43586652150845899942
    third = [(-4 * g**2 + 6 * g - 1) / (4 * g), (1 - 2 * g) / (4 * g), g]
    fourth = [(6 * g - 1) / (12 * g), -1 / ((24 * g - 12) * g), (-6 * g**2 + 6 * g - 1) / (6 * g - 3), g]
    return _tableau("kvaerno3", [[0], [g, g], third, fourth], [*third, 0], 3, 2)


def esdirk4() -> Tableau:
    """Order 4, embedded order 3: ARK4(3)6L[2]SA. Source: Kennedy and Carpenter, Appl. Numer. Math. 44 (2003)."""
    g = 1 / 4
    rows: list[list[float]] = [
        [0],
        [g, g],
        [8611 / 62500, -1743 / 31250, g],
        [5012029 / 34652500, -654441 / 2922500, 174375 / 388108, g],
        [15267082809 / 155376265600, -71443401 / 120774400, 730878875 / 902184768, 2285395 / 8070912, g],
        [82889 / 524892, 0, 15625 / 83664, 69875 / 102672, -2260 / 8211, g],
    ]
    embedded = [
        4586570599 / 29645900160,
        0,
        178811875 / 945068544,
        814220225 / 1159782912,
        -3700637 / 11593932,
        61727 / 225920,
    ]
    return _tableau("esdirk4", rows, embedded, 4, 3)


TABLEAUS = {tableau.name: tableau for tableau in (tr_bdf2(), kvaerno3(), esdirk4())}

METHOD = TABLEAUS["kvaerno3"]  # on the pendulum on a box a quarter of the others' error in the same time
