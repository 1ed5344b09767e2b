"""Compiled search for the initial states that are not given, and their derivatives: see :mod:`.bristle`.

numba's cache does not notice a change in a function imported from another file: after editing integrator.py, touch
this file too.
"""

from __future__ import annotations

import numpy as np
from numba import njit, types

from .integrator import F1, F2, KERNEL, OPTIONS

I1, B1 = types.int64[::1], types.boolean[::1]

CREEP = 1e-12
SETTLED = 1e-12  # relative change of z that ends the search for its root
MOST = 30  # steps of that search
SWEEPS = 200  # over contacts at rest, each balanced with the others held
SHIFT, LEAST = 1e-6, 1e-2  # of a value, by which it is shifted for a difference; the size of a parameter that is 0


@njit(types.float64(KERNEL, F1, F1, F1, F1, types.int64, types.int64, types.int64, F1), **OPTIONS)
def root(newton, state, w, u, p, first, last, place, out):
    """The z, at that place of the state, at which the rows from first to last vanish in the least-squares sense, by
    Newton's method; 0 where z does not enter them. It is written into the state.

    One step is enough for the laws, which are linear in z; a gap takes a few.
    """
    n_s, n_w = state.shape[0], w.shape[0]
    for _ in range(MOST):
        newton(state, w, u, p, out)
        along, own = 0.0, 0.0
        for i in range(first, last):
            slope = out[n_w + i * n_s + place]
            along += out[i] * slope
            own += slope * slope
        if own == 0.0:
            return 0.0
        change = -along / own
        if abs(change) <= SETTLED * abs(state[place]):
            break
        state[place] += change
    return state[place]


@njit(F1(KERNEL, KERNEL, F1, F1, F1, types.int64, I1, B1, types.int64), **OPTIONS)
def steady(newton, outputs, start, u, p, m, contacts, which, n_out):
    """The start with bristle states that suit the initial motion, see :func:`.bristle.steady_bristles`.

    Of contacts at rest each in turn takes what balances the others, until they settle; then the one furthest beyond
    its limit is held there, and the others are balanced anew.

    Args:
        contacts: contact of each bristle; which: whether its state is sought.
        n_out: number of the kernel's outputs.
    """
    n_s, n_w, n_b = start.shape[0], start.shape[0] - m, contacts.shape[0]
    state, w, shown = start.copy(), np.zeros(n_w), np.zeros(n_out)
    out = np.zeros(n_w + n_w * (n_s + n_w) + 1)
    first, resting = n_s - n_b, np.zeros(n_b, np.bool_)
    for b in range(n_b):
        if which[b]:
            state[first + b] = 0.0
    outputs(state, w, u, p, shown)
    for b in range(n_b):
        resting[b] = which[b] and shown[3 * contacts[b]] == 0.0
        if which[b] and not resting[b]:
            root(newton, state, w, u, p, n_w - n_b + b, n_w - n_b + b + 1, first + b, out)
    while resting.any():
        for b in range(n_b):
            if resting[b]:
                state[first + b] = 0.0
        plain = state.copy()
        for _ in range(SWEEPS if resting.sum() > 1 else 1):
            settled_ = True
            for b in range(n_b):
                before = state[first + b]
                if resting[b]:
                    root(newton, state, w, u, p, 0, m, first + b, out)
                settled_ &= abs(state[first + b] - before) <= SETTLED * abs(before)
            if settled_:
                break
        worst, excess, limit = -1, 1.0, 0.0
        for b in range(n_b):
            if not resting[b] or state[first + b] == 0.0:
                continue
            creeping, balance = plain.copy(), state[first + b]
            for j in range(m):
                moved = plain.copy()
                moved[m + j] += 1.0
                shown[:] = 0.0
                outputs(moved, w, u, p, shown)
                creeping[m + j] += np.sign(balance) * CREEP * shown[3 * contacts[b]]
            held = root(newton, creeping, w, u, p, n_w - n_b + b, n_w - n_b + b + 1, first + b, out)
            if not abs(balance) <= abs(held) * excess:
                worst, excess, limit = b, abs(balance) / max(abs(held), 1e-300), held
        if worst < 0:
            break
        state[first + worst] = limit
        resting[worst] = False
    return state


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


@njit(F1(KERNEL, KERNEL, F1, F1, F1, types.int64, types.int64, I1, B1, types.int64), **OPTIONS)
def settled(newton, outputs, start, u, p, m, count, contacts, steadied, n_out):
    """The start with the states of effects at rest and the bristles that are ``steadied`` steady."""
    state = rest(newton, start, u, p, m, count)
    if steadied.any():
        return steady(newton, outputs, state, u, p, m, contacts, steadied, n_out)
    return state


@njit(
    F2(KERNEL, KERNEL, F1, F1, F1, types.int64, types.int64, I1, B1, types.int64, I1, I1, F2),
    **OPTIONS,
)
def changes(newton, outputs, start, u, p, m, count, contacts, steadied, n_out, columns, states, directions):
    """Derivative of what settles of the start in every quantity, shape (n_s, n_c), by central differences.

    Args:
        count, contacts, steadied, n_out: see :func:`settled`.
        columns, states: index of the parameter and of the initial state that each quantity is, or -1.
        directions: du/dc at the start for the last of them, shape (n_directions, recorded inputs).
    """
    n_c, n_s = columns.shape[0], start.shape[0]
    first, result = n_c - directions.shape[0], np.zeros((n_s, n_c))
    settles = np.zeros(n_s, dtype=np.bool_)
    settles[2 * m : 2 * m + count] = True
    for b in range(contacts.shape[0]):
        settles[n_s - contacts.shape[0] + b] |= steadied[b]
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
            sides[side] = settled(newton, outputs, s, inputs, values, m, count, contacts, steadied, n_out)
        for i in range(n_s):
            if settles[i]:
                result[i, c] = (sides[0, i] - sides[1, i]) / (2 * size)
        s[:], inputs[:], values[:] = start, u, p
    return result
