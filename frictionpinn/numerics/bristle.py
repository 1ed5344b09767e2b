"""Where the bristle starts, in equilibrium at rest or in steady sliding, and where the states of effects do."""

from __future__ import annotations

import numpy as np

from .codegen import Kernels

_CREEP = 1e-12
_SETTLED = 1e-12  # relative change of z that ends the search for its root


def resting_states(kernels: Kernels, start: np.ndarray, u: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Return the initial state with the states of effects where they rest; each enters its own rate linearly."""
    m, count = len(kernels.mechanism.free), len(kernels.mechanism.states)
    state = start.copy()
    if not count:
        return state
    state[2 * m : 2 * m + count] = 0.0
    rows, slopes = _rows(kernels, state, u, p)
    own = slopes[m : m + count, 2 * m : 2 * m + count].diagonal()
    state[2 * m : 2 * m + count] = -rows[m : m + count] / own
    return state


def steady_bristle(kernels: Kernels, start: np.ndarray, u: np.ndarray, p: np.ndarray) -> float:
    """Bristle state z that suits the initial motion, in the system's unit of slip.

    At rest (slip velocity 0) it is the static equilibrium: the z with which every acceleration is zero, limited to
    what the contact can hold, so that a body that can stick stays where it is. In sliding it is the z of z' = 0.
    Where neither is defined (an imposed motion at rest) it is 0.

    Args:
        start: state (q, v, z), shape (n_s,); its z is not used.
        u, p: inputs at the start, shape (n_u,), and parameters, shape (n_p,).
    """
    if not kernels.mechanism.memory:
        return 0.0
    m, u = len(kernels.mechanism.free), np.ascontiguousarray(u)
    state = np.append(start[:-1], 0.0)
    if _slip(kernels, state, u, p) != 0:
        return _sliding(kernels, state, u, p)
    balance = _root(kernels, state, u, p, slice(0, m))
    if balance == 0.0:
        return 0.0
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
    """R, shape (n_w,), and dR/ds, shape (n_w, n_s), with no acceleration and z' = 0."""
    n_s, n_w, _, _ = kernels.sizes
    out = np.zeros(n_w + n_w * (n_s + n_w) + 1)
    kernels.plain.newton(state, np.zeros(n_w), np.ascontiguousarray(u), p, out)
    return out[:n_w], out[n_w : n_w + n_w * n_s].reshape(n_w, n_s)


def _root(kernels: Kernels, state: np.ndarray, u: np.ndarray, p: np.ndarray, which: slice) -> float:
    """The z at which these rows vanish in the least-squares sense, by Newton's method; 0 where z does not enter them.

    One step is enough for the laws, which are linear in z; a gap takes a few.
    """
    state = state.copy()
    for _ in range(30):
        rows, slopes = _rows(kernels, state, u, p)
        rows, own = rows[which], slopes[which, -1]
        if not own.any():
            return 0.0
        change = -float(rows @ own) / float(own @ own)
        if abs(change) <= _SETTLED * abs(state[-1]):
            break
        state[-1] += change
    return float(state[-1])


def _sliding(kernels: Kernels, state: np.ndarray, u: np.ndarray, p: np.ndarray) -> float:
    return _root(kernels, state, u, p, slice(-1, None))
