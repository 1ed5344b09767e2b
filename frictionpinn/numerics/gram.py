"""Sums over the samples of one trial, without BLAS: its threads and ours would fight for the same cores."""

from __future__ import annotations

import numpy as np
from numba import njit, types

FEW = 4  # times the entries of a row are fewer than its columns: from where an index costs less than all between
F1, F2 = types.float64[::1], types.float64[:, ::1]


@njit(types.Tuple((F2, F1))(F2, F1, F1), cache=True, nogil=True, error_model="numpy")
def gram(J, r, w):
    """Return J' diag(w) J, shape (c, c), and J' diag(w) r, shape (c,), of J (rows, c), r (rows,) and w (rows,).

    Four rows at a time: H, which does not stay in the nearest cache, is read and written a quarter as often. Rows of
    few entries, as splines have, are multiplied entry by entry.
    """
    rows, n = J.shape
    H, g, entries = np.zeros((n, n)), np.zeros(n), np.empty(n, np.int64)
    for k in range(0, rows, 4):
        k1, k2, k3 = min(k + 1, rows - 1), min(k + 2, rows - 1), min(k + 3, rows - 1)
        w0, w1 = w[k], w[k1] if k + 1 < rows else 0.0
        w2, w3 = w[k2] if k + 2 < rows else 0.0, w[k3] if k + 3 < rows else 0.0
        if w0 == 0.0 and w1 == 0.0 and w2 == 0.0 and w3 == 0.0:
            continue
        count = 0
        for i in range(n):
            if J[k, i] != 0.0 or J[k1, i] != 0.0 or J[k2, i] != 0.0 or J[k3, i] != 0.0:
                entries[count] = i
                count += 1
        few = FEW * count < n
        for own in range(count):
            i = entries[own]
            a0, a1, a2, a3 = w0 * J[k, i], w1 * J[k1, i], w2 * J[k2, i], w3 * J[k3, i]
            g[i] += a0 * r[k] + a1 * r[k1] + a2 * r[k2] + a3 * r[k3]
            if few:
                for other in range(own + 1):
                    j = entries[other]
                    H[i, j] += a0 * J[k, j] + a1 * J[k1, j] + a2 * J[k2, j] + a3 * J[k3, j]
            else:
                for j in range(entries[0], i + 1):
                    H[i, j] += a0 * J[k, j] + a1 * J[k1, j] + a2 * J[k2, j] + a3 * J[k3, j]
    for i in range(n):
        for j in range(i):
            H[j, i] = H[i, j]
    return H, g
