"""The compensator's cycle, compiled: friction along the reference, and a filter of what the machine shows beside it.

Along the reference (q_r, v_r, a_r) the mechanism's equations give the torque that the motion takes, T(p) = R_0 at
u = 0, friction and all; the bristle is carried along it by the implicit Euler method, whatever its stiffness.
The machine deviates from the reference by (e, v_e), and

    m v_e' = (u - T(p)) - d,    e' = v_e,    d' = noise,    theta' = noise,    p = p_0 exp(theta),

where u is the torque that acts, m = dT/da_r, d the disturbance that no law explains and theta the logarithms of the
parameters that adapt. That is linear but for p, so a Kalman filter that reads the encoder needs no Jacobian of the
contact, whose sign of the velocity a noisy encoder cannot tell at a reversal; what friction does at a reversal the
reference tells without noise. The noise that readings count with sets the bandwidth of d, so that the covariance holds
but for its scale: that is the mean square of the normalised innovations of the last half second. A cycle has a fixed
cost and allocates nothing that outlives it.

Source: Kalman filter, Anderson and Moore, Optimal Filtering (1979), 3.1; disturbance as a state: Johnson, IEEE Trans.
Automatic Control 16 (1971); parameters that adapt along the reference: Slotine and Li, Applied Nonlinear Control
(1991), 8.7; bristle along the reference: Olsson and others, European Journal of Control 4 (1998).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit

from ..numerics.integrator import OPTIONS, back_substitute, factorize, newton_matrix

ITERATIONS = 12  # of Newton's method for what remembers, at most: the laws are linear in it and take two
SETTLED = 1e-10  # relative change that ends it
WILD = 6.0  # standard deviations: the most by which a reading moves the state
FURTHEST = 1.3862943611198906  # log 4: the furthest that a parameter may go from its first value
Z95 = 1.959964
DEVIATION, SPEED, DISTURBANCE, THETA = 0, 1, 2, 3  # places in X, theta from the last on
EXCESS, INERTIA, POSITION, VELOCITY, ACCELERATION, SLOPES = range(6)  # columns of ``past``; dT/dtheta at the end
MEMORY_OF_SCALE = 0.5  # s: over which the squares of the innovations are averaged
TIME, FEEDBACK, TORQUE, SCALE = 0, 1, 2, 3  # places in ``held``


class Plan(NamedTuple):
    """What does not change from cycle to cycle.

    Attributes:
        newton, outputs, strengths: the mechanism's compiled kernels, see :class:`..numerics.codegen.Kernels`;
            ``strengths`` of the parameters that adapt.
        p: parameters, SI units, shape (n_p,).
        known: those with which the controller computes the torque of the motion without friction, shape (n_p,).
        places: index in p of every parameter that adapts, shape (k,).
        clocks: index in u of the clocks, and 1 for a time, 0 for the number of the trial, shape (n_clocks, 2).
        sizes: n_s, n_w, n_u, index in u of the torque.
        h: cycle, s.
        lag: from a command to its effect, in cycles, the hold not counted.
        noise: variance of a reading of the position, what the equation of motion leaves out of it included.
        walk: spectral density of the disturbance's rate, force^2/s.
        walks: the same of the logarithms theta, 1/s, shape (k,).
        spread: standard deviations of d and theta at the start, shape (1 + k,).
        still: speed of the reference at which half of the feedback is let through.
        limit: largest torque.
        filters: whether readings are used.
        gain: factor of the torque, 1 but in a test of the margin.
    """

    newton: Any
    outputs: Any
    strengths: Any
    p: np.ndarray
    known: np.ndarray
    places: np.ndarray
    clocks: np.ndarray
    sizes: tuple[int, int, int, int]
    h: float
    lag: float
    noise: float
    walk: float
    walks: np.ndarray
    spread: np.ndarray
    still: float
    limit: float
    filters: bool
    gain: float


class Memory(NamedTuple):
    """What a cycle leaves for the next: all of it written in place.

    Attributes:
        X, P: state of the filter and its covariance, shape (3 + k,) and (3 + k, 3 + k).
        s, w: state and unknowns of the mechanism along the reference.
        Z: derivative of s in theta, shape (n_s, k).
        p: parameters in force, which follow the filter's while the reference moves.
        past: the last cycles, newest first: u - T, m, reference, dT/dtheta less its part in theta then.
        held: time, feedback in force, torque T of the cycle, scale of the covariance.
        begun: number of cycles so far, shape (1,).
    """

    X: np.ndarray
    P: np.ndarray
    s: np.ndarray
    w: np.ndarray
    Z: np.ndarray
    p: np.ndarray
    past: np.ndarray
    held: np.ndarray
    begun: np.ndarray


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
def predict(plan, memory, share):
    """Advance mean and covariance of the filter by a cycle under the torques that acted in it."""
    X, P, past, h, k = memory.X, memory.P, memory.past, plan.h, plan.places.shape[0]
    n, whole = THETA + k, int(plan.lag)
    part = plan.lag - whole
    excess = (1.0 - part) * past[whole, EXCESS] + part * past[whole + 1, EXCESS]
    inverse = 1.0 / ((1.0 - part) * past[whole, INERTIA] + part * past[whole + 1, INERTIA])
    A = np.zeros(n)  # derivative of v_e' in X
    A[DISTURBANCE] = -inverse
    a = inverse * (excess - X[DISTURBANCE])
    for i in range(k):
        slope = (1.0 - part) * past[whole, SLOPES + i] + part * past[whole + 1, SLOPES + i]
        A[THETA + i] = -inverse * slope
        a -= inverse * slope * X[THETA + i]
    X[DEVIATION] += h * X[SPEED] + 0.5 * h * h * a
    X[SPEED] += h * a
    F = np.zeros((2, n))
    for j in range(n):
        F[0, j], F[1, j] = 0.5 * h * h * A[j], h * A[j]
    F[0, 0] += 1.0
    F[0, 1] += h
    F[1, 1] += 1.0
    moved = np.zeros((2, n))
    for i in range(2):
        for j in range(n):
            total = 0.0
            for c in range(n):
                total += F[i, c] * P[c, j]
            moved[i, j] = total
    for i in range(2):
        for j in range(2):
            total = 0.0
            for c in range(n):
                total += moved[i, c] * F[j, c]
            P[i, j] = total
        for j in range(2, n):
            P[i, j] = moved[i, j]
            P[j, i] = moved[i, j]
    P[1, 0] = P[0, 1]
    P[DISTURBANCE, DISTURBANCE] += plan.walk * h * share
    for i in range(k):  # at rest a surface shows no change, and none is assumed
        P[THETA + i, THETA + i] += plan.walks[i] * h * share


@njit(**OPTIONS)
def correct(plan, memory, reading, share):
    """Take in a reading of the position; at rest, where static friction hides what acts, d and theta stay."""
    X, P, past, n = memory.X, memory.P, memory.past, memory.X.shape[0]
    nearest = min(int(plan.lag + 1.0), past.shape[0] - 1)  # the reference of now is that of a cycle some time ago
    since = (nearest - plan.lag - 0.5) * plan.h
    here = past[nearest, POSITION] + since * (past[nearest, VELOCITY] + 0.5 * since * past[nearest, ACCELERATION])
    variance = P[0, 0] + plan.noise
    if not (np.isfinite(reading) and variance > 0.0):
        return
    error, most = reading - here - X[0], WILD * np.sqrt(variance)
    error = min(max(error, -most), most)
    gain = P[:, 0] / variance
    memory.held[SCALE] += share * plan.h / MEMORY_OF_SCALE * (error * error / variance - memory.held[SCALE])
    for i in range(DISTURBANCE, n):
        gain[i] *= share
    row = P[0].copy()
    for i in range(n):
        X[i] += gain[i] * error
    X[DISTURBANCE] = min(max(X[DISTURBANCE], -plan.limit), plan.limit)
    for i in range(THETA, n):
        X[i] = min(max(X[i], -FURTHEST), FURTHEST)
    for i in range(n):  # Joseph's form, which holds for any gain
        for j in range(i + 1):
            P[i, j] += gain[i] * gain[j] * variance - gain[i] * row[j] - row[i] * gain[j]
            P[j, i] = P[i, j]


@njit(**OPTIONS)
def begin(plan, memory, reference, reading):
    """Start at rest where the position is, nothing known of d and theta but their spread."""
    memory.X[:], memory.P[:, :], memory.s[:], memory.w[:], memory.held[:] = 0.0, 0.0, 0.0, 0.0, 0.0
    memory.past[:, :], memory.Z[:, :] = 0.0, 0.0
    memory.past[:, INERTIA], memory.past[:, POSITION] = 1.0, reference[0]
    memory.p[:], memory.held[SCALE] = plan.p, 1.0
    if np.isfinite(reading):
        memory.X[DEVIATION] = reading - reference[0]
    memory.P[0, 0] = plan.noise
    for i in range(plan.spread.shape[0]):
        memory.P[DISTURBANCE + i, DISTURBANCE + i] = plan.spread[i] ** 2


@njit(**OPTIONS)
def cycle(plan, memory, reference, reading, torque, result):
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
        if plan.filters:
            predict(plan, memory, share)
        for i in range(past.shape[0] - 1, 0, -1):
            past[i] = past[i - 1]
    memory.begun[0] += 1
    past[0, POSITION], past[0, VELOCITY], past[0, ACCELERATION] = reference[0], reference[1], reference[2]
    if plan.filters and memory.begun[0] > 1:
        correct(plan, memory, reading, share)
    for i in range(k):
        place = plan.places[i]
        memory.p[place] += share * (plan.p[place] * np.exp(X[THETA + i]) - memory.p[place])
    held[FEEDBACK] += share * (X[DISTURBANCE] - held[FEEDBACK])
    u, s, w, p = inputs(plan, 0.0, held[TIME]), memory.s, memory.w, memory.p
    s[0], s[1], w[0] = reference[0], reference[1], reference[2]
    remember(plan, s, w, u, p, out, matrix, pivots)
    plan.newton(s, w, u, p, out)
    held[TORQUE], past[0, INERTIA] = out[0], out[n_w + n_w * n_s]
    if k:
        sensitivities(plan, memory, u, out, matrix, pivots, past[0, SLOPES:])
    plan.newton(s, w, u, plan.known, out)
    plan.outputs(s, w, u, plan.known, seen)
    added = held[TORQUE] - (out[0] - seen[2])  # friction, and what the controller's own model lacks
    variance = memory.P[DISTURBANCE, DISTURBANCE]
    for i in range(k):
        held[TORQUE] -= past[0, SLOPES + i] * np.log(p[plan.places[i]] / plan.p[plan.places[i]])
        variance += 2.0 * past[0, SLOPES + i] * memory.P[DISTURBANCE, THETA + i]
        for j in range(k):
            variance += past[0, SLOPES + i] * past[0, SLOPES + j] * memory.P[THETA + i, THETA + j]
    found = plan.gain * (added + held[FEEDBACK])
    result[0] = min(max(found, -plan.limit), plan.limit)
    reach = Z95 * np.sqrt(max(variance * held[SCALE], 0.0))
    result[1], result[2] = result[0] - reach, result[0] + reach
