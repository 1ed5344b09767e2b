"""Residuals at a coarser resolution in time.

The acceleration jumps where a body comes to rest or breaks away. A model that stops one sample late differs there by
the whole jump, however near its parameters are, and a small change of them changes nothing: among samples the
likelihood is rugged, and the more so the less noise there is. Averaged over a stretch of time, the same residual grows
with the time by which the stop is late: a descent finds the way. What varies slowly keeps all its weight.
"""

from __future__ import annotations

import numpy as np
from numba import njit, types

F2, F3 = types.float64[:, ::1], types.float64[:, :, ::1]


@njit(F3(F3, F2, types.int64), cache=True, nogil=True, error_model="numpy")
def averaged(rows, weight, half):
    """Rows averaged twice over 2 half + 1 samples (a triangular window), at every half-th sample.

    Args:
        rows: shape (signals, n, columns).
        weight: shape (signals, n): 0 where nothing was measured, else 1.
        half: samples to each side.

    Returns:
        shape (signals, ceil(n / half), columns), times sqrt(half): a slow residual keeps its sum of squares.
    """
    signals, n, columns = rows.shape
    kept = (n + half - 1) // half
    result = np.zeros((signals, kept, columns))
    total, means, counts = np.zeros(columns), np.zeros((n, columns)), np.zeros(n)
    scale = np.sqrt(half)
    for i in range(signals):
        total[:] = 0.0
        count = 0.0
        for k in range(-half, n):
            if k + half < n and weight[i, k + half] > 0.0:
                count += 1.0
                for c in range(columns):
                    total[c] += rows[i, k + half, c]
            if k - half - 1 >= 0 and weight[i, k - half - 1] > 0.0:
                count -= 1.0
                for c in range(columns):
                    total[c] -= rows[i, k - half - 1, c]
            if k >= 0:
                counts[k] = 1.0 if count > 0.5 else 0.0
                for c in range(columns):
                    means[k, c] = total[c] / count if count > 0.5 else 0.0
        total[:] = 0.0
        count = 0.0
        for k in range(-half, n):
            if k + half < n:
                count += counts[k + half]
                for c in range(columns):
                    total[c] += means[k + half, c]
            if k - half - 1 >= 0:
                count -= counts[k - half - 1]
                for c in range(columns):
                    total[c] -= means[k - half - 1, c]
            if k >= 0 and k % half == 0 and count > 0.5:
                for c in range(columns):
                    result[i, k // half, c] = scale * total[c] / count
    return result


def samples_within(t: np.ndarray, width: float) -> int:
    """Samples to each side of a window whose weight falls to half within ``width``, s; 0: every sample by itself."""
    return min(int(width / float(np.median(np.diff(t))) + 1e-6), (len(t) - 1) // 2) if width > 0 else 0
