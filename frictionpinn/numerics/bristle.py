"""Where the bristle starts, in equilibrium at rest or in steady sliding, and where the states of effects do."""

from __future__ import annotations

import numpy as np

from .codegen import Kernels, pointer


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
    from . import bristle_recursions  # compiles on a new installation: not before it is needed

    newton, outputs = pointer(kernels.plain.newton), pointer(kernels.plain.outputs)
    m, u = len(kernels.mechanism.free), np.ascontiguousarray(u)
    return bristle_recursions.steady(newton, outputs, start, u, p, m)


def _rows(kernels: Kernels, state: np.ndarray, u: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """R, shape (n_w,), and dR/ds, shape (n_w, n_s), with no acceleration and z' = 0."""
    n_s, n_w, _, _ = kernels.sizes
    out = np.zeros(n_w + n_w * (n_s + n_w) + 1)
    kernels.plain.newton(state, np.zeros(n_w), np.ascontiguousarray(u), p, out)
    return out[:n_w], out[n_w : n_w + n_w * n_s].reshape(n_w, n_s)
