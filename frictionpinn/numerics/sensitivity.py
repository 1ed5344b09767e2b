"""Forward sensitivities of the implicit integrator, by differentiating its steps with their sizes held.

With S = ds/dc and W = dw/dc for the quantities c, each stage satisfies R_s S_i + R_w W_i + R_p dp/dc + R_u du/dc = 0
together with the stage's own relation between S_i and W_i: a linear system with Newton's matrix.

numba's cache does not notice a change in a function imported from another file: after editing integrator.py, touch
this file too.
"""

from __future__ import annotations

import numpy as np
from numba import njit, types

from .integrator import F1, F2, F3, INLINED, KERNEL, OPTIONS, copy_to, evaluate, factorize, gather, newton_matrix, place
from .paths import DEGREE
from .spline_basis import LANES

F4 = types.float64[:, :, :, ::1]
I1, I2 = types.int64[::1], types.int64[:, ::1]


@njit(**INLINED)
def known_part(out, m, hg, columns, n_p, active, known, rhs):
    """Write -(R_s S_known + R_p), what neither the stage's own unknowns nor the inputs enter, into rhs (n_w, n_c).

    Only the first ``active`` columns: the others act later.
    """
    n_s, n_w = known.shape[0], rhs.shape[0]
    by_p = n_w + n_w * (n_s + n_w) + 1
    for i in range(n_w):
        for c in range(active):
            rhs[i, c] = -out[by_p + i * n_p + columns[c]] if columns[c] >= 0 else 0.0
        for d in range(n_s):
            value = out[n_w + i * n_s + d]
            if d >= m and d < 2 * m:
                value += hg * out[n_w + i * n_s + d - m]
            if value != 0.0:
                for c in range(active):
                    rhs[i, c] -= value * known[d, c]


@njit(**INLINED)
def driven_part(out, n_s, n_p, first, pieces, lanes, groups, piece, since, k, offset, du, change, rhs):
    """Add -R_u du/dc of the directions that act in the interval k to rhs, a group at a time.

    Constant widths of the loops over lanes let them be compiled for them.
    """
    n_w = rhs.shape[0]
    by_u = n_w + n_w * (n_s + n_w) + 1 + n_w * n_p
    n_u = (out.shape[0] - by_u) // n_w  # clocks included, which no direction changes
    for g in range(groups.shape[0]):
        if k < groups[g, 0] or k > groups[g, 1]:
            continue
        at, x = piece[g, k], since[g, k] + offset
        for i in range(n_w):
            for lane in range(LANES):
                change[i, lane] = 0.0
        for d in range(groups[g, 2], groups[g, 2] + groups[g, 3]):
            for lane in range(LANES):
                du[lane] = pieces[at, d, DEGREE, lane]
            for e in range(DEGREE - 1, -1, -1):
                for lane in range(LANES):
                    du[lane] = du[lane] * x + pieces[at, d, e, lane]
            for i in range(n_w):
                value = out[by_u + i * n_u + d]
                if value != 0.0:
                    for lane in range(LANES):
                        change[i, lane] += value * du[lane]
        for lane in range(LANES):
            if lanes[at, lane] >= 0:
                for i in range(n_w):
                    rhs[i, first + lanes[at, lane]] -= change[i, lane]


@njit(**INLINED)
def solve_rows(matrix, pivots, n_c, b):
    """Solve in place for the first n_c columns of b, given the LU factors."""
    n = b.shape[0]
    for j in range(n):
        if pivots[j] != j:
            for c in range(n_c):
                b[j, c], b[pivots[j], c] = b[pivots[j], c], b[j, c]
        for i in range(j + 1, n):
            for c in range(n_c):
                b[i, c] -= matrix[i, j] * b[j, c]
    for j in range(n - 1, -1, -1):
        for c in range(n_c):
            b[j, c] /= matrix[j, j]
        for i in range(j):
            for c in range(n_c):
                b[i, c] -= matrix[i, j] * b[j, c]


@njit(**INLINED)
def gather_rows(a, i, h, n_c, start, stages_v, stages_w, known):
    """As ``gather``, for the sensitivities: stages_v (stages, m, n_c), stages_w (stages, n_w, n_c)."""
    m = stages_v.shape[1]
    for d in range(start.shape[0]):
        for c in range(n_c):
            known[d, c] = start[d, c]
    for j in range(i):
        ha = h * a[i, j]
        for d in range(m):
            for c in range(n_c):
                known[d, c] += ha * stages_v[j, d, c]
        for d in range(stages_w.shape[1]):
            for c in range(n_c):
                known[m + d, c] += ha * stages_w[j, d, c]


@njit(**INLINED)
def place_rows(known, w, hg, m, n_c, result):
    """As ``place``, for the sensitivities: result, known (n_s, n_c), w (n_w, n_c)."""
    for j in range(m):
        for c in range(n_c):
            result[m + j, c] = known[m + j, c] + hg * w[j, c]
            result[j, c] = known[j, c] + hg * result[m + j, c]
    for j in range(2 * m, known.shape[0]):
        for c in range(n_c):
            result[j, c] = known[j, c] + hg * w[j - m, c]


@njit(**INLINED)
def copy_rows(source, first, count, n_c, target):
    """Copy the first n_c columns of some rows (see ``copy_to``; a slice assignment takes seconds to compile, too)."""
    for d in range(count):
        for c in range(n_c):
            target[d, c] = source[first + d, c]


@njit(**INLINED)
def tell_rows(rows, put, target):
    """Copy rows with every column where it is put."""
    for d in range(rows.shape[0]):
        for c in range(rows.shape[1]):
            target[d, put[c]] = rows[d, c]


@njit(
    types.Tuple((F3, F3))(
        KERNEL, F2, F1, F1, F3, F1, types.int64, F1, F1, F2, I1, I1, F4, I2, I2, I2, F2, I2, I1, F2, F3
    ),
    **OPTIONS,
)  # fmt: skip
def propagate(
    kernel, a, c, t, coefficients, p, m, s_start, w_start, start, columns, put, pieces, lanes, groups, piece, since,
    support, record_k, record_h, record_w,
):  # fmt: skip
    """Sensitivities at the samples: ds/dc (n, n_s, n_c) and dw/dc (n, n_w, n_c).

    Args:
        s_start, w_start: state and unknown at the first sample.
        start: ds/dc there, shape (n_s, n_c).
        columns: index of the parameter that each c is, or -1; ``put`` is its place among those that are returned.
        pieces, lanes, groups, piece, since, support: du/dc for the last entries of c, see
            :class:`frictionpinn.numerics.directions.Directions`.
        record_k, record_h, record_w: the steps that ``integrate`` recorded.
    """
    n, n_s, n_c, n_w, stages = t.shape[0], start.shape[0], start.shape[1], w_start.shape[0], a.shape[0]
    n_p, n_u = p.shape[0], coefficients.shape[1]
    states, unknowns = np.empty((n, n_s, n_c)), np.empty((n, n_w, n_c))
    out = np.zeros(n_w + n_w * (n_s + n_w) + 1 + n_w * (n_p + n_u))
    matrix, pivots, u = np.empty((n_w, n_w)), np.empty(n_w, np.int64), np.empty(n_u)
    du, change = np.empty(LANES), np.empty((n_w, LANES))
    s, s0, known = s_start.copy(), s_start.copy(), np.empty(n_s)
    stages_v, stages_w = np.zeros((stages, m)), np.zeros((stages, n_w))
    ds, ds0, dknown, rhs = start.copy(), start.copy(), start.copy(), np.empty((n_w, n_c))
    dstages_v, dstages_w = np.zeros((stages, m, n_c)), np.zeros((stages, n_w, n_c))
    evaluate(coefficients, 0, 0.0, u)
    kernel(s, w_start, u, p, out)
    newton_matrix(out, m, n_w, 0.0, matrix)
    factorize(matrix, pivots)
    first = n_c - support.shape[0]
    active = first
    while active < n_c and support[active - first, 0] <= 0:
        active += 1
    rhs[:] = 0.0
    known_part(out, m, 0.0, columns, n_p, active, ds, rhs)
    driven_part(out, n_s, n_p, first, pieces, lanes, groups, piece, since, 0, 0.0, du, change, rhs)
    solve_rows(matrix, pivots, active, rhs)
    tell_rows(ds, put, states[0])
    tell_rows(rhs, put, unknowns[0])
    for index in range(record_k.shape[0]):
        k, offset, h = record_k[index], record_h[index, 0], record_h[index, 1]
        while active < n_c and support[active - first, 0] <= k:
            active += 1
        for i in range(stages):
            copy_to(record_w[index, i], stages_w[i])
        copy_to(s0[m : 2 * m], stages_v[0])
        copy_rows(ds0, m, m, active, dstages_v[0])
        copy_rows(rhs, 0, n_w, active, dstages_w[0])
        for i in range(1, stages):
            hg = h * a[i, i]
            gather(a, i, h, s0, stages_v, stages_w, known)
            place(known, stages_w[i], hg, m, s)
            evaluate(coefficients, k, offset + c[i] * h, u)
            kernel(s, stages_w[i], u, p, out)
            newton_matrix(out, m, n_w, hg, matrix)
            factorize(matrix, pivots)
            gather_rows(a, i, h, active, ds0, dstages_v, dstages_w, dknown)
            known_part(out, m, hg, columns, n_p, active, dknown, rhs)
            driven_part(
                out, n_s, n_p, first, pieces, lanes, groups, piece, since, k, offset + c[i] * h, du, change, rhs
            )
            solve_rows(matrix, pivots, active, rhs)
            place_rows(dknown, rhs, hg, m, active, ds)
            copy_to(s[m : 2 * m], stages_v[i])
            copy_rows(ds, m, m, active, dstages_v[i])
            copy_rows(rhs, 0, n_w, active, dstages_w[i])
        copy_to(s, s0)
        copy_rows(ds, 0, n_s, active, ds0)
        if index + 1 == record_k.shape[0] or record_k[index + 1] != k:
            tell_rows(ds, put, states[k + 1])
            tell_rows(rhs, put, unknowns[k + 1])
    return states, unknowns


@njit(types.float64[:, :, ::1](KERNEL, F2, F2, F2, F1, F3, F3, I1, I1, F3, I2, I1, types.int64), **OPTIONS)
def output_sensitivities(
    kernel, states, unknowns, inputs, p, dstates, dunknowns, columns, put, dinputs, support, which, n_out
):
    """Total derivatives of the outputs ``which`` at every sample, shape (len(which), n, n_c).

    ``kernel`` writes the partial derivatives in s, w, p and u, (n_out, n_s + n_w + n_p + n_u); dinputs is du/dc of
    the last entries of c, shape (n_directions, n, recorded inputs), by the interval where each first acts; dstates and
    dunknowns are those of :func:`propagate`.
    """
    n, n_s, n_w, n_p, n_u = states.shape[0], states.shape[1], unknowns.shape[1], p.shape[0], inputs.shape[1]
    n_c = columns.shape[0]
    first, width = n_c - dinputs.shape[0], n_s + n_w + n_p + n_u
    result = np.zeros((len(which), n, n_c))
    out = np.zeros(n_out * width)
    begin = 0
    for k in range(n):
        kernel(states[k], unknowns[k], inputs[k], p, out)
        while begin < dinputs.shape[0] and k > support[begin, 1] + 1:
            begin += 1
        for i in range(len(which)):
            row = which[i] * width
            for d in range(n_s):
                for c in range(n_c):
                    result[i, k, c] += out[row + d] * dstates[k, d, c]
            for d in range(n_w):
                for c in range(n_c):
                    result[i, k, c] += out[row + n_s + d] * dunknowns[k, d, c]
            for c in range(first):
                if columns[c] >= 0:
                    result[i, k, c] += out[row + n_s + n_w + columns[c]]
            for j in range(begin, dinputs.shape[0]):
                if k < support[j, 0]:
                    break
                if k <= support[j, 1] + 1:
                    for d in range(dinputs.shape[2]):
                        result[i, k, put[first + j]] += out[row + n_s + n_w + n_p + d] * dinputs[j, k, d]
    return result
