"""The filter's recursions, compiled: sigma points through the stiff equation of motion, correction by one sample.

State X = (s, chains, parameters): the mechanism's own state s = (q, v, states of effects, z); for every driven
coordinate and input a chain of its value and derivatives, the last of which is a Wiener process; and the logarithm of
every parameter that adapts. A chain is its own Taylor polynomial over a step, so the integrator of the simulator takes
it as it is.

Means go through the equations as they are; covariances as sums of half differences between two points a root of the
covariance to either side, which keeps them positive (the divided-difference filter of Norgaard, Poulsen and Ravn,
Automatica 36, 2000).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit

from ..numerics.integrator import OK, OPTIONS, begin, integrate
from ..numerics.kalman_recursions import transition
from .layout import FORCE, RATE, STATE

OFFSET, ORDER, COLUMN, MOTION = 0, 1, 2, 3  # columns of the table of chains
FACTORIAL = np.array([1.0, 1.0, 2.0, 6.0, 24.0, 120.0])
SINGULAR = 1e-13  # pivot over its diagonal element below which a variance counts as zero
SURE = 2.0  # standard deviations of a velocity that count as motion
DEGREE = 5  # of the inputs' polynomials
WILD = 30.0  # standard deviations: the most by which a sample moves the state, however wild


class Equations(NamedTuple):
    """What the recursions need to know of a mechanism.

    Attributes:
        newton, outputs: addresses of the compiled kernels.
        a, c, error, order: the integrator's tableau.
        chains: offset in X, number of states, column in u, whether it is a coordinate; shape (n_chains, 4).
        adapted: place in p of the parameters whose logarithms end X, shape (n_adapted,).
        p: all parameters; those that adapt are overwritten.
        sizes: m (free coordinates), n_s, n_w, n_u.
        clocks: value at t = 0 and slope of the clocks that are the last inputs, shape (n_clocks, 2).
        atol, rtol: tolerances of the integrator, atol of shape (n_s,).
        places: contact of each state behind the velocities.
        spread: distance of the sigma points, in standard deviations.
        contacts: their number.
        slips: whether a free coordinate moves the contact of a parameter that adapts, shape (n_adapted, m).
    """

    newton: Any
    outputs: Any
    a: np.ndarray
    c: np.ndarray
    error: np.ndarray
    order: int
    chains: np.ndarray
    adapted: np.ndarray
    p: np.ndarray
    sizes: tuple[int, int, int, int]
    clocks: np.ndarray
    atol: np.ndarray
    places: np.ndarray
    rtol: float
    spread: float
    contacts: int
    slips: np.ndarray


@njit(**OPTIONS)
def inputs(eq, X, now):
    """Polynomials of all inputs, shape (1, n_u, 6), from the chains; clocks that enter are the last inputs."""
    n_u, n_clocks = eq.sizes[3], eq.clocks.shape[0]
    coefficients = np.zeros((1, n_u, DEGREE + 1))
    for i in range(eq.chains.shape[0]):
        offset, order, column = eq.chains[i, OFFSET], eq.chains[i, ORDER], eq.chains[i, COLUMN]
        for k in range(3 if eq.chains[i, MOTION] else 1):
            for d in range(min(order - k, DEGREE + 1)):
                coefficients[0, column + k, d] = X[offset + k + d] / FACTORIAL[d]
    for i in range(n_clocks):
        column, slope = n_u - n_clocks + i, eq.clocks[i, 1]
        coefficients[0, column, 0], coefficients[0, column, 1] = eq.clocks[i, 0] + slope * now, slope
    return coefficients


@njit(**OPTIONS)
def parameters(eq, X):
    """All parameters, those of X put in their places."""
    p, count = eq.p.copy(), eq.adapted.shape[0]
    for i in range(count):
        p[eq.adapted[i]] = np.exp(X[X.shape[0] - count + i])
    return p


@njit(**OPTIONS)
def root(P):
    """Lower Cholesky factor of a positive semi-definite matrix; a direction without variance gives zeros."""
    n = P.shape[0]
    L = np.zeros((n, n))
    for j in range(n):
        pivot = P[j, j]
        for k in range(j):
            pivot -= L[j, k] ** 2
        if not pivot > SINGULAR * P[j, j]:
            continue
        L[j, j] = np.sqrt(pivot)
        for i in range(j + 1, n):
            total = P[i, j]
            for k in range(j):
                total -= L[i, k] * L[j, k]
            L[i, j] = total / L[j, j]
    return L


@njit(**OPTIONS)
def flow(eq, X, now, h):
    """Status of the integrator and the mechanism's own state, shape (n_s,), a step h after X."""
    m, n_s = eq.sizes[:2]
    start = X[:n_s].copy()
    if n_s == 0:
        return OK, start
    result = integrate(
        eq.newton, eq.a, eq.c, eq.error, eq.order, np.array([0.0, h]), inputs(eq, X, now), parameters(eq, X), m,
        eq.atol, eq.places, eq.rtol, 1e-2, start, np.empty(0, np.int64), np.empty((0, 2)),
    )  # fmt: skip
    return result[0], result[2][1].copy()


@njit(**OPTIONS)
def look(eq, X, now):
    """Status, w = (a, z') and (v_slip, N, F) of every contact at X."""
    m, n_s, n_w, n_u = eq.sizes
    coefficients, p, s, w = inputs(eq, X, now), parameters(eq, X), X[:n_s].copy(), np.zeros(n_w)
    u, seen, status = coefficients[0, :, 0].copy(), np.zeros(3 * eq.contacts), OK
    if n_w > 0:
        out = np.zeros(n_w + n_w * (n_s + n_w) + 1)
        work = (np.empty(n_s), np.zeros(n_u), np.empty(n_w), np.empty(n_w), np.empty((n_w, n_w)),
                np.empty(n_w, np.int64), np.ones(1))  # fmt: skip
        status = begin(eq.newton, coefficients, p, m, eq.atol, s, w, s.copy(), out, work)
    eq.outputs(s, w, u, p, seen)
    return status, w, seen


@njit(**OPTIONS)
def slides(eq, X, P, i):
    """Whether the contact of the i-th parameter that adapts slides for certain: a free coordinate that moves it does;
    always where the motion is imposed."""
    m = eq.sizes[0]
    for j in range(m):
        if eq.slips[i, j] and X[m + j] ** 2 > SURE**2 * P[m + j, m + j]:
            return True
    return m == 0


@njit(**OPTIONS)
def predict(eq, X, P, kicks, walks, densities, now, h):
    """Advance mean and covariance by a step h, in place; return the integrator's status for the mean.

    ``kicks`` are variances per second of velocities (and z) that are added before the step, so that the contact
    answers to them; ``walks`` those of the parameters; ``densities`` the spectral densities of the chains.
    """
    n, n_s = X.shape[0], eq.sizes[1]
    for i in range(n_s):
        P[i, i] += kicks[i] * h
    L = root(P) * eq.spread
    status, mean = flow(eq, X, now, h)
    if status != OK:
        mean = X[:n_s].copy()
    change = np.zeros((n, n))
    for j in range(n):
        there, ahead = X + L[:, j], X - L[:, j]
        first, up = flow(eq, there, now, h)
        second, down = flow(eq, ahead, now, h)
        for i in range(n_s):
            if first == OK and second == OK:
                change[i, j] = 0.5 * (up[i] - down[i]) / eq.spread
            elif first == OK:
                change[i, j] = (up[i] - mean[i]) / eq.spread
            elif second == OK:
                change[i, j] = (mean[i] - down[i]) / eq.spread
            else:
                change[i, j] = L[i, j] / eq.spread
    for i in range(n_s, n):
        change[i] = L[i] / eq.spread
    X[:n_s] = mean
    noise = np.zeros((n, n))
    for i in range(eq.chains.shape[0]):
        offset, size = eq.chains[i, OFFSET], eq.chains[i, ORDER]
        F, Q = np.zeros((size, size)), np.zeros((size, size))
        transition(h, densities[i], F, Q)
        part = slice(offset, offset + size)
        X[part] = F @ X[part].copy()
        change[part] = F @ change[part].copy()
        noise[part, part] = Q
    count = walks.shape[0]
    for i in range(count):  # at rest a surface shows no change, and none is assumed
        noise[n - count + i, n - count + i] = walks[i] * h if slides(eq, X, P, i) else 0.0
    P[:] = change @ change.T + noise
    return status


@njit(**OPTIONS)
def correct(eq, X, P, y, R, rows, now):
    """Take in one sample, in place.

    Args:
        y, R, rows: signals (NaN: missing), variances of their noise, and what each shows (kind, index).

    Returns:
        log-likelihood, friction forces and their variances, shape (contacts,), and the normalised innovation squared
        (chi-squared where model and noise levels are right) with its degrees of freedom.
    """
    n, count, contacts = X.shape[0], y.shape[0], eq.contacts
    L = root(P) * eq.spread
    _, w, seen = look(eq, X, now)
    expected, slopes = np.zeros(count + contacts), np.zeros((count + contacts, n))
    kinds, indices = np.full(count + contacts, FORCE), np.zeros(count + contacts, np.int64)
    kinds[:count], indices[:count] = rows[:, 0], rows[:, 1]
    for k in range(contacts):
        indices[count + k] = k
    for k in range(count + contacts):
        kind, index = kinds[k], indices[k]
        expected[k] = X[index] if kind == STATE else (w[index] if kind == RATE else seen[3 * index + 2])
    for j in range(n):
        _, w_up, seen_up = look(eq, X + L[:, j], now)
        _, w_down, seen_down = look(eq, X - L[:, j], now)
        for k in range(count + contacts):
            kind, index = kinds[k], indices[k]
            if kind == STATE:
                slopes[k, j] = L[index, j] / eq.spread
            elif kind == RATE:
                slopes[k, j] = 0.5 * (w_up[index] - w_down[index]) / eq.spread
            else:
                slopes[k, j] = 0.5 * (seen_up[3 * index + 2] - seen_down[3 * index + 2]) / eq.spread
    L /= eq.spread
    used = np.flatnonzero(np.isfinite(y) & np.isfinite(R) & np.isfinite(expected[:count]))
    forces, variances = expected[count:].copy(), np.zeros(contacts)
    for k in range(contacts):
        variances[k] = slopes[count + k] @ slopes[count + k]
    if used.shape[0] == 0:
        return 0.0, forces, variances, 0.0, 0
    D = slopes[used]
    S = D @ D.T
    for k in range(used.shape[0]):
        S[k, k] += R[used[k]]
    innovation, shared = y[used] - expected[:count][used], np.zeros((contacts, used.shape[0]))
    for k in range(contacts):
        shared[k] = D @ slopes[count + k]
    C = root(S)
    white, gain, own = whiten(C, innovation, D @ L.T, shared)
    share = min(1.0, WILD * np.sqrt(used.shape[0]) / max(np.sqrt(white @ white), 1e-300))
    X += share * (gain.T @ white)  # a reading that no noise explains moves the state, and not out of the world
    P -= gain.T @ gain
    for i in range(n):
        P[i, i] = max(P[i, i], 0.0)
    loglik, freedom = -0.5 * (white @ white), 0
    for k in range(used.shape[0]):
        if C[k, k] > 0.0:
            loglik -= np.log(C[k, k]) + 0.5 * np.log(2 * np.pi)
            freedom += 1
    for k in range(contacts):
        variances[k] = max(variances[k] - own[k] @ own[k], 0.0)
        forces[k] += share * (own[k] @ white)
    return loglik, forces, variances, white @ white, freedom


@njit(**OPTIONS)
def whiten(C, a, B, c):
    """C^-1 a, C^-1 B and C^-1 of every row of c by forward substitution; zeros where C has none on its diagonal."""
    a, B, c = a.copy(), B.copy(), c.copy()
    for j in range(C.shape[0]):
        if not C[j, j] > 0.0:
            a[j], c[:, j] = 0.0, 0.0
            B[j] = 0.0
            continue
        for k in range(j):
            a[j] -= C[j, k] * a[k]
            B[j] -= C[j, k] * B[k]
            for i in range(c.shape[0]):
                c[i, j] -= C[j, k] * c[i, k]
        a[j] = a[j] / C[j, j]
        for i in range(c.shape[0]):
            c[i, j] = c[i, j] / C[j, j]
        B[j] /= C[j, j]
    return a, B, c


@njit(**OPTIONS)
def run(eq, X, P, kicks, walks, densities, t, Y, R, rows):
    """Filter a whole trial.

    Returns:
        log-likelihood; forces and their variances, shape (n, contacts); normalised innovation squared and its degrees
        of freedom, shape (n,); the states, shape (n, n_X).
    """
    n = t.shape[0]
    squares, freedoms = np.empty(n), np.empty(n, np.int64)
    total, states = 0.0, np.empty((n, X.shape[0]))
    forces, variances = np.empty((n, eq.contacts)), np.empty((n, eq.contacts))
    for k in range(n):
        if k > 0:
            predict(eq, X, P, kicks, walks, densities, t[k - 1], t[k] - t[k - 1])
        loglik, forces[k], variances[k], squares[k], freedoms[k] = correct(eq, X, P, Y[k], R, rows, t[k])
        total += loglik
        states[k] = X
    return total, forces, variances, squares, freedoms, states
