"""The Gauss-Newton matrix of one trial, without BLAS: its threads and ours would fight for the same cores."""

from __future__ import annotations

import numpy as np
from numba import njit, types

F1, F2 = types.float64[::1], types.float64[:, ::1]


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
