"""How a tabulated or learned sliding force is read near rest; for scalars in compiled code and for arrays."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True)
def past_rest(v, shift, creep):
    """Velocity at which the sliding force is looked up: v + shift tanh(v / creep), so that it reaches to rest."""
    return v + shift * np.tanh(v / creep)


@njit(cache=True)
def level(sliding, gain):
    """Steady force gain |sliding|, never 0, since the bristle's rate is divided by it."""
    return gain * np.abs(sliding) + 1e-12
