"""The compensator's cycle, compiled: friction along the reference, and what a filter finds beside it.

Along the reference (q_r, v_r, a_r) the mechanism's equations give the torque that the motion takes, T(p) = R_0 at
u = 0, friction and all; the bristle is carried along it by the implicit Euler method, whatever its stiffness. What the
machine shows beside that is the business of :mod:`.filter`. A cycle has a fixed cost and allocates nothing that
outlives it.

Source: bristle along the reference: Olsson and others, European Journal of Control 4 (1998).
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ..numerics.integrator import OPTIONS, back_substitute, factorize, newton_matrix
from ..numerics.whiteness import NORMAL_95
from .filter import (
    ACCELERATION,
    DISTURBANCE,
    EXCESS,
    FEEDBACK,
    FRICTION,
    POSITION,
    SCALE,
    SLOPES,
    THETA,
    TIME,
    TORQUE,
    VELOCITY,
    Memory,
    Plan,
    begin,
    correct,
    predict,
    slopes,
    wait,
)

ITERATIONS = 12  # of Newton's method for what remembers, at most: the laws are linear in it and take two
SETTLED = 1e-10  # relative change that ends it


@njit(**OPTIONS)
def let_through(v, still):
    """Share of the feedback at a velocity of the reference: 0 at rest, where all that feeds back is held as it is."""
    return v * v / (v * v + still * still)


@njit(**OPTIONS)
def inputs(plan, torque, t):
    """u with the torque and the clocks in their places."""
    u = np.zeros(plan.sizes[2])
    u[plan.sizes[3]] = torque
    for i in range(plan.clocks.shape[0]):
        u[plan.clocks[i, 0]] = t if plan.clocks[i, 1] else 1.0
    return u


@njit(**OPTIONS)
def inertia(newton, p, sizes):
    """m = dT/da at rest at 0."""
    n_s, n_w = sizes[0], sizes[1]
    out = np.zeros(n_w + n_w * (n_s + n_w) + 1)
    newton(np.zeros(n_s), np.zeros(n_w), np.zeros(sizes[2]), p, out)
    return out[n_w + n_w * n_s]


@njit(**OPTIONS)
def remember(plan, s, w, u, p, out, matrix, pivots):
    """One implicit Euler step of what remembers (effects' states, bristle) at the q, v and a given in s and w.

    s and w are written in place; ``out`` is left as the kernel ``newton`` writes it at the solution, to its tolerance,
    ``matrix`` and ``pivots`` as the factors of Newton's matrix there.
    """
    n_s, n_w, h = plan.sizes[0], plan.sizes[1], plan.h
    ahead, change = s.copy(), np.zeros(n_w)
    for _ in range(ITERATIONS):
        for i in range(2, n_s):
            ahead[i] = s[i] + h * w[i - 1]
        plan.newton(ahead, w, u, p, out)
        newton_matrix(out, 1, n_w, h, matrix)
        for i in range(n_w):
            change[i] = -out[i]
        change[0], matrix[0, 0] = 0.0, 1.0  # the row of the motion says that the acceleration stays what it is
        for i in range(1, n_w):
            matrix[0, i] = 0.0
            matrix[i, 0] = 0.0
        if not factorize(matrix, pivots):
            break
        back_substitute(matrix, pivots, change)
        largest, size = 0.0, 0.0
        for i in range(1, n_w):
            w[i] += change[i]
            largest, size = max(largest, abs(change[i])), max(size, abs(w[i]))
        if largest <= SETTLED * size:
            break
    for i in range(2, n_s):
        s[i] += h * w[i - 1]


@njit(**OPTIONS)
def sensitivities(plan, memory, u, out, matrix, pivots, result):
    """Derivative of T in theta, shape (k,), after :func:`remember`; that of what remembers is carried along.

    By the implicit function theorem on the same step: (dR/dw + h dR/ds) dw = -dR/ds Z - dR/dtheta, Z += h dw.
    """
    n_s, n_w, h, k = plan.sizes[0], plan.sizes[1], plan.h, plan.places.shape[0]
    theirs, row = np.zeros((n_w + 3) * k), np.zeros(n_w)
    plan.strengths(memory.s, memory.w, u, memory.p, theirs)
    for j in range(k):
        p = memory.p[plan.places[j]]
        row[0] = 0.0
        for i in range(1, n_w):
            row[i] = -theirs[i * k + j] * p
            for c in range(2, n_s):
                row[i] -= out[n_w + i * n_s + c] * memory.Z[c, j]
        back_substitute(matrix, pivots, row)
        result[j] = theirs[j] * p
        for c in range(2, n_s):
            memory.Z[c, j] += h * row[c - 1]
            result[j] += out[n_w + c] * memory.Z[c, j] + out[n_w + n_w * n_s + c - 1] * row[c - 1]


@njit(**OPTIONS)
def cycle(plan: Plan, memory: Memory, reference, reading, torque, result):
    """One cycle: torque that compensates friction, and its 95 % interval.

    Args:
        reference: position, velocity and acceleration at the middle of the torque's effect, shape (3,).
        reading: of the position now; NaN where there is none.
        torque: what was commanded in the cycle before, compensation and limits included.
        result: receives torque, low and high, shape (3,).
    """
    n_s, n_w, _, _ = plan.sizes
    X, past, held, k = memory.X, memory.past, memory.held, plan.places.shape[0]
    share = let_through(reference[1], plan.still)
    out, seen = np.zeros(n_w + n_w * (n_s + n_w) + 1), np.zeros(3)
    matrix, pivots = np.empty((n_w, n_w)), np.empty(n_w, np.int64)
    if memory.begun[0] == 0:
        begin(plan, memory, reference, reading)
    else:
        past[0, EXCESS] = torque - held[TORQUE]
        held[TIME] += plan.h
        if plan.filters and memory.begun[0] >= plan.lag + 1.0:
            predict(plan, memory, share)
        for i in range(past.shape[0] - 1, 0, -1):
            past[i] = past[i - 1]
    memory.begun[0] += 1
    past[0, POSITION], past[0, VELOCITY], past[0, ACCELERATION] = reference[0], reference[1], reference[2]
    if plan.filters and memory.begun[0] < plan.lag + 2.0:
        wait(plan, memory, reading)
    elif plan.filters:
        correct(plan, memory, reading, share)
    for i in range(k):
        place = plan.places[i]
        memory.p[place] += share * (plan.p[place] * np.exp(X[THETA + i]) - memory.p[place])
    held[FEEDBACK] += share * (X[DISTURBANCE] - held[FEEDBACK])
    u, s, w, p = inputs(plan, 0.0, held[TIME]), memory.s, memory.w, memory.p
    s[0], s[1], w[0] = reference[0], reference[1], reference[2]
    remember(plan, s, w, u, p, out, matrix, pivots)
    plan.newton(s, w, u, p, out)
    held[TORQUE] = out[0]
    if k:
        sensitivities(plan, memory, u, out, matrix, pivots, past[0, SLOPES:])
    plan.newton(s, w, u, plan.known, out)
    plan.outputs(s, w, u, plan.known, seen)
    added = held[TORQUE] - (out[0] - seen[2])  # friction, and what the controller's own model lacks
    plan.outputs(s, w, u, p, seen)
    past[0, FRICTION] = seen[2]
    for i in range(k):
        held[TORQUE] -= past[0, SLOPES + i] * np.log(p[plan.places[i]] / plan.p[plan.places[i]])
    now, variance = np.zeros(X.shape[0]), 0.0
    slopes(plan, past[0], 1.0, now)
    for i in range(THETA + k, X.shape[0]):
        added += now[i] * X[i]
    for i in range(DISTURBANCE, X.shape[0]):
        if now[i] != 0.0:
            for j in range(DISTURBANCE, X.shape[0]):
                variance += now[i] * now[j] * memory.P[i, j]
    found = plan.gain * (added + held[FEEDBACK])
    result[0] = min(max(found, -plan.limit), plan.limit)
    reach = NORMAL_95 * np.sqrt(max(variance * held[SCALE], 0.0))
    result[1], result[2] = result[0] - reach, result[0] + reach
