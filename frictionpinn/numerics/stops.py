"""Stops moved past samples: the walls of a likelihood whose motion has jumps.

A stop that comes a sample late costs the whole jump of the acceleration there, and no derivative tells: the cost is
smooth between two samples, and has a wall at each. How well the rest of a trial tells the time of a stop is known, and
what the samples cost that it would pass, too: where these promise to gain, the trial's own unknowns are moved the
cheapest way that shifts the stops so far,

    dx = C G' (G C G')^-1 d,

with C their covariance, the samples beside the jumps left out, G the derivatives of the stops' times and d the shifts.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg.lapack import dposv

from .quadratic import Evaluate, Piece, State

REACH = 4.0  # standard errors of a stop's time by which it is moved
LEAST = 1e-6  # samples: standard error of a stop's time that nothing moves
SHARES = (1.0, 0.75, 0.5)  # of such a change that are tried: what nearly stops goes farther than its derivatives say
ROUNDS = 50  # of moves, and in which the shifts of a trial's stops are chosen beside one another: a budget


def past_stops(evaluate: Evaluate, at: State, least: float) -> State | None:
    """The state with stops of every trial moved as long as one gains by it, as simulated; None where none does.

    Args:
        evaluate: the cost.
        at: with derivatives.
        least: gain of a trial in log-likelihood that counts.
    """
    before, found = None, at
    for _ in range(ROUNDS):
        if (moved := _moved(evaluate, found, before, least)) is None:
            break
        before, found = found, moved
    return None if found is at else found


def _moved(evaluate: Evaluate, at: State, before: State | None, least: float) -> State | None:
    """The state with those moved of every trial that gain most, if it was moved since ``before``: of others nothing
    gains; None where none does."""
    last = before.locals if before else [None] * len(at.locals)
    ways = [[] if x is old else [share * way for way in _ways(piece, least) for share in SHARES]
            for piece, x, old in zip(at.pieces, at.locals, last, strict=True)]  # fmt: skip
    best, locals_ = list(at.pieces), list(at.locals)
    for k in range(max(map(len, ways), default=0)):
        own = [x + way[k] if k < len(way) else x for x, way in zip(at.locals, ways, strict=True)]
        there = evaluate(at.u, own, False, beside=at)
        for i, piece in enumerate(there.pieces if there else ()):
            if piece.cost < best[i].cost - least:
                best[i], locals_[i], ways[i] = piece, own[i], []
    if all(x is old for x, old in zip(locals_, at.locals, strict=True)):
        return None
    return evaluate(at.u, locals_, True, beside=at)


def _ways(piece: Piece, least: float) -> list[np.ndarray]:
    """Changes of a trial's own unknowns that promise to gain, the best first: all stops moved, and each alone."""
    if piece.smooth is None:
        return []
    information, gradient = piece.smooth
    scale = 1 / np.sqrt(np.maximum(information.diagonal(), np.finfo(float).tiny))
    G = np.stack([jump.slopes for jump in piece.jumps])
    X, fault = dposv(information * scale[:, None] * scale, (G * scale).T)[1:]
    if fault or not np.isfinite(X).all():
        return []
    X = X * scale[:, None]  # C G'
    open_ = np.sum(G.T * X, axis=0) > LEAST**2
    jumps, G, X = [jump for jump, o in zip(piece.jumps, open_, strict=True) if o], G[open_], X[:, open_]
    if not jumps:
        return []
    V, b = G @ X, gradient @ X
    tables = [jump.costs(v**0.5, REACH) for jump, v in zip(jumps, V.diagonal(), strict=True)]
    found = []
    for k, (shifts, costs) in enumerate(tables):
        costs = costs + (b[k] * shifts + shifts**2 / 2) / V[k, k]
        found.append((costs.min(), X[:, k] * shifts[np.argmin(costs)] / V[k, k]))
    S, d = np.linalg.pinv(V), np.zeros(len(jumps))
    for _ in range(ROUNDS):
        before = d.copy()
        for k, (shifts, costs) in enumerate(tables):
            pull = S[k] @ (b + d) - S[k, k] * d[k]
            d[k] = shifts[np.argmin(costs + S[k, k] * shifts**2 / 2 + pull * shifts)]
        if np.all(d == before):
            break
    cost = sum(float(costs[shifts == x][0]) for (shifts, costs), x in zip(tables, d, strict=True))
    found.append((cost + (b + d / 2) @ S @ d, X @ (S @ d)))
    return [step for gain, step in sorted(found, key=lambda pair: pair[0]) if gain < -least]
