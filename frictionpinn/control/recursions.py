"""The compensator's cycle, compiled: friction along the reference, a filter that carries the bristle, their torque.

The filter's state is X = (s, d, theta): the mechanism's own s = (q, v, states of effects, z), the disturbance d that no
law explains, a random walk that counts as friction does, and the logarithm of every parameter that adapts, relative to
its first value. The equations R(s, w, u; p) + (d, 0, ...) = 0 of the mechanism are stepped by the implicit Euler
method: with s+ = s + h ds(w) the unknown w = (a, rates, z') is found by Newton's method with the analytic Jacobian, and
by the implicit function theorem the same matrix gives the derivative of s+ in s, d and theta that the covariance needs.
So a cycle costs the same whatever the stiffness of the bristle, and nothing is allocated that outlives it.

Source: extended Kalman filter, Anderson and Moore, Optimal Filtering (1979), 8.2; disturbance as a state: Johnson, IEEE
Trans. Automatic Control 16 (1971); friction that adapts: Olsson, Astrom, Canudas de Wit, Gafvert and Lischinsky,
European Journal of Control 4 (1998).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit

from ..numerics.integrator import OPTIONS, back_substitute, factorize, newton_matrix

ITERATIONS = 12  # of Newton's method, at most
SETTLED = 1e-10  # relative change of w that ends it
WILD = 6.0  # standard deviations: the most by which a reading moves the state
Z95 = 1.959964
REFERENCE, ESTIMATE = 0, 1  # the motion along which friction is computed
TIME, TORQUE, FEEDBACK = 0, 1, 2  # places in ``held``


class Plan(NamedTuple):
    """What does not change from cycle to cycle.

    Attributes:
        newton, outputs, strengths: the mechanism's compiled kernels, see :class:`..numerics.codegen.Kernels`;
            ``strengths`` of the parameters that adapt.
        p: parameters, SI units, shape (n_p,).
        places: index in p of every parameter that adapts, shape (k,).
        clocks: index in u of the clocks, and 1 for a time, 0 for the number of the trial, shape (n_clocks, 2).
        sizes: n_s, n_w, n_u, index in u of the torque.
        h: cycle, s.
        lag: from a command to its effect, in cycles, the hold not counted.
        noise: variance of a reading of the position.
        kick: spectral density of the acceleration that the model leaves out, (slip/s^2)^2 s.
        walk: spectral density of the disturbance's rate, force^2/s; 0: there is no disturbance.
        walks: the same of the logarithms theta, 1/s, shape (k,).
        spread: standard deviations of d and theta at the start, shape (1 + k,).
        still: speed of the reference at which half of the feedback is let through.
        limit: largest torque.
        along: REFERENCE or ESTIMATE.
        filters: whether readings are used.
        gain: factor of the friction that is added, 1 but in a test of the margin.
    """

    newton: Any
    outputs: Any
    strengths: Any
    p: np.ndarray
    places: np.ndarray
    clocks: np.ndarray
    sizes: tuple[int, int, int, int]
    h: float
    lag: float
    noise: float
    kick: float
    walk: float
    walks: np.ndarray
    spread: np.ndarray
    still: float
    limit: float
    along: int
    filters: bool
    gain: float


class Memory(NamedTuple):
    """What a cycle leaves for the next: all of it written in place.

    Attributes:
        X, P: state of the filter and its covariance.
        w: unknowns of its last step, where the next begins.
        s, v: state and unknowns along the reference.
        p: parameters in force, which follow the filter's while the reference moves.
        past: torques of the last cycles, newest first.
        held: time, torque, feedback.
        begun: number of cycles so far, shape (1,).
    """

    X: np.ndarray
    P: np.ndarray
    w: np.ndarray
    s: np.ndarray
    v: np.ndarray
    p: np.ndarray
    past: np.ndarray
    held: np.ndarray
    begun: np.ndarray


@njit(**OPTIONS)
def inputs(plan, torque, t):
    """u with the torque and the clocks in their places."""
    u = np.zeros(plan.sizes[2])
    u[plan.sizes[3]] = torque
    for i in range(plan.clocks.shape[0]):
        u[plan.clocks[i, 0]] = t if plan.clocks[i, 1] else 1.0
    return u


@njit(**OPTIONS)
def advance(plan, s, w, u, p, push, moves, out, matrix, pivots):
    """One implicit Euler step of s, in place, from the guess w, which becomes the solution.

    Args:
        push: disturbance, counted as friction.
        moves: 1 where the velocity is sought; 0 where q and v are given already and only what remembers is advanced,
            w[0] being the acceleration that is given.
        out, matrix, pivots: where the kernel's output, the factors of Newton's matrix and its pivots are left.
    """
    n_s, n_w, h = plan.sizes[0], plan.sizes[1], plan.h
    ahead, change = s.copy(), np.zeros(n_w)
    for _ in range(ITERATIONS):
        if moves:
            ahead[1] = s[1] + h * w[0]
            ahead[0] = s[0] + h * ahead[1]
        for i in range(2, n_s):
            ahead[i] = s[i] + h * w[i - 1]
        plan.newton(ahead, w, u, p, out)
        newton_matrix(out, 1, n_w, h, matrix)
        for i in range(n_w):
            change[i] = -out[i]
        change[0] -= push
        if not moves:  # the row of the motion says that the acceleration stays what it is
            change[0] = 0.0
            matrix[0, 0] = 1.0
            for i in range(1, n_w):
                matrix[0, i] = 0.0
                matrix[i, 0] = 0.0
        if not factorize(matrix, pivots):
            break
        back_substitute(matrix, pivots, change)
        largest, size = 0.0, 0.0
        for i in range(n_w):
            w[i] += change[i]
            largest, size = max(largest, abs(change[i])), max(size, abs(w[i]))
        if largest <= SETTLED * size:
            break
    if moves:
        s[1] += h * w[0]
        s[0] += h * s[1]
    for i in range(2, n_s):
        s[i] += h * w[i - 1]


@njit(**OPTIONS)
def slopes(plan, p, theirs, out, matrix, pivots):
    """Derivative of s+ in (s, d, theta), shape (n_s, n), at the solution that :func:`advance` left.

    ``theirs``: what the kernel ``strengths`` wrote there.
    """
    n_s, n_w, h, k = plan.sizes[0], plan.sizes[1], plan.h, plan.places.shape[0]
    n = n_s + 1 + k
    F, row = np.zeros((n_s, n)), np.zeros(n_w)
    for j in range(n):
        for i in range(n_w):
            if j < n_s:
                row[i] = -out[n_w + i * n_s + j]
                if j == 1:
                    row[i] -= h * out[n_w + i * n_s]
            elif j == n_s:
                row[i] = -1.0 if i == 0 else 0.0
            else:
                row[i] = -theirs[i * k + j - n_s - 1] * p[plan.places[j - n_s - 1]]
        back_substitute(matrix, pivots, row)
        F[1, j] = h * row[0] + (1.0 if j == 1 else 0.0)
        F[0, j] = h * F[1, j] + (1.0 if j == 0 else 0.0)
        for i in range(2, n_s):
            F[i, j] = h * row[i - 1] + (1.0 if j == i else 0.0)
    return F


@njit(**OPTIONS)
def adapted(plan, X, p):
    """Write the parameters that the filter holds into p."""
    first = plan.sizes[0] + 1
    for i in range(plan.places.shape[0]):
        p[plan.places[i]] = plan.p[plan.places[i]] * np.exp(X[first + i])


@njit(**OPTIONS)
def predict(plan, memory, torque, t, moving):
    """Advance mean and covariance by a cycle under a torque that was constant in it."""
    n_s, n_w, _, _ = plan.sizes
    k = plan.places.shape[0]
    X, P, n = memory.X, memory.P, n_s + 1 + k
    out, matrix, pivots = np.zeros(n_w + n_w * (n_s + n_w) + 1), np.empty((n_w, n_w)), np.empty(n_w, np.int64)
    p, theirs = plan.p.copy(), np.zeros((n_w + 3) * k)
    adapted(plan, X, p)
    u, s = inputs(plan, torque, t), X[:n_s].copy()
    advance(plan, s, memory.w, u, p, X[n_s], 1, out, matrix, pivots)
    if k:
        plan.strengths(s, memory.w, u, p, theirs)
    F = slopes(plan, p, theirs, out, matrix, pivots)
    P[1, 1] += plan.kick * plan.h  # before the step, so that the contact answers to it
    part = np.zeros((n_s, n))
    for i in range(n_s):
        for j in range(n):
            total = 0.0
            for c in range(n):
                total += F[i, c] * P[c, j]
            part[i, j] = total
    for i in range(n_s):
        for j in range(i + 1):
            total = 0.0
            for c in range(n):
                total += part[i, c] * F[j, c]
            P[i, j] = total
            P[j, i] = total
        for j in range(n_s, n):
            P[i, j] = part[i, j]
            P[j, i] = part[i, j]
    P[n_s, n_s] += plan.walk * plan.h * moving
    for i in range(k):  # at rest a surface shows no change, and none is assumed
        P[n_s + 1 + i, n_s + 1 + i] += plan.walks[i] * plan.h * moving
    X[:n_s] = s


@njit(**OPTIONS)
def correct(plan, memory, reading):
    """Take in a reading of the position."""
    X, P, n = memory.X, memory.P, memory.X.shape[0]
    variance = P[0, 0] + plan.noise
    if not (np.isfinite(reading) and variance > 0.0):
        return
    error = reading - X[0]
    most = WILD * np.sqrt(variance)
    error = min(max(error, -most), most)
    column = P[:, 0].copy()
    for i in range(n):
        X[i] += column[i] / variance * error
        for j in range(n):
            P[i, j] -= column[i] * column[j] / variance


@njit(**OPTIONS)
def begin(plan, memory, reference, reading):
    """Start at rest where the position is, nothing known of d and theta but their spread."""
    n_s = plan.sizes[0]
    memory.X[:], memory.P[:, :], memory.w[:], memory.v[:], memory.s[:] = 0.0, 0.0, 0.0, 0.0, 0.0
    memory.past[:], memory.held[:] = 0.0, 0.0
    memory.p[:] = plan.p
    memory.X[0] = reading if np.isfinite(reading) else reference[0]
    memory.P[0, 0] = plan.noise
    for i in range(plan.spread.shape[0]):
        memory.P[n_s + i, n_s + i] = plan.spread[i] ** 2


@njit(**OPTIONS)
def cycle(plan, memory, reference, reading, torque, result):
    """One cycle: torque that compensates friction, and its 95 % interval.

    Args:
        reference: position, velocity and acceleration at the time when the torque will act, shape (3,).
        reading: of the position now; NaN where there is none.
        torque: what was commanded in the cycle before, compensation and limits included.
        result: receives torque, low and high, shape (3,).
    """
    n_s, n_w, _, _ = plan.sizes
    k, held = plan.places.shape[0], memory.held
    speed = reference[1] * reference[1]
    share = speed / (speed + plan.still * plan.still)  # 0 at rest: all that feeds back is then held as it is
    if memory.begun[0] == 0:
        begin(plan, memory, reference, reading)
    else:
        held[TIME] += plan.h
        for i in range(memory.past.shape[0] - 1, 0, -1):
            memory.past[i] = memory.past[i - 1]
        memory.past[0] = torque
    out, matrix, pivots = np.zeros(n_w + n_w * (n_s + n_w) + 1), np.empty((n_w, n_w)), np.empty(n_w, np.int64)
    if plan.filters and memory.begun[0] > 0:
        whole = int(plan.lag)
        part = plan.lag - whole
        acted = (1.0 - part) * memory.past[whole] + part * memory.past[whole + 1]
        predict(plan, memory, acted, held[TIME], share)
        correct(plan, memory, reading)
    memory.begun[0] += 1
    for i in range(k):
        place = plan.places[i]
        memory.p[place] += share * (plan.p[place] * np.exp(memory.X[n_s + 1 + i]) - memory.p[place])
    u, seen = inputs(plan, 0.0, held[TIME]), np.zeros(3)
    memory.s[0], memory.s[1], memory.v[0] = reference[0], reference[1], reference[2]
    advance(plan, memory.s, memory.v, u, memory.p, 0.0, 0, out, matrix, pivots)
    plan.outputs(memory.s, memory.v, u, memory.p, seen)
    forward = seen[2]
    if plan.along == ESTIMATE:
        s = memory.X[:n_s].copy()
        seen[:] = 0.0
        plan.outputs(s, memory.w, u, memory.p, seen)
        held[FEEDBACK] += share * (seen[2] + memory.X[n_s] - held[FEEDBACK])
        forward = 0.0
    else:
        held[FEEDBACK] += share * (memory.X[n_s] - held[FEEDBACK])
    found = plan.gain * (forward + held[FEEDBACK])
    result[0] = min(max(found, -plan.limit), plan.limit)
    theirs, slope = np.zeros((n_w + 3) * k), np.zeros(1 + k)
    if k:
        plan.strengths(memory.s, memory.v, u, memory.p, theirs)
    slope[0] = 1.0
    for i in range(k):
        slope[1 + i] = theirs[(n_w + 2) * k + i] * memory.p[plan.places[i]]
    variance = 0.0
    for i in range(1 + k):
        for j in range(1 + k):
            variance += slope[i] * memory.P[n_s + i, n_s + j] * slope[j]
    reach = Z95 * np.sqrt(max(variance, 0.0))
    result[1], result[2] = result[0] - reach, result[0] + reach
