"""Where the bristle starts, in equilibrium at rest or in steady sliding, and where the states of effects do."""

from __future__ import annotations

import numpy as np

from .codegen import Kernels, pointer


def resting_states(kernels: Kernels, start: np.ndarray, u: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Return the initial state with the states of effects where they rest; each enters its own rate linearly."""
    m, count = len(kernels.mechanism.free), len(kernels.mechanism.states)
    if not count:
        return start.copy()
    from . import bristle_recursions  # compiles on a new installation: not before it is needed

    return bristle_recursions.rest(pointer(kernels.plain.newton), start, np.ascontiguousarray(u), p, m, count)


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
    from . import bristle_recursions  # as above

    newton, outputs = pointer(kernels.plain.newton), pointer(kernels.plain.outputs)
    m, u = len(kernels.mechanism.free), np.ascontiguousarray(u)
    return bristle_recursions.steady(newton, outputs, start, u, p, m)


def start_changes(
    kernels: Kernels,
    start: np.ndarray,
    u: np.ndarray,
    p: np.ndarray,
    columns: np.ndarray,
    states: np.ndarray,
    directions: np.ndarray,
    *,
    steady: bool,
) -> np.ndarray:
    """Derivative of what settles of the initial state, shape (n_s, n_c): 0 for the rows that are given.

    Central differences of :func:`resting_states` and, with ``steady``, :func:`steady_bristle`. At rest the bristle
    jumps with the direction of slip, and its derivative in an initial velocity is left at 0.

    Args:
        start, u, p: as above.
        columns, states: index of the parameter and of the initial state that each quantity is, or -1, shape (n_c,).
        directions: du/dc at the start for the last of them, shape (n_directions, recorded inputs).
    """
    m, count, steady = len(kernels.mechanism.free), len(kernels.mechanism.states), steady and kernels.mechanism.memory
    if not count and not steady:
        return np.zeros((len(start), len(columns)))
    from . import bristle_recursions  # as above

    newton, outputs = pointer(kernels.plain.newton), pointer(kernels.plain.outputs)
    u, directions = np.ascontiguousarray(u), np.ascontiguousarray(directions)
    return bristle_recursions.changes(newton, outputs, start, u, p, m, count, steady, columns, states, directions)
