"""Pieces of a spline, polynomials about the time of a knot, as polynomials about the times of samples: compiled."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit, types

F1, F2, F4 = types.float64[::1], types.float64[:, ::1], types.float64[:, :, :, ::1]
I1, I2 = types.int64[::1], types.int64[:, ::1]
OPTIONS: dict[str, Any] = {"cache": True, "nogil": True, "error_model": "numpy"}


@njit(types.void(F1, types.float64), **OPTIONS)
def move(c, by):
    """Coefficients of a polynomial in x made those in x - by, in place (Horner's scheme, repeated)."""
    for first in range(c.shape[0] - 1):
        for m in range(c.shape[0] - 2, first - 1, -1):
            c[m] += by * c[m + 1]


@njit(types.float64[:, :, ::1](F1, F4, F1, I1), **OPTIONS)
def combined(values, pieces, t, breaks):
    """A spline and its derivatives between its samples, shape (n - 1, orders, powers).

    Args:
        values: of its coefficients, shape (size,).
        pieces: between two knots, of those that act there, shape (intervals, orders, powers, acting).
        t: samples, shape (n,); ``breaks`` are the indices of knots.
    """
    powers = pieces.shape[2]
    result = np.zeros((t.shape[0] - 1, pieces.shape[1], powers))
    own = np.empty(powers)
    for b in range(breaks.shape[0] - 1):
        for m in range(powers):
            own[m] = 0.0
            for lane in range(pieces.shape[3]):
                own[m] += values[b + lane] * pieces[b, 0, m, lane]
        for k in range(breaks[b], breaks[b + 1]):
            for m in range(powers):
                result[k, 0, m] = own[m]
            move(result[k, 0], t[k] - t[breaks[b]])
            for i in range(1, pieces.shape[1]):
                for m in range(powers - i):
                    result[k, i, m] = (m + 1) * result[k, i - 1, m + 1]
    return result


@njit(types.float64[:, :, :, ::1](F4, I2, I2, I2, F2, types.int64), **OPTIONS)
def unfolded(pieces, lanes, groups, piece, since, count):
    """Directions between all samples, shape (count, n - 1, columns, powers), see :class:`.directions.Directions`."""
    result = np.zeros((count, piece.shape[1], pieces.shape[1], pieces.shape[2]))
    for g in range(groups.shape[0]):
        for k in range(groups[g, 0], groups[g, 1] + 1):
            at = piece[g, k]
            for lane in range(lanes.shape[1]):
                j = lanes[at, lane]
                if j < 0:
                    continue
                for i in range(groups[g, 2], groups[g, 2] + groups[g, 3]):
                    for m in range(pieces.shape[2]):
                        result[j, k, i, m] = pieces[at, i, m, lane]
                    move(result[j, k, i], since[g, k])
    return result
