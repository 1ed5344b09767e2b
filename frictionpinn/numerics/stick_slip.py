"""Slip velocity of a contact whose friction force is tabulated, and of one whose bristle settles to a tabulated force.

Along a recording the frictionless slip acceleration A and the normal force N are known; v' = A - mobility F then needs
no equation of motion, and a table no network: ten seconds at 400 Hz with 16 steps a sample take some 20 ms.
"""

from __future__ import annotations

import numpy as np
from numba import njit

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
    """Force F = table(v + shift tanh(v / creep), N), by implicit Euler.

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
            f = _look(table, grid, w + shift * np.tanh(w / creep), N[k])
            miss = w - v - h * (A[k] - mobility * f)
            if k == 0 or abs(miss) < _SETTLED:
                break
            ahead = w + _NUDGE
            slope = (_look(table, grid, ahead + shift * np.tanh(ahead / creep), N[k]) - f) / _NUDGE
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


@njit(cache=True)
def bristle_rollout(table, grid, A, N, h, mobility, v0, force0, p, steps):
    """Bristle z' = v - sigma_0 |v| z / g, F = sigma_0 z + sigma_1 z' + sigma_2 v; z exactly over a step, v explicitly.

    g = gain |table(v + shift sign v, N)| (1 + peak exp(-(v / peak_velocity)^2)).

    Args:
        force0: friction force at the start, which the bristle holds there.
        p: shift, gain, sigma_0, sigma_1, sigma_2, peak, peak_velocity.
        others: see :func:`static_rollout`.
    """
    shift, gain, sigma_0, sigma_1, sigma_2, peak, peak_velocity = p
    count = (len(A) - 1) // steps + 1
    force, slip = np.zeros(count), np.zeros(count)
    v, z = v0, (force0 - sigma_2 * v0) / sigma_0
    for k in range(len(A)):
        sign = 1.0 if v >= 0 else -1.0
        level = gain * abs(_look(table, grid, v + sign * shift, N[k])) + 1e-12
        settled = level * (1 + peak * np.exp(-((v / peak_velocity) ** 2))) / sigma_0
        if k:
            z = sign * settled + (z - sign * settled) * np.exp(-abs(v) * h / settled)
        f = sigma_0 * z + sigma_1 * (v - abs(v) * z / settled) + sigma_2 * v
        if k % steps == 0:
            force[k // steps], slip[k // steps] = f, v
        v += h * (A[k] - mobility * f)
    return force, slip
