"""Implicit one-step integration of R(s, w, u; p) = 0, compiled once for every mechanism.

State s = (q, v, z), unknown w = (a, z'). In a stage with w = (a_i, z'_i) and diagonal value gamma

    v_i = v_known + h gamma a_i,   q_i = q_known + h gamma v_i,   z_i = z_known + h gamma z'_i,

so that only w is unknown, and Newton's matrix is dR/dw + (ds/dw)^T dR/ds with ds/dw = (h gamma)^2, h gamma, h gamma.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit, types

F1, F2, F3 = types.float64[::1], types.float64[:, ::1], types.float64[:, :, ::1]
KERNEL = types.FunctionType(types.void(F1, F1, F1, F1, F1))
OPTIONS: dict[str, Any] = {"cache": True, "error_model": "numpy", "nogil": True}
INLINED: dict[str, Any] = {**OPTIONS, "inline": "always"}  # calls with many arrays cost as much as the arithmetic

OK, NOT_CONVERGED, CONTACT_LOST, TOO_MANY_STEPS = 0, 1, 2, 3
SMALLEST, ATTEMPTS, ROUNDOFF, FASTEST = 1e-7, 20000, 1e-2, 1e-3


@njit(**INLINED)
def evaluate(coefficients, k, offset, u):
    """Write the inputs at t_k + offset into u."""
    for j in range(u.shape[0]):
        value = 0.0
        for d in range(coefficients.shape[2] - 1, -1, -1):
            value = value * offset + coefficients[k, j, d]
        u[j] = value


@njit(**INLINED)
def newton_matrix(out, m, n_w, hg, matrix):
    """Write dR/dw + hg dR/dv + hg^2 dR/dq (a), dR/dw + hg dR/dz (z') into matrix."""
    n_s = m + n_w
    for i in range(n_w):
        state, unknown = n_w + i * n_s, n_w + n_w * n_s + i * n_w
        for j in range(m):
            matrix[i, j] = out[unknown + j] + hg * (out[state + m + j] + hg * out[state + j])
        for j in range(m, n_w):
            matrix[i, j] = out[unknown + j] + hg * out[state + m + j]


@njit(**INLINED)
def factorize(matrix, pivots):
    """LU factors in place with partial pivoting; False where the matrix is singular or not finite."""
    n = matrix.shape[0]
    for j in range(n):
        best = j
        for i in range(j + 1, n):
            if abs(matrix[i, j]) > abs(matrix[best, j]):
                best = i
        pivots[j] = best
        if not (abs(matrix[best, j]) > 0.0 and np.isfinite(matrix[best, j])):
            return False
        if best != j:
            for i in range(n):
                matrix[j, i], matrix[best, i] = matrix[best, i], matrix[j, i]
        for i in range(j + 1, n):
            matrix[i, j] /= matrix[j, j]
            for c in range(j + 1, n):
                matrix[i, c] -= matrix[i, j] * matrix[j, c]
    return True


@njit(**INLINED)
def back_substitute(matrix, pivots, b):
    """Solve in place for one right-hand side."""
    n = matrix.shape[0]
    for j in range(n):
        b[j], b[pivots[j]] = b[pivots[j]], b[j]
        for i in range(j + 1, n):
            b[i] -= matrix[i, j] * b[j]
    for j in range(n - 1, -1, -1):
        b[j] /= matrix[j, j]
        for i in range(j):
            b[i] -= matrix[i, j] * b[j]


@njit(**INLINED)
def place(known, w, hg, m, s):
    """Write the stage's state for the unknown w into s."""
    for j in range(m):
        s[m + j] = known[m + j] + hg * w[j]
        s[j] = known[j] + hg * s[m + j]
    for j in range(2 * m, s.shape[0]):
        s[j] = known[j] + hg * w[j - m]


@njit(**INLINED)
def gather(a, i, h, s0, stages_v, stages_w, known):
    """Write the part of stage i's state that the earlier stages give into known."""
    m = stages_v.shape[1]
    for d in range(s0.shape[0]):
        known[d] = s0[d]
    for j in range(i):
        ha = h * a[i, j]
        for d in range(m):
            known[d] += ha * stages_v[j, d]
        for d in range(stages_w.shape[1]):
            known[m + d] += ha * stages_w[j, d]


@njit(**INLINED)
def solve_stage(kernel, known, hg, u, p, m, atol, tolerance, w, s, out, delta, matrix, pivots, rate):
    """Newton's method for one stage; w enters as the guess. Returns whether it converged.

    The error left, in units of the error tolerance of velocity and z, is estimated as the last correction times the
    rate at which corrections shrank last (kept in ``rate`` from stage to stage, as Hairer and Wanner's RADAU5 does):
    it is below ``tolerance``. A correction that stops shrinking there is roundoff; one that grows is halved.
    """
    n_w = w.shape[0]
    previous = np.inf
    scale = hg if hg > 0.0 else 1.0
    for iteration in range(25):
        place(known, w, hg, m, s)
        kernel(s, w, u, p, out)
        for i in range(n_w):
            delta[i] = -out[i]
        newton_matrix(out, m, n_w, hg, matrix)
        if not factorize(matrix, pivots):
            return False
        back_substitute(matrix, pivots, delta)
        size = 0.0
        for i in range(n_w):
            size = max(size, abs(delta[i]) * scale / atol[m + i])
        if not np.isfinite(size):
            return False
        if iteration > 0 and previous > 0.0:
            rate[0] = max(size / previous, FASTEST)
        converged = size * min(rate[0], 1.0) < tolerance or (
            iteration > 1 and size < ROUNDOFF and size > 0.1 * previous
        )
        damping = 0.5 if not converged and iteration > 2 and size > 0.9 * previous else 1.0
        previous = size
        for i in range(n_w):
            w[i] += damping * delta[i]
        if converged:
            place(known, w, hg, m, s)
            return True
    return False


@njit(**INLINED)
def step(kernel, a, c, coefficients, k, offset, h, p, m, atol, tolerance, s0, stages_w, stages_v, work, s, out):
    """One step of size h from s0 at t_k + offset; stages_w[0] holds w at its start, s receives the new state.

    Returns OK, or why the step failed: NOT_CONVERGED, CONTACT_LOST.
    """
    n_s, n_w = s0.shape[0], stages_w.shape[1]
    known, u, w, delta, matrix, pivots, rate = work
    for d in range(m):
        stages_v[0, d] = s0[m + d]
    for i in range(1, a.shape[0]):
        gather(a, i, h, s0, stages_v, stages_w, known)
        evaluate(coefficients, k, offset + c[i] * h, u)
        ahead = (c[i] - c[i - 1]) / (c[i - 1] - c[i - 2]) if i > 1 and c[i - 1] > c[i - 2] else 0.0
        for d in range(n_w):
            w[d] = stages_w[i - 1, d] + ahead * (stages_w[i - 1, d] - stages_w[max(i - 2, 0), d])
        converged = solve_stage(
            kernel, known, h * a[i, i], u, p, m, atol, tolerance, w, s, out, delta, matrix, pivots, rate
        )
        if not out[n_w + n_w * (n_s + n_w)] > 0.0:
            return CONTACT_LOST
        if not converged:
            return NOT_CONVERGED
        for d in range(n_w):
            stages_w[i, d] = w[d]
        for d in range(m):
            stages_v[i, d] = s[m + d]
    return OK


@njit(**INLINED)
def error_size(stages_w, stages_v, error, h, m, s0, s, atol, rtol, places, largest):
    """Largest embedded error estimate among the components of the state, in units of the tolerance."""
    worst = 0.0
    for d in range(s.shape[0]):
        total = 0.0
        for j in range(error.shape[0]):
            total += error[j] * (stages_v[j, d] if d < m else stages_w[j, d - m])
        size = max(abs(s0[d]), abs(s[d]))
        if d >= 2 * m:
            size = max(size, largest[places[d - 2 * m]])
        worst = max(worst, abs(h * total) / (atol[d] + rtol * size))
    return worst


@njit(**OPTIONS)
def remember(record, taken, k, offset, h, stages_w):
    """Add a step to the record (interval, offset and size, stage unknowns), doubled where it is full."""
    interval, size, unknowns = record
    if taken == interval.shape[0]:
        interval, size = np.append(interval, interval), np.append(size, size).reshape((-1, 2))
        unknowns = np.append(unknowns, unknowns).reshape((-1, *stages_w.shape))
    interval[taken], size[taken, 0], size[taken, 1] = k, offset, h
    for i in range(stages_w.shape[0]):
        for d in range(stages_w.shape[1]):
            unknowns[taken, i, d] = stages_w[i, d]
    return interval, size, unknowns


@njit(**INLINED)
def copy_to(source, target):
    """Copy a short vector (a slice assignment takes several times as long)."""
    for d in range(source.shape[0]):
        target[d] = source[d]


@njit(**OPTIONS)
def begin(kernel, coefficients, p, m, atol, start, first, s, out, work):
    """Solve for w at the first sample (into first). Returns the status."""
    _, u, _, delta, matrix, pivots, rate = work
    evaluate(coefficients, 0, 0.0, u)
    converged = solve_stage(kernel, start, 0.0, u, p, m, atol, 1e-9, first, s, out, delta, matrix, pivots, rate)
    if not out[out.shape[0] - 1] > 0.0:
        return CONTACT_LOST
    return OK if converged else NOT_CONVERGED


@njit(**OPTIONS)
def next_size(h, size, order):
    """Step size from the last one and its error estimate."""
    return h * min(5.0, max(0.2, 0.9 * (size + 1e-10) ** (-1.0 / order)))


@njit(
    types.Tuple((types.int64, types.float64, F2, F2, types.int64[::1], F2, F3))(
        KERNEL, F2, F1, F1, types.int64, F1, F3, F1, types.int64, F1, types.int64[::1], types.float64, types.float64,
        F1, types.int64[::1], F2,
    ),
    **OPTIONS,
)  # fmt: skip
def integrate(
    kernel, a, c, error, order, t, coefficients, p, m, atol, places, rtol, tolerance, start, replay_k, replay_h
):  # fmt: skip
    """Integrate over the samples t; with replay_k not empty, take those recorded steps instead of choosing any.

    ``places`` tells the contact of each state behind the velocities: its error counts beside the largest there.

    Returns:
        status, time reached, S (n, n_s) and W (n, n_w) at the samples, and the record of the steps: interval index
        (steps,), offset in the interval and size (steps, 2), stage unknowns (steps, stages, n_w).
    """
    n, n_s, n_w, stages, n_u = t.shape[0], start.shape[0], start.shape[0] - m, a.shape[0], coefficients.shape[1]
    states, unknowns = np.empty((n, n_s)), np.empty((n, n_w))
    record = (np.empty(2 * n, np.int64), np.empty((2 * n, 2)), np.empty((2 * n, stages, n_w)))
    s, s0, first = start.copy(), start.copy(), np.zeros(n_w)
    stages_w, stages_v = np.zeros((stages, n_w)), np.zeros((stages, m))
    out = np.zeros(n_w + n_w * (n_s + n_w) + 1)
    matrix, pivots = np.empty((n_w, n_w)), np.empty(n_w, np.int64)
    work = (np.empty(n_s), np.zeros(n_u), np.empty(n_w), np.empty(n_w), matrix, pivots, np.ones(1))
    status = begin(kernel, coefficients, p, m, atol, start, first, s, out, work)
    copy_to(start, states[0])
    copy_to(first, unknowns[0])
    if status != OK:
        return status, t[0], states, unknowns, *record
    replaying = replay_k.shape[0] > 0
    taken, h_next, largest = 0, (t[1] - t[0]) * 0.1, np.zeros(n_s - 2 * m)
    for k in range(n - 1):
        interval = t[k + 1] - t[k]
        offset, attempts = 0.0, 0
        while offset < interval:
            h = replay_h[taken, 1] if replaying else interval - offset
            if not replaying and h_next < 0.999 * h:
                h /= np.ceil(h / h_next)
            copy_to(first, stages_w[0])
            status = step(
                kernel, a, c, coefficients, k, offset, h, p, m, atol, tolerance, s0, stages_w, stages_v, work, s, out
            )
            size = 0.0
            if status == OK and not replaying:
                size = error_size(stages_w, stages_v, error, h, m, s0, s, atol, rtol, places, largest)
            attempts += 1
            if status != OK or not size <= 1.0:
                if replaying or h < SMALLEST * interval or attempts > ATTEMPTS:
                    return status if status != OK else TOO_MANY_STEPS, t[k] + offset, states, unknowns, *record
                h_next = 0.25 * h if status != OK else next_size(h, size, order)
                continue
            record = remember(record, taken, k, offset, h, stages_w)
            taken += 1
            copy_to(stages_w[stages - 1], first)
            copy_to(s, s0)
            for d in range(2 * m, n_s):
                largest[places[d - 2 * m]] = max(largest[places[d - 2 * m]], abs(s[d]))
            h_next = next_size(h, size, order)
            offset = interval if offset + h >= interval * (1.0 - 1e-12) else offset + h
        copy_to(s0, states[k + 1])
        copy_to(first, unknowns[k + 1])
    return OK, t[n - 1], states, unknowns, record[0][:taken], record[1][:taken], record[2][:taken]


@njit(types.float64[:, ::1](KERNEL, F2, F2, F2, F1, types.int64), **OPTIONS)
def evaluate_samples(kernel, states, unknowns, inputs, p, n_out):
    """Outputs of a kernel at every sample, shape (n, n_out)."""
    result = np.zeros((states.shape[0], n_out))
    for k in range(states.shape[0]):
        kernel(states[k], unknowns[k], inputs[k], p, result[k])
    return result
