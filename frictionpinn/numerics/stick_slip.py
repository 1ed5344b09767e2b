"""Slip velocity of a contact whose friction force is tabulated, and of one whose bristle settles to a tabulated force.

Along a recording the frictionless slip acceleration A and the normal force N are known; v' = A - mobility F then needs
no equation of motion, and a table no network: ten seconds at 400 Hz with 16 steps a sample take some 20 ms.
"""

from __future__ import annotations

import numpy as np
from numba import njit, types

from .integrator import F1, F2, KERNEL, OPTIONS
from .sliding import level, past_rest

_FLOATS = (types.float64,) * 6
_ITERATIONS, _SETTLED, _NUDGE = 50, 1e-9, 1e-6


@njit(cache=True)
def _look(table, grid, v, N):
    """Bilinear interpolation; grid: first velocity, its step, first normal force, its step."""
    x, y = (v - grid[0]) / grid[1], (N - grid[2]) / grid[3]
    i = max(0, min(int(x), table.shape[0] - 2))
    j = max(0, min(int(y), table.shape[1] - 2))
    x, y = x - i, y - j
    low = (1 - y) * table[i, j] + y * table[i, j + 1]
    return (1 - x) * low + x * ((1 - y) * table[i + 1, j] + y * table[i + 1, j + 1])


@njit(cache=True)
def static_rollout(table, grid, A, N, h, mobility, v0, shift, creep, steps):
    """Force F = table(past_rest(v), N), by implicit Euler.

    Args:
        table: force, shape (velocities, normal forces), on ``grid`` (see :func:`_look`).
        A, N: frictionless slip acceleration and normal force at the steps, shape ((n - 1) steps + 1,).
        h: step, s; ``steps`` of them per sample.
        v0: slip velocity at the start.

    Returns:
        force and slip velocity at the samples, shape (n,) each.
    """
    count = (len(A) - 1) // steps + 1
    force, slip = np.zeros(count), np.zeros(count)
    v = v0
    for k in range(len(A)):
        w, low, high, f = v, v - 1e3, v + 1e3, 0.0
        for _ in range(_ITERATIONS):
            f = _look(table, grid, past_rest(w, shift, creep), N[k])
            miss = w - v - h * (A[k] - mobility * f)
            if k == 0 or abs(miss) < _SETTLED:
                break
            ahead = w + _NUDGE
            slope = (_look(table, grid, past_rest(ahead, shift, creep), N[k]) - f) / _NUDGE
            if miss > 0:
                high = w
            else:
                low = w
            w -= miss / (1 + h * mobility * slope)
            if not low < w < high:
                w = (low + high) / 2 if high - low < 1e3 else v
        v = w
        if k % steps == 0:
            force[k // steps], slip[k // steps] = f, v
    return force, slip


@njit(types.UniTuple(F1, 2)(KERNEL, KERNEL, F2, F1, F1, F1, *_FLOATS, F1, types.int64), **OPTIONS)
def bristle_rollout(rate_of, force_of, table, grid, A, N, h, mobility, v0, force0, shift, gain, p, steps):
    """Law with memory, linear in z, whose normal force is the level of sliding; z exact over a step, v explicit.

    level = gain |table(v + shift sign v, N)|; with k = dz'/dz a step adds z' (exp(k h) - 1) / k to z.

    Args:
        rate_of, force_of: kernels of :class:`.bristle_law.BristleLaw`.
        force0: friction force at the start, which the bristle holds there.
        p: parameters of the law.
        others: see :func:`static_rollout`.
    """
    count = (len(A) - 1) // steps + 1
    force, slip = np.zeros(count), np.zeros(count)
    s, rate, u, out = np.array([v0, 0.0]), np.zeros(1), np.zeros(1), np.zeros(2)
    force_of(s, rate, u, p, out)
    rest = out[0]
    s[1] = 1.0
    force_of(s, rate, u, p, out)
    s[1] = (force0 - rest) / (out[0] - rest)
    for k in range(len(A)):
        v = s[0]
        u[0] = level(_look(table, grid, v + np.copysign(shift, v), N[k]), gain)
        rate_of(s, rate, u, p, out)
        rate[0] = out[0]
        if k:
            fade = np.expm1(out[1] * h)
            s[1] += out[0] * (fade / out[1] if out[1] != 0 else h)
            rate[0] *= 1 + fade
        force_of(s, rate, u, p, out)
        if k % steps == 0:
            force[k // steps], slip[k // steps] = out[0], v
        s[0] = v + h * (A[k] - mobility * out[0])
    return force, slip
