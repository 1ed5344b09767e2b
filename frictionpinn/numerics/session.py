"""Where in a session a trial lies: the clocks that an effect may read beside the time of the trial."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import sympy as sp

from ..physics.base import SESSION, TIME, TRIAL


@dataclass(frozen=True)
class Session:
    """A trial's place in its session.

    Attributes:
        offset: time of the session minus time of the trial, s.
        trial: number of the trial, from 1.
    """

    offset: float = 0.0
    trial: int = 1

    def lines(self, clocks: Sequence[sp.Symbol]) -> np.ndarray:
        """Value at t = 0 and slope in t of each clock (of ``Mechanism.clocks``), shape (clocks, 2)."""
        table = {TIME: (0.0, 1.0), SESSION: (self.offset, 1.0), TRIAL: (float(self.trial), 0.0)}
        return np.array([table[symbol] for symbol in clocks]).reshape(-1, 2)


ALONE = Session()
