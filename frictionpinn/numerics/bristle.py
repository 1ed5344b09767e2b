"""Where the bristles start, in equilibrium at rest or in steady sliding, and where the states of effects do."""

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


def steady_bristles(
    kernels: Kernels, start: np.ndarray, u: np.ndarray, p: np.ndarray, which: np.ndarray | None = None
) -> np.ndarray:
    """Bristle states z that suit the initial motion, in the unit of slip of their contacts, shape (bristles,).

    Of contacts at rest (slip velocity 0) they are the static equilibrium: the z with which every acceleration is zero,
    each limited to what its contact can hold, so that a body that can stick stays where it is. Of contacts that slide
    it is the z of z' = 0. Where neither is defined (an imposed motion at rest) it is 0.

    Args:
        start: state (q, v, z), shape (n_s,).
        u, p: inputs at the start, shape (n_u,), and parameters, shape (n_p,).
        which: the bristles that are sought, shape (bristles,), bool; the others are as in the start. None: all.
    """
    if not len(kernels.bristles):
        return np.zeros(0)
    from . import bristle_recursions  # as above

    newton, outputs = pointer(kernels.plain.newton), pointer(kernels.plain.outputs)
    m, u = len(kernels.mechanism.free), np.ascontiguousarray(u)
    which = np.ones(len(kernels.bristles), dtype=np.bool_) if which is None else which
    state = bristle_recursions.steady(newton, outputs, start, u, p, m, kernels.bristles, which, kernels.outputs)
    return state[len(state) - len(which) :]


def start_changes(
    kernels: Kernels,
    start: np.ndarray,
    u: np.ndarray,
    p: np.ndarray,
    columns: np.ndarray,
    states: np.ndarray,
    directions: np.ndarray,
    *,
    steady: np.ndarray,
) -> np.ndarray:
    """Derivative of what settles of the initial state, shape (n_s, n_c): 0 for the rows that are given.

    Central differences of :func:`resting_states` and of :func:`steady_bristles`, of those bristles that are ``steady``,
    shape (bristles,), bool. At rest the bristle jumps with the direction of slip, and its derivative in an initial
    velocity is left at 0.

    Args:
        start, u, p: as above.
        columns, states: index of the parameter and of the initial state that each quantity is, or -1, shape (n_c,).
        directions: du/dc at the start for the last of them, shape (n_directions, recorded inputs).
    """
    m, count = len(kernels.mechanism.free), len(kernels.mechanism.states)
    if not count and not steady.any():
        return np.zeros((len(start), len(columns)))
    from . import bristle_recursions  # as above

    newton, outputs = pointer(kernels.plain.newton), pointer(kernels.plain.outputs)
    u, directions = np.ascontiguousarray(u), np.ascontiguousarray(directions)
    return bristle_recursions.changes(
        newton, outputs, start, u, p, m, count, kernels.bristles, steady, kernels.outputs, columns, states, directions
    )
