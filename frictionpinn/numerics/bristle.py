"""Where the bristle starts: the deflection that holds a mechanism at rest, or that of steady sliding."""

from __future__ import annotations

import numpy as np

from .codegen import Kernels

_CREEP = 1e-12


def steady_bristle(kernels: Kernels, start: np.ndarray, u: np.ndarray, p: np.ndarray) -> float:
    """Bristle state z that suits the initial motion, in the system's unit of slip.

    At rest (slip velocity 0) it is the static equilibrium: the z with which every acceleration is zero, limited to
    what the contact can hold, so that a body that can stick stays where it is. In sliding it is the z of z' = 0.
    Where neither is defined (an imposed motion at rest) it is 0.

    Args:
        start: state (q, v, z), shape (n_s,); its z is not used.
        u, p: inputs at the start, shape (n_u,), and parameters, shape (n_p,).
    """
    if not kernels.mechanism.law.memory:
        return 0.0
    m, u = len(kernels.mechanism.free), np.ascontiguousarray(u)
    state = np.append(start[:-1], 0.0)
    if _slip(kernels, state, u, p) != 0:
        return _sliding(kernels, state, u, p)
    rows, slopes = _rows(kernels, state, u, p)
    if m == 0 or not np.any(slopes[:m]):
        return 0.0
    balance = -(rows[:m] @ slopes[:m]) / (slopes[:m] @ slopes[:m])
    creeping = state.copy()
    for j in range(m):
        moved = state.copy()
        moved[m + j] += 1.0
        creeping[m + j] += np.sign(balance) * _CREEP * _slip(kernels, moved, u, p)
    limit = _sliding(kernels, creeping, u, p)
    return balance if abs(balance) <= abs(limit) else limit


def _slip(kernels: Kernels, state: np.ndarray, u: np.ndarray, p: np.ndarray) -> float:
    out = np.zeros(3)
    kernels.plain.outputs(state, np.zeros(kernels.sizes[1]), u, p, out)
    return float(out[0])


def _rows(kernels: Kernels, state: np.ndarray, u: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """R and dR/dz at rest (no acceleration, z' = 0), each of shape (n_w,)."""
    n_s, n_w, _, _ = kernels.sizes
    out = np.zeros(n_w + n_w * (n_s + n_w) + 1)
    kernels.plain.newton(state, np.zeros(n_w), u, p, out)
    return out[:n_w], out[n_w : n_w + n_w * n_s].reshape(n_w, n_s)[:, -1]


def _sliding(kernels: Kernels, state: np.ndarray, u: np.ndarray, p: np.ndarray) -> float:
    rows, slopes = _rows(kernels, state, u, p)
    return float(-rows[-1] / slopes[-1]) if slopes[-1] != 0 else 0.0
