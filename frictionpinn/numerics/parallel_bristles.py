"""Bristles in parallel at one instant and over one step: compiled, with the transposes that a gradient needs.

Every element has a state z_k (m, the deflection of a bristle with play), and all share slip velocity w and load N:

    z_k' = w - |w| sgn(z_k) (|z_k| / s_k)^n_k,        s_k = gap_k + N T_k(w, N)
    F    = sum_k kappa_k dead(z_k, gap_k) + damp(c_k z_k')  +  w r(w, N)

with dead(z, gap) = sgn(z) max(|z| - gap, 0). T and r, both positive, are tables. n = 1 without a gap is the bristle of
LuGre friction, n to infinity Maxwell slip; a gap is backlash. The damping gives back at most what the slip of the same
bristle takes, |damp| <= kappa_k |dead| (|z_k| / s_k)^n_k while z_k' w < 0: no closed cycle of motion gives energy,

    F w = d/dt sum_k kappa_k max(|z_k| - gap_k, 0)^2 / 2
          + sum_k (kappa_k |dead| |w| (|z_k| / s_k)^n_k + damp w)  +  w^2 r.

z is stepped exactly where n = 1, at a held w; with (|z|/s)^(n-1) held over a step otherwise, but no further than to
sgn(w) s, where it settles.

Throughout w is slip velocity, N load, z the states, shape (K,); tables T_1 .. T_K and r, shape (K + 1, velocities,
loads), over the grid of :func:`place`; elements rows kappa, c, gap, n, shape (4, K).
"""

from __future__ import annotations

import numpy as np
from numba import njit

compiled = njit(cache=True, error_model="numpy")  # what no bristle can be (T = 0) gives no number, and no error
SMALL = 1e-4  # below it (1 - exp(-x)) / x and its derivative are taken from their series


@compiled
def place(grid, w, N):
    """Position on the knots of w, its slope, that on those of N. grid: v0, first asinh(w / v0), step, first N, step."""
    position = (np.arcsinh(w / grid[0]) - grid[1]) / grid[2]
    slope = 1.0 / (np.sqrt(w * w + grid[0] * grid[0]) * grid[2])
    load = (N - grid[3]) / grid[4]
    return position, slope, load


@compiled
def cell(position, count):
    """Cell and share of a position on a line of knots, held at the ends; whether it lies inside."""
    inside = 0.0 < position < count - 1.0
    position = min(max(position, 0.0), count - 1.0)
    i = min(int(position), count - 2)
    return i, position - i, inside


@compiled
def look(table, i, x, j, y):
    """Bilinear interpolation, and its derivative in x."""
    low = (1 - y) * table[i, j] + y * table[i, j + 1]
    high = (1 - y) * table[i + 1, j] + y * table[i + 1, j + 1]
    return low + x * (high - low), high - low


@compiled
def spread(into, i, x, j, y, amount):
    """Transpose of :func:`look`."""
    into[i, j] += (1 - x) * (1 - y) * amount
    into[i, j + 1] += (1 - x) * y * amount
    into[i + 1, j] += x * (1 - y) * amount
    into[i + 1, j + 1] += x * y * amount


@compiled
def power(b, n):
    """b^n for b >= 0; 0 at b = 0."""
    if n == 1.0:
        return b
    return b**n if b > 0.0 else 0.0


@compiled
def force_of(w, N, z, tables, grid, elements):
    """F of slip velocity, load and states, see above."""
    position, _, height = place(grid, w, N)
    i, x, _ = cell(position, tables.shape[1])
    j, y, _ = cell(height, tables.shape[2])
    K = len(z)
    r, _ = look(tables[K], i, x, j, y)
    total = w * r
    for e in range(K):
        T, _ = look(tables[e], i, x, j, y)
        gap = elements[2, e]
        side, size = np.sign(z[e]), abs(z[e])
        bn = power(size / (gap + N * T), elements[3, e])
        rate = w - abs(w) * side * bn
        spring, damping = elements[0, e] * max(size - gap, 0.0), elements[1, e] * rate
        if rate * w < 0.0 and abs(damping) > spring * bn:
            damping = -side * spring * bn
        total += side * spring + damping
    return total


@compiled
def force_back(f, w, N, z, tables, grid, elements, z_bar, tables_bar, elements_bar):
    """Adds f dF to the gradients in states, tables and elements; returns that in the slip velocity."""
    position, slope, height = place(grid, w, N)
    i, x, inside = cell(position, tables.shape[1])
    j, y, _ = cell(height, tables.shape[2])
    slope = slope if inside else 0.0
    K = len(z)
    r, along = look(tables[K], i, x, j, y)
    w_bar = f * (r + w * along * slope)
    spread(tables_bar[K], i, x, j, y, f * w)
    for e in range(K):
        T, along = look(tables[e], i, x, j, y)
        kappa, c, gap, n = elements[:, e]
        side, size, speed = np.sign(z[e]), abs(z[e]), abs(w)
        s = gap + N * T
        b = size / s
        bn = power(b, n)
        rate = w - speed * side * bn
        s_bar = 0.0
        bound = rate * w < 0.0 and c * abs(rate) > kappa * max(size - gap, 0.0) * bn
        spring_bar = f * side * (1 - bn) if bound else f * side
        if size > gap:
            z_bar[e] += spring_bar * kappa * side
            elements_bar[0, e] += spring_bar * (size - gap)
            elements_bar[2, e] -= spring_bar * kappa
        if bound:
            bn_bar = -f * side * kappa * max(size - gap, 0.0)
        else:
            elements_bar[1, e] += f * rate
            w_bar += f * c * (1 - np.sign(w) * side * bn)
            bn_bar = -f * c * speed * side
        if b > 0.0:
            elements_bar[3, e] += bn_bar * bn * np.log(b)
            b_bar = bn_bar * n * bn / b
            z_bar[e] += b_bar * side / s
            s_bar -= b_bar * b / s
        elements_bar[2, e] += s_bar
        spread(tables_bar[e], i, x, j, y, s_bar * N)
        w_bar += s_bar * N * along * slope
    return w_bar


@compiled
def stretch(w, N, more, z, tables, grid, elements, d):
    """Moves the states on by d, in place: slip velocity of the middle, a load that goes from N to N + more."""
    position, _, height = place(grid, w, N)
    i, x, _ = cell(position, tables.shape[1])
    j, y, _ = cell(height, tables.shape[2])
    for e in range(len(z)):
        T, _ = look(tables[e], i, x, j, y)
        gap, n = elements[2, e], elements[3, e]
        s = gap + seen_load(N, more, abs(w) * d / (gap + N * T)) * T
        X = abs(w) * d / s
        if n != 1.0:
            X *= power(abs(z[e]) / s, n - 1.0)
        E = np.exp(-X)
        after, end = z[e] * E + w * d * ((1 - E) / X if X > SMALL else 1 - X / 2), np.sign(w) * s
        z[e] = end if overshoots(z[e], after, end, n) else after


@compiled
def stretch_back(w, N, more, z, tables, grid, elements, d, z_bar, tables_bar, elements_bar):
    """Turns the gradient in the states after :func:`stretch` into that in those before, z; returns that in w.

    The share of the load that :func:`seen_load` gives is held.
    """
    position, slope, height = place(grid, w, N)
    i, x, inside = cell(position, tables.shape[1])
    j, y, _ = cell(height, tables.shape[2])
    w_bar = 0.0
    for e in range(len(z)):
        T, along = look(tables[e], i, x, j, y)
        gap, n = elements[2, e], elements[3, e]
        load = seen_load(N, more, abs(w) * d / (gap + N * T))
        s = gap + load * T
        b = abs(z[e]) / s
        X = abs(w) * d / s
        if n != 1.0:
            X *= power(b, n - 1.0)
        E = np.exp(-X)
        P = (1 - E) / X if X > SMALL else 1 - X / 2
        bend = (E - P) / X if X > SMALL else -0.5 + X / 3
        g, end = z_bar[e], np.sign(w) * s
        if overshoots(z[e], z[e] * E + w * d * P, end, n):
            z_bar[e], s_bar = 0.0, np.sign(w) * g
        else:
            own = g * (w * d * bend - z[e] * E) * X  # in ln X
            w_bar += g * d * P + (own / w if w != 0.0 else 0.0)
            z_bar[e] = g * E
            if b > 0.0:
                elements_bar[3, e] += own * np.log(b)
                z_bar[e] += own * (n - 1.0) / z[e]
            s_bar = -own * n / s
        elements_bar[2, e] += s_bar
        spread(tables_bar[e], i, x, j, y, s_bar * load)
        if inside:
            w_bar += s_bar * load * along * slope
    return w_bar


@compiled
def seen_load(N, more, X):
    """Load that a state follows over a step in which the load goes from N to N + more and X is |w| d / s.

    For n = 1 exact: the middle of a short step; the end of one in which the state settles, or F would err by c times
    the lag.
    """
    if X < SMALL:
        return N + more / 2
    E = np.exp(-X)
    return N + more * (1 - (1 - E) / X) / (1 - E)


@compiled
def overshoots(before, after, end, n):
    """Whether a state goes beyond the one in which it settles: it would, by far, in a step many times its reach."""
    return n != 1.0 and (after - end) * (before - end) < 0.0


@compiled
def rates_of(w, N, z, tables, grid, elements, out):
    """Writes F and z' of slip velocity, load and states, shape (K + 1,)."""
    position, _, height = place(grid, w, N)
    i, x, _ = cell(position, tables.shape[1])
    j, y, _ = cell(height, tables.shape[2])
    out[0] = force_of(w, N, z, tables, grid, elements)
    for e in range(len(z)):
        T, _ = look(tables[e], i, x, j, y)
        b = abs(z[e]) / (elements[2, e] + N * T)
        out[1 + e] = w - abs(w) * np.sign(z[e]) * power(b, elements[3, e])


@compiled
def reach_of(w, N, tables, grid, elements, out):
    """Writes s of every element, shape (K,)."""
    position, _, height = place(grid, w, N)
    i, x, _ = cell(position, tables.shape[1])
    j, y, _ = cell(height, tables.shape[2])
    for e in range(len(out)):
        T, _ = look(tables[e], i, x, j, y)
        out[e] = elements[2, e] + N * T
