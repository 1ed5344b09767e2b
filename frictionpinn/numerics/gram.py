"""Sums over the samples of one trial, without BLAS: its threads and ours would fight for the same cores."""

from __future__ import annotations

import numpy as np
from numba import njit, types

F1, F2, F4 = types.float64[::1], types.float64[:, ::1], types.float64[:, :, :, ::1]


@njit(types.Tuple((F2, F1))(F2, F1, F1), cache=True, nogil=True, error_model="numpy")
def gram(J, r, w):
    """Return J' diag(w) J, shape (c, c), and J' diag(w) r, shape (c,), of J (rows, c), r (rows,) and w (rows,)."""
    rows, n = J.shape
    H, g = np.zeros((n, n)), np.zeros(n)
    for k in range(rows):
        weight = w[k]
        if weight == 0.0:
            continue
        first = 0
        while first < n and J[k, first] == 0.0:  # a row of splines has six entries
            first += 1
        for i in range(first, n):
            a = weight * J[k, i]
            if a == 0.0:
                continue
            g[i] += a * r[k]
            for j in range(first, i + 1):
                H[i, j] += a * J[k, j]
    for i in range(n):
        for j in range(i):
            H[j, i] = H[i, j]
    return H, g


@njit(types.float64[:, :, ::1](F1, F4), cache=True, nogil=True, error_model="numpy")
def combined(values, pieces):
    """sum_j values[j] pieces[j], pieces of shape (count, n, orders, powers), each 0 but in one stretch (a spline)."""
    count, n, orders, powers = pieces.shape
    result = np.zeros((n, orders, powers))
    first = 0
    for j in range(count):
        while first < n and not np.any(pieces[j, first] != 0.0):
            first += 1
        k = first
        while k < n:
            there = False
            for i in range(orders):
                for m in range(powers):
                    if pieces[j, k, i, m] != 0.0:
                        there = True
                        result[k, i, m] += values[j] * pieces[j, k, i, m]
            if not there:
                break
            k += 1
    return result
