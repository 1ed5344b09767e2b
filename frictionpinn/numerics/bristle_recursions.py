"""Compiled search for the initial states that are not given, and their derivatives: see :mod:`.bristle`.

numba's cache does not notice a change in a function imported from another file: after editing integrator.py, touch
this file too.
"""

from __future__ import annotations

import numpy as np
from numba import njit, types

from .integrator import F1, F2, KERNEL, OPTIONS

CREEP = 1e-12
SETTLED = 1e-12  # relative change of z that ends the search for its root
MOST = 30  # steps of that search
SHIFT, LEAST = 1e-6, 1e-2  # of a value, by which it is shifted for a difference; the size of a parameter that is 0


@njit(types.float64(KERNEL, F1, F1, F1, F1, types.int64, types.int64, F1), **OPTIONS)
def root(newton, state, w, u, p, first, last, out):
    """The z at which the rows from first to last vanish in the least-squares sense, by Newton's method; 0 where z does
    not enter them. It is written into the state.

    One step is enough for the laws, which are linear in z; a gap takes a few.
    """
    n_s, n_w = state.shape[0], w.shape[0]
    for _ in range(MOST):
        newton(state, w, u, p, out)
        along, own = 0.0, 0.0
        for i in range(first, last):
            slope = out[n_w + i * n_s + n_s - 1]
            along += out[i] * slope
            own += slope * slope
        if own == 0.0:
            return 0.0
        change = -along / own
        if abs(change) <= SETTLED * abs(state[n_s - 1]):
            break
        state[n_s - 1] += change
    return state[n_s - 1]


@njit(types.float64(KERNEL, KERNEL, F1, F1, F1, types.int64), **OPTIONS)
def steady(newton, outputs, start, u, p, m):
    """Bristle state that suits the initial motion, see :func:`.bristle.steady_bristle`; z of the start is not used."""
    n_s, n_w = start.shape[0], start.shape[0] - m
    state, w, shown = start.copy(), np.zeros(n_w), np.zeros(3)
    out = np.zeros(n_w + n_w * (n_s + n_w) + 1)
    state[n_s - 1] = 0.0
    outputs(state, w, u, p, shown)
    if shown[0] != 0.0:
        return root(newton, state, w, u, p, n_w - 1, n_w, out)
    creeping = state.copy()
    balance = root(newton, state, w, u, p, 0, m, out)
    if balance == 0.0:
        return 0.0
    state[n_s - 1] = 0.0
    for j in range(m):
        moved = state.copy()
        moved[m + j] += 1.0
        shown[:] = 0.0
        outputs(moved, w, u, p, shown)
        creeping[m + j] += np.sign(balance) * CREEP * shown[0]
    limit = root(newton, creeping, w, u, p, n_w - 1, n_w, out)
    return balance if abs(balance) <= abs(limit) else limit


@njit(F1(KERNEL, F1, F1, F1, types.int64, types.int64), **OPTIONS)
def rest(newton, start, u, p, m, count):
    """The start with that many states of effects where they rest; each enters its own rate linearly."""
    n_s, n_w = start.shape[0], start.shape[0] - m
    state = start.copy()
    if count == 0:
        return state
    state[2 * m : 2 * m + count] = 0.0
    out = np.zeros(n_w + n_w * (n_s + n_w) + 1)
    newton(state, np.zeros(n_w), u, p, out)
    for k in range(count):
        row, own = m + k, 2 * m + k
        state[own] = -out[row] / out[n_w + row * n_s + own]
    return state


@njit(F1(KERNEL, KERNEL, F1, F1, F1, types.int64, types.int64, types.boolean), **OPTIONS)
def settled(newton, outputs, start, u, p, m, count, steadied):
    """The start with the states of effects at rest and, where it is ``steadied``, the bristle steady."""
    state = rest(newton, start, u, p, m, count)
    if steadied:
        state[-1] = steady(newton, outputs, state, u, p, m)
    return state


@njit(
    F2(KERNEL, KERNEL, F1, F1, F1, types.int64, types.int64, types.boolean, types.int64[::1], types.int64[::1], F2),
    **OPTIONS,
)
def changes(newton, outputs, start, u, p, m, count, steadied, columns, states, directions):
    """Derivative of what settles of the start in every quantity, shape (n_s, n_c), by central differences.

    Args:
        count, steadied: see :func:`settled`.
        columns, states: index of the parameter and of the initial state that each quantity is, or -1.
        directions: du/dc at the start for the last of them, shape (n_directions, recorded inputs).
    """
    n_c, n_s = columns.shape[0], start.shape[0]
    first, result = n_c - directions.shape[0], np.zeros((n_s, n_c))
    settles = np.zeros(n_s, dtype=np.bool_)
    settles[2 * m : 2 * m + count] = True
    settles[n_s - 1] |= steadied
    s, inputs, values = start.copy(), u.copy(), p.copy()
    for c in range(n_c):
        size = 0.0
        if c >= first:
            largest = np.abs(directions[c - first]).max() if directions.shape[1] else 0.0
            size = SHIFT / max(largest, 1e-12) if largest > 0.0 else 0.0
        elif columns[c] >= 0:
            value = abs(p[columns[c]])
            size = SHIFT * (value if value > 0.0 else LEAST)
        elif states[c] >= 0 and not settles[states[c]]:
            size = SHIFT * abs(start[states[c]])
        if size == 0.0:
            continue
        sides = np.zeros((2, n_s))
        for side in range(2):
            shift = size if side == 0 else -size
            if c >= first:
                for d in range(directions.shape[1]):
                    inputs[d] = u[d] + shift * directions[c - first, d]
            elif columns[c] >= 0:
                values[columns[c]] = p[columns[c]] + shift
            else:
                s[states[c]] = start[states[c]] + shift
            sides[side] = settled(newton, outputs, s, inputs, values, m, count, steadied)
        for i in range(n_s):
            if settles[i]:
                result[i, c] = (sides[0, i] - sides[1, i]) / (2 * size)
        s[:], inputs[:], values[:] = start, u, p
    return result
