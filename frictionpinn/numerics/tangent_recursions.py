"""Compiled recursions of :mod:`.tangent`: the linear equations along a motion, and their answers to what drives them.

numba's cache does not notice a change in a function imported from another file: after editing integrator.py or
sensitivity.py, touch this file too.
"""

from __future__ import annotations

import numpy as np
from numba import njit, types

from .integrator import F1, F2, F3, KERNEL, OPTIONS, copy_to, evaluate, factorize, gather, newton_matrix, place
from .sensitivity import I1, I2, copy_rows, gather_rows, place_rows, solve_rows


@njit(types.Tuple((F2, F2, F2, F3, I2, F3))(KERNEL, F2, F1, F3, F1, types.int64, F1, F1, I1, F2, F3), **OPTIONS)
def linearise(kernel, a, c, coefficients, p, m, s_start, w_start, record_k, record_h, record_w):
    """Every stage of the recorded steps, the first sample before them: s (count, n_s), w (count, n_w), u (count, n_u),
    LU factors of Newton's matrix (count, n_w, n_w) with their pivots, and the derivatives of R in the part of s that
    the stage's own unknowns do not enter (count, n_w, n_s)."""
    n_s, n_w, stages, n_u = s_start.shape[0], w_start.shape[0], a.shape[0], coefficients.shape[1]
    count = 1 + record_k.shape[0] * (stages - 1)
    S, W, U = np.empty((count, n_s)), np.empty((count, n_w)), np.empty((count, n_u))
    factors, pivots = np.empty((count, n_w, n_w)), np.empty((count, n_w), np.int64)
    rows = np.empty((count, n_w, n_s))
    out = np.zeros(n_w + n_w * (n_s + n_w) + 1)
    s0, known, stages_v, stages_w = s_start.copy(), np.empty(n_s), np.zeros((stages, m)), np.zeros((stages, n_w))
    at = 0
    for index in range(-1, record_k.shape[0]):
        for i in range(1, stages if index >= 0 else 2):
            if index < 0:
                hg = 0.0
                copy_to(s_start, S[0])
                copy_to(w_start, W[0])
                evaluate(coefficients, 0, 0.0, U[0])
            else:
                k, offset, h = record_k[index], record_h[index, 0], record_h[index, 1]
                hg = h * a[i, i]
                if i == 1:
                    for j in range(stages):
                        copy_to(record_w[index, j], stages_w[j])
                    copy_to(s0[m : 2 * m], stages_v[0])
                gather(a, i, h, s0, stages_v, stages_w, known)
                place(known, stages_w[i], hg, m, S[at])
                copy_to(stages_w[i], W[at])
                evaluate(coefficients, k, offset + c[i] * h, U[at])
            kernel(S[at], W[at], U[at], p, out)
            newton_matrix(out, m, n_w, hg, factors[at])
            factorize(factors[at], pivots[at])
            for d in range(n_w):
                for e in range(n_s):
                    rows[at, d, e] = out[n_w + d * n_s + e]
                    if e >= m and e < 2 * m:
                        rows[at, d, e] += hg * out[n_w + d * n_s + e - m]
            if index >= 0:
                copy_to(S[at, m : 2 * m], stages_v[i])
                if i == stages - 1:
                    copy_to(S[at], s0)
            at += 1
    return S, W, U, factors, pivots, rows


@njit(
    types.Tuple((F3, F3))(
        KERNEL, F2, types.int64, types.int64, F2, F2, F2, F3, I2, F3, F2, types.int64, F2, I1, F2, types.int64,
    ),
    **OPTIONS,
)  # fmt: skip
def respond(kernel, a, n, m, S, W, U, factors, pivots, rows, shapes, strengths, start, record_k, record_h, n_out):
    """ds (n, n_s, n_c) and dw (n, n_w, n_c) at the samples, in every strength at every shape: n_c is their product.

    Args:
        kernel: writes dR by the strengths first, (n_w, strengths).
        S, W, U, factors, pivots, rows: of :func:`linearise`.
        shapes: parameter vectors, shape (shapes, n_p).
        start: ds at the first sample, shape (n_s, n_c).
        n_out: number of outputs, whose derivatives the kernel writes too.
    """
    n_s, n_w, n_c, stages = S.shape[1], W.shape[1], start.shape[1], a.shape[0]
    states, unknowns = np.empty((n, n_s, n_c)), np.empty((n, n_w, n_c))
    out = np.zeros((n_w + n_out) * strengths)
    ds, ds0, dknown, rhs = start.copy(), start.copy(), start.copy(), np.empty((n_w, n_c))
    dstages_v, dstages_w = np.zeros((stages, m, n_c)), np.zeros((stages, n_w, n_c))
    at = 0
    for index in range(-1, record_k.shape[0]):
        if index >= 0:
            copy_rows(ds0, m, m, n_c, dstages_v[0])
            copy_rows(rhs, 0, n_w, n_c, dstages_w[0])
        for i in range(1, stages if index >= 0 else 2):
            h = record_h[index, 1] if index >= 0 else 0.0
            if index >= 0:
                gather_rows(a, i, h, n_c, ds0, dstages_v, dstages_w, dknown)
            for j in range(shapes.shape[0]):
                kernel(S[at], W[at], U[at], shapes[j], out)
                for d in range(n_w):
                    for g in range(strengths):
                        rhs[d, j * strengths + g] = -out[d * strengths + g]
            for d in range(n_w):
                for e in range(n_s):
                    value = rows[at, d, e]
                    if value != 0.0:
                        for c in range(n_c):
                            rhs[d, c] -= value * dknown[e, c]
            solve_rows(factors[at], pivots[at], n_c, rhs)
            if index >= 0:
                place_rows(dknown, rhs, h * a[i, i], m, n_c, ds)
                copy_rows(ds, m, m, n_c, dstages_v[i])
                copy_rows(rhs, 0, n_w, n_c, dstages_w[i])
            at += 1
        if index >= 0:
            copy_rows(ds, 0, n_s, n_c, ds0)
        k = record_k[index] if index >= 0 else -1
        if index + 1 == record_k.shape[0] or record_k[index + 1] != k:
            copy_rows(ds, 0, n_s, n_c, states[k + 1])
            copy_rows(rhs, 0, n_w, n_c, unknowns[k + 1])
    return states, unknowns


@njit(F3(KERNEL, F2, F2, F2, F2, types.int64, I1, types.int64), **OPTIONS)
def direct(kernel, states, unknowns, inputs, shapes, strengths, which, n_out):
    """What the outputs ``which`` change by the strengths at once, shape (len(which), n, shapes * strengths).

    They are the last entries of ``kernel``, (n_out, strengths).
    """
    n, n_w = states.shape[0], unknowns.shape[1]
    result, out = np.empty((len(which), n, shapes.shape[0] * strengths)), np.zeros((n_w + n_out) * strengths)
    for k in range(n):
        for j in range(shapes.shape[0]):
            kernel(states[k], unknowns[k], inputs[k], shapes[j], out)
            for i in range(len(which)):
                for g in range(strengths):
                    result[i, k, j * strengths + g] = out[(n_w + which[i]) * strengths + g]
    return result
