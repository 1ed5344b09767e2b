"""Passes over the activations of a network: each reads and writes every number once."""

from __future__ import annotations

import numpy as np
from numba import njit

_compiled = njit(cache=True, nogil=True, fastmath=True)  # nogil: members of an ensemble run in threads
_TWO = np.float32(2)


@_compiled
def silu(value, slope):
    """silu(a) = a s and its slope, of a in ``value`` and the logistic function s of it in ``slope``; both in place."""
    for i in range(value.size):
        s = slope[i]
        y = value[i] * s
        value[i], slope[i] = y, s + y - y * s


@_compiled
def silu_with_rate(value, slope, rate, bend):
    """As :func:`silu`; ``rate`` becomes that of the value, ``bend`` is set to silu''(a) times the rate of a."""
    for i in range(value.size):
        a, s, r = value[i], slope[i], rate[i]
        y = a * s
        d = s + y - y * s
        bend[i] = (s - s * s) * (_TWO + a - _TWO * y) * r
        value[i], slope[i], rate[i] = y, d, d * r


@_compiled
def pull_back(value, rate, slope, bend):
    """Gradients in an activation's results, ``value`` and ``rate``, become those in its arguments; in place."""
    for i in range(value.size):
        r = rate[i]
        value[i], rate[i] = value[i] * slope[i] + r * bend[i], r * slope[i]
