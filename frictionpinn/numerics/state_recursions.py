"""Bristles in parallel along trials, and the gradient of what they give: compiled recursions with a hand-derived
reverse mode. What the bristles do at one instant and over one step tells :mod:`.parallel_bristles`.

Either the slip velocity w is imposed, or it moves: w' = A - mobility F, corrected at every sample towards the measured
one by the share ``gain * gate``, and begun anew at a start, wholly or by a share. A is that along a measured motion of
slip velocity u. Where the motion acts back on it (a pendulum's gravity, a drag), A + pull q + drag (w - u) takes its
place: q with q' = w - u is how far the contact has left that motion, pull and drag are the slopes of A in slip position
and slip velocity.
"""

from __future__ import annotations

import numpy as np

from .parallel_bristles import compiled, force_back, force_of, stretch, stretch_back


@compiled
def forward(along, z0, off, tables, grid, elements, gain, mobility, steps, moving, path):
    """Force, slip velocity (before it is corrected), states and q at every sample.

    Leapfrog: half a step of the states, steps of slip velocity (midpoint rule) and states in turn, half a step.

    Args:
        along: at every sample, shape (n,): slip velocity to follow, load, slip acceleration without friction, time to
            the next sample, share by which slip velocity and states start anew (1 where a trial begins, 0 where nothing
            starts), share of the correction, slip velocity u; pull and drag, shape (n, 2).
        z0, off: states at the starts, shape (trials, K); what is added to slip velocity and q there, shape (trials, 2).
        tables: T_1 .. T_K and r, shape (K + 1, velocities, loads).
        grid: see :func:`.parallel_bristles.place`.
        elements: rows kappa, c, gap, n, shape (4, K).
        steps: per sample.
        moving: whether the slip velocity moves.
        path: shape (n steps, K + 2), filled with slip velocity, states and q at every step, for :func:`backward`.

    Returns:
        force (n,), slip velocity (n,), states (n, K), q (n,), slip velocity with which each start is reached (trials,).
    """
    v, N, A, h, start, gate, u, slopes = along
    n, K = len(v), z0.shape[1]
    force, slip, states, left, reached = np.zeros(n), np.zeros(n), np.zeros((n, K)), np.zeros(n), np.zeros(len(z0))
    z, w, q, trial = np.zeros(K), 0.0, 0.0, -1
    for k in range(n):
        if start[k] > 0.0:
            trial += 1
            reached[trial] = w
            q = (1.0 - start[k]) * q + off[trial, 1]
            z[:] = (1.0 - start[k]) * z + start[k] * z0[trial]
            w = (1.0 - start[k]) * w + start[k] * v[k] + off[trial, 0]
        if not moving:
            w = v[k]
        force[k], slip[k], states[k], left[k] = force_of(w, N[k], z, tables, grid, elements), w, z, q
        if k + 1 == n or start[k + 1] == 1.0:
            continue
        if moving:
            w += gain * gate[k] * (v[k] - w)
        d = h[k] / steps
        more = (N[k + 1] - N[k]) / steps
        stretch(w, N[k], more / 2, z, tables, grid, elements, d / 2)
        for m in range(steps):
            path[k * steps + m, 0] = w
            path[k * steps + m, 1:-1] = z
            path[k * steps + m, -1] = q
            share, after = (m + 0.5) / steps, (m + 1.0) / steps
            if moving:
                load, (ahead, aside, pull, drag) = N[k] + (m + 0.5) * more, frictionless(A, u, slopes, k, share)
                free = ahead + pull * q + drag * w
                middle = w + d / 2 * (free - mobility * force_of(w, load, z, tables, grid, elements))
                free = ahead + pull * (q + d / 2 * (w - aside)) + drag * middle
                w += d * (free - mobility * force_of(middle, load, z, tables, grid, elements))
                q += d * (middle - aside)
            else:
                w = v[k] + after * (v[k + 1] - v[k])
            part = 1.0 if m + 1 < steps else 0.5
            stretch(w, N[k] + (m + 0.5) * more, part * more, z, tables, grid, elements, part * d)
    return force, slip, states, left, reached


@compiled
def backward(f_bar, v_bar, left_bar, along, z0, tables, grid, elements, gain, mobility, steps, moving, path, told):
    """Gradients of a scalar in z0, tables, elements, gain, A and off, from those in force, slip velocity and q, (n,).

    Others: as :func:`forward` took them; told: slip velocity, states and velocities reached, as it gave them.
    """
    v, N, A, h, start, gate, u, slopes = along
    slip, states, reached = told
    n, K = len(v), z0.shape[1]
    z0_bar, tables_bar = np.zeros_like(z0), np.zeros_like(tables)
    elements_bar, gain_bar, A_bar = np.zeros_like(elements), 0.0, np.zeros(n)
    off_bar = np.zeros((len(z0), 2))
    z_bar, w_bar, q_bar, trial = np.zeros(K), 0.0, 0.0, len(z0) - 1
    z = np.zeros(K)
    for k in range(n - 1, -1, -1):
        last = k + 1 == n or start[k + 1] == 1.0
        if last:
            z_bar[:] = 0.0
            w_bar = q_bar = 0.0
        else:
            d = h[k] / steps
            w, more = reached[trial + 1] if start[k + 1] > 0.0 else slip[k + 1], (N[k + 1] - N[k]) / steps
            for m in range(steps - 1, -1, -1):
                row, share = k * steps + m, (m + 0.5) / steps
                z[:] = path[row, 1:-1]
                load, part = N[k] + (m + 0.5) * more, 1.0 if m + 1 < steps else 0.5
                grads = (z_bar, tables_bar, elements_bar)
                w_bar += stretch_back(w, load, part * more, z, tables, grid, elements, part * d, *grads)
                w = path[row, 0]
                if moving:
                    ahead, _, pull, drag = frictionless(A, u, slopes, k, share)
                    known = (load, z, tables, grid, elements)
                    free = ahead + pull * path[row, -1] + drag * w
                    middle = w + d / 2 * (free - mobility * force_of(w, *known))
                    own = force_back(-d * mobility * w_bar, middle, *known, *grads) + d * (drag * w_bar + q_bar)
                    half = d * pull * w_bar  # in q at the middle
                    A_bar[k] += (1 - share) * d * (w_bar + own / 2)
                    A_bar[k + 1] += share * d * (w_bar + own / 2)
                    q_bar += half + d / 2 * pull * own
                    first = force_back(-d / 2 * mobility * own, w, *known, *grads)
                    w_bar += own + d / 2 * (drag * own + half) + first
            z[:] = states[k]
            w_bar += stretch_back(w, N[k], more / 2, z, tables, grid, elements, d / 2, z_bar, tables_bar, elements_bar)
            if moving:
                gain_bar += w_bar * gate[k] * (v[k] - slip[k])
                w_bar *= 1 - gain * gate[k]
        own = force_back(f_bar[k], slip[k], N[k], states[k], tables, grid, elements, z_bar, tables_bar, elements_bar)
        w_bar = w_bar + own + v_bar[k] if moving else 0.0
        q_bar += left_bar[k]
        if start[k] > 0.0:
            z0_bar[trial], off_bar[trial, 0], off_bar[trial, 1] = start[k] * z_bar, w_bar, q_bar
            z_bar *= 1.0 - start[k]
            w_bar *= 1.0 - start[k]
            q_bar *= 1.0 - start[k]
            trial -= 1
    return z0_bar, tables_bar, elements_bar, gain_bar, A_bar, off_bar


@compiled
def frictionless(A, u, slopes, k, share):
    """A - drag u, u, pull and drag at a share of the way to the next sample."""
    now, then = slopes[k], slopes[k + 1]
    aside, drag = u[k] + share * (u[k + 1] - u[k]), now[1] + share * (then[1] - now[1])
    return A[k] + share * (A[k + 1] - A[k]) - drag * aside, aside, now[0] + share * (then[0] - now[0]), drag
