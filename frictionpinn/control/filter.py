"""What a machine shows beside the friction that is expected along its reference: a Kalman filter of the encoder.

The machine deviates from the reference by (e, v_e), and

    m v_e' = (u - T(p)) - d - c(q_r) - b(q_r) F_r - a |F_r|,
    e' = v_e,    d' = noise,    theta' = noise,    p = p_0 exp(theta),

where u is the torque that acts, T(p) what the motion takes with its friction F_r, m = dT/da_r at p_0, d the disturbance
that no law explains and theta the logarithms of the parameters that adapt. c and b are what depends on the place: a
force (a gear's cogging) and a share of the friction (a tight guide, a gear's mesh), linear between ``cells`` places
along the stroke, Gaussian processes beforehand; a is the share by which friction is higher one way. All that is linear
but for p, so the filter needs no Jacobian of the contact, whose sign of the velocity a noisy encoder cannot tell at a
reversal; what friction does at a reversal the reference tells without noise. A command acts late: until the first one
does, the axis rests while its reference may move, which is not friction. The covariance holds but for its scale: that
is the mean square of the normalised innovations of the last half second.

What is found is fed back, and the loop through the axis must bear it. m stays as first known and (e, v_e, d) follow
whatever the encoder shows, so they are a linear observer whose gain no learned inertia changes: with its low-pass Q,
|Q| <= 1, the loop on an axis of inertia m_0 is stable where |Q (1 - m / m_0)| < 1, for m below 2 m_0. theta, c and b
learn beside it in bounded steps, c and b only from places that pass slowly enough for it to tell one from the next: at
speed they would be a second, faster observer in the same loop.

Source: Kalman filter, Anderson and Moore, Optimal Filtering (1979), 3.1; disturbance as a state: Johnson, IEEE Trans.
Automatic Control 16 (1971); its loop: Ohnishi and others, IEEE/ASME Trans. Mechatronics 1 (1996); parameters that adapt
along the reference: Slotine and Li, Applied Nonlinear Control (1991), 8.7; Gaussian processes: Rasmussen and Williams,
Gaussian Processes for Machine Learning (2006), 2.7.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit

from ..numerics.integrator import OPTIONS

WILD = 6.0  # standard deviations: the most by which a reading moves what is learned, or one reading alone the state
FURTHEST = 1.3862943611198906  # log 4: the furthest that a parameter may go from its first value
ALIKE = 2.0  # places over which c and b are alike: standard deviation of the Gaussian that correlates them
RESOLVED = 0.2  # 1 / (w T) at which half is learned of places that pass within T: five time constants of the observer
ROUND_OFF = 1e-6  # share of their variance that is each place's own, so that the covariance is positive
DEVIATION, SPEED, DISTURBANCE, THETA = 0, 1, 2, 3  # places in X; theta from the last on, then c, b and a
EXCESS, POSITION, VELOCITY, ACCELERATION, FRICTION, SLOPES = range(6)  # columns of ``past``; dT/dtheta last
MEMORY_OF_SCALE = 0.5  # s: over which the squares of the innovations are averaged
TIME, FEEDBACK, TORQUE, SCALE, LAST = range(5)  # places in ``held``


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
        inertia: m, as first known.
        noise: variance of a reading of the position.
        walk: spectral density of the disturbance's rate, force^2/s.
        walks: the same of theta, 1/s, of c, b and a, shape (k + 2 cells + 1,); without cells (k,).
        spread: standard deviations of d, theta, c, b and a at the start, of d and walks.
        still: speed of the reference at which half of the feedback is let through.
        passing: speed of the reference at which half of what is learned by place is.
        limit: largest torque.
        filters: whether readings are used.
        gain: factor of the torque, 1 but in a test of the margin.
        cells, low, width: number of places along the stroke, the first of them, and their distance.
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
    inertia: float
    noise: float
    walk: float
    walks: np.ndarray
    spread: np.ndarray
    still: float
    passing: float
    limit: float
    filters: bool
    gain: float
    cells: int
    low: float
    width: float


class Memory(NamedTuple):
    """What a cycle leaves for the next: all of it written in place.

    Attributes:
        X, P: state of the filter and its covariance, shape (n,) and (n, n) with
            n = 3 + k + 2 cells + 1; without cells 3 + k.
        s, w: state and unknowns of the mechanism along the reference.
        Z: derivative of s in theta, shape (n_s, k).
        p: parameters in force, which follow the filter's while the reference moves.
        past: the last cycles, newest first: u - T, reference, friction F, dT/dtheta less its part in theta then.
        held: time, feedback in force, torque T of the cycle, scale of the covariance, last innovation.
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
def slopes(plan, past, weight, found):
    """Add ``weight`` times the derivatives in d, theta, c, b and a of the torque in a row of ``past`` to ``found``."""
    k, n = plan.places.shape[0], plan.cells
    found[DISTURBANCE] += weight
    for i in range(k):
        found[THETA + i] += weight * past[SLOPES + i]
    if n:
        x = min(max((past[POSITION] - plan.low) / plan.width, 0.0), n - 1.0)
        i = min(int(x), n - 2)
        for place, share in ((THETA + k + i, 1.0 - (x - i)), (THETA + k + i + 1, x - i)):
            found[place] += weight * share
            found[place + n] += weight * share * past[FRICTION]
        found[THETA + k + 2 * n] += weight * abs(past[FRICTION])


@njit(**OPTIONS)
def predict(plan, memory, share):
    """Advance mean and covariance of the filter by a cycle under the torques that acted in it."""
    X, P, past, h = memory.X, memory.P, memory.past, plan.h
    n, whole = X.shape[0], int(plan.lag)
    part = plan.lag - whole
    excess = (1.0 - part) * past[whole, EXCESS] + part * past[whole + 1, EXCESS]
    inverse = 1.0 / plan.inertia
    A = np.zeros(n)  # derivative of v_e' in X
    slopes(plan, past[whole], (part - 1.0) * inverse, A)
    slopes(plan, past[whole + 1], -part * inverse, A)
    a = inverse * excess
    for i in range(DISTURBANCE, n):
        a += A[i] * X[i]
    X[DEVIATION] += h * X[SPEED] + 0.5 * h * h * a
    X[SPEED] += h * a
    F = np.zeros((2, n))
    for j in range(n):
        F[0, j], F[1, j] = 0.5 * h * h * A[j], h * A[j]
    F[0, 0] += 1.0
    F[0, 1] += h
    F[1, 1] += 1.0
    moved = np.zeros((2, n))
    for c in range(n):
        if F[1, c] != 0.0 or F[0, c] != 0.0:
            for j in range(n):
                moved[0, j] += F[0, c] * P[c, j]
                moved[1, j] += F[1, c] * P[c, j]
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
    for i in range(n - THETA):  # at rest a surface shows no change, and none is assumed
        P[THETA + i, THETA + i] += plan.walks[i] * h * share


@njit(**OPTIONS)
def asked(plan, past):
    """Position and velocity of the reference now, which is that of a cycle some time ago."""
    nearest = min(int(plan.lag + 1.0), past.shape[0] - 1)
    since = (nearest - plan.lag - 0.5) * plan.h
    v, a = past[nearest, VELOCITY], past[nearest, ACCELERATION]
    return past[nearest, POSITION] + since * (v + 0.5 * since * a), v + since * a


@njit(**OPTIONS)
def wait(plan, memory, reading):
    """Before the first command acts the axis rests, while its reference may move; how it breaks away is not known."""
    q, v = asked(plan, memory.past)
    memory.X[SPEED], memory.P[SPEED, SPEED] = -v, v * v
    if np.isfinite(reading):
        memory.X[DEVIATION] = reading - q


@njit(**OPTIONS)
def correct(plan, memory, reading, share):
    """Take in a reading of the position; at rest, where static friction hides what acts, all but e and v_e stay."""
    X, P, past, n = memory.X, memory.P, memory.past, memory.X.shape[0]
    here, _ = asked(plan, past)
    variance = P[0, 0] + plan.noise
    if not (np.isfinite(reading) and variance > 0.0):
        return
    shown, most, k = reading - here - X[0], WILD * np.sqrt(variance), plan.places.shape[0]
    error = min(max(shown, -most), most)
    most = max(most, abs(memory.held[LAST]))  # a reading alone may be a glitch; what the next one confirms is the axis
    memory.held[LAST] = shown
    shown = min(max(shown, -most), most)
    gain = P[:, 0] / variance
    memory.held[SCALE] += share * plan.h / MEMORY_OF_SCALE * (error * error / variance - memory.held[SCALE])
    for i in range(DISTURBANCE, n):
        gain[i] *= share
    for i in range(THETA + k, THETA + k + 2 * plan.cells):
        gain[i] /= 1.0 + (past[0, VELOCITY] / plan.passing) ** 2
    row = P[0].copy()
    for i in range(n):
        X[i] += gain[i] * (shown if i < THETA else error)
    X[DISTURBANCE] = min(max(X[DISTURBANCE], -plan.limit), plan.limit)
    for i in range(THETA, n):
        most = FURTHEST if i < THETA + k else (plan.limit if i < THETA + k + plan.cells else 1.0)
        X[i] = min(max(X[i], -most), most)
    for i in range(n):  # Joseph's form, which holds for any gain
        for j in range(i + 1):
            P[i, j] += gain[i] * gain[j] * variance - gain[i] * row[j] - row[i] * gain[j]
            P[j, i] = P[i, j]


@njit(**OPTIONS)
def begin(plan, memory, reference, reading):
    """Start at rest where the position is, nothing known of d, theta, c, b and a but their spread."""
    memory.X[:], memory.P[:, :], memory.s[:], memory.w[:], memory.held[:] = 0.0, 0.0, 0.0, 0.0, 0.0
    memory.past[:, :], memory.Z[:, :] = 0.0, 0.0
    v, a = reference[1], reference[2]
    for i in range(memory.past.shape[0]):  # until now the reference came from rest at a constant acceleration
        back = min(i * plan.h, v / a) if v * a > 0.0 else 0.0
        memory.past[i, POSITION] = reference[0] - back * (v - 0.5 * a * back)
        memory.past[i, VELOCITY] = v - a * back
    memory.p[:], memory.held[SCALE] = plan.p, 1.0
    if np.isfinite(reading):
        memory.X[DEVIATION] = reading - reference[0]
    memory.P[0, 0] = plan.noise
    for i in range(plan.spread.shape[0]):
        memory.P[DISTURBANCE + i, DISTURBANCE + i] = plan.spread[i] ** 2
    n = plan.cells
    for first in (THETA + plan.places.shape[0], THETA + plan.places.shape[0] + n):
        for i in range(n):
            for j in range(n):
                alike = np.exp(-0.5 * ((i - j) / ALIKE) ** 2) + ROUND_OFF * (i == j)
                memory.P[first + i, first + j] = plan.spread[first + i - DISTURBANCE] ** 2 * alike
