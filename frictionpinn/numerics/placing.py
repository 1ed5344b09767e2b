"""Where trials begin whose position acts but was not measured: what their motion and their forces say.

A velocity alone tells a position up to a constant q_0. A free coordinate's equation of motion tells it: where every
contact slides friction is nearly dry and viscous,

    E_i(q + q_0) + sum_k J_ki (mu_k F_N,k sign(v_k) + s_k v_k) = 0,    mu_k, s_k >= 0,

least squares in q_0 of each trial, of angles from all around the turn on: first with a friction of its own, then, where
a trial slides little and either half of the turn would do, with that of all trials together. A trial is placed where it
would come to rest; where it would fall only if its forces say so beyond chance: one in which nothing slides never does.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from itertools import product

import numpy as np
import sympy as sp
from scipy.optimize import least_squares, nnls

from ..physics.system import Coordinate, System
from .motion_function import motion_function, sliding_friction
from .whiteness import SIGNIFICANCE, correlation_time

AROUND = 12  # places around a turn, from the best of which the search begins: two valleys are half a turn apart
SLIDING = 0.15  # of the largest slip velocity: faster counts as sliding
MOST = 2000  # sliding samples of a trial that are looked at, spread evenly: a start needs no more
NEAR = 1e-3  # rad or m: by how much a position is moved to see what drives it back

Signals = Mapping[str, np.ndarray]


def unplaced(system: System, recorded: Collection[str]) -> list[Coordinate]:
    """Free coordinates whose position takes part in what moves them, and is not among the ``recorded`` signals."""
    free = () if system.massless else system.free  # an imposed motion is as it was measured
    return [c for c in free if c.symbols[0] in system.acting and c.signals[0] not in recorded]


def placed(
    system: System, trials: Sequence[Signals], recorded: Sequence[Collection[str]], declared: Mapping[str, float | None]
) -> list[dict[str, np.ndarray]]:
    """The positions of the coordinates that are :func:`unplaced`, shape (n,), SI units, where the forces put them.

    Args:
        system: with all its contacts.
        trials: smoothed signals by name, shape (n,), SI units; positions that were not measured begin anywhere.
        recorded: signals of each trial that were measured.
        declared: parameters of the system, SI units; 1 where there is no value.
    """
    lost = [unplaced(system, names) for names in recorded]
    if not any(lost):
        return [{} for _ in trials]
    values = {name: 1.0 if value is None else value for name, value in declared.items()}
    rows, masks = _rows(system), _sliding(system, trials, values)
    seen = [_some(signals, mask if mask.any() else ~mask) for signals, mask in zip(trials, masks, strict=True)]

    def forces(k: int, offsets: np.ndarray) -> np.ndarray:
        """E and friction of unit coefficients of a trial, shape (equations, 1 + coefficients, m)."""
        signals = dict(seen[k])
        for c, offset in zip(lost[k], offsets, strict=True):
            signals[c.signals[0]] = signals[c.signals[0]] + offset
        return np.array([[f(signals, values) for f in row] for row in rows])

    begun = [forces(k, np.zeros(len(own))) for k, own in enumerate(lost)]
    scale = np.maximum(np.std(np.concatenate(begun, axis=2)[:, :1], axis=2, keepdims=True), 1e-12)

    def balance(k: int, offsets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The equations of a trial one below another: E, shape (n,), and friction, shape (n, coefficients)."""
        stacked = np.concatenate(forces(k, offsets) / scale, axis=1)
        return stacked[0], stacked[1:].T

    def rests(k: int, offsets: np.ndarray) -> bool:
        """Whether every lost coordinate is driven back to where it is."""
        places = [system.free.index(c) for c in lost[k]]
        steps = NEAR * np.eye(len(offsets))
        return all(np.mean(forces(k, offsets + step)[i, 0] - forces(k, offsets - step)[i, 0]) > 0
                   for i, step in zip(places, steps, strict=True))  # fmt: skip

    def place(k: int, friction: np.ndarray | None) -> np.ndarray:
        """Offsets of a trial's lost positions, with its own friction or one that is given."""

        def left(offsets: np.ndarray) -> np.ndarray:
            E, unit = balance(k, offsets)
            return E + unit @ (nnls(unit, -E)[0] if friction is None else friction)

        turn = np.linspace(0.0, 2 * np.pi, AROUND, endpoint=False)
        starts = [np.array(start) for start in product(*(turn if c.units[0] == "rad" else (0.0,) for c in lost[k]))]
        starts.sort(key=lambda start: float(np.sum(left(start) ** 2)))
        best = least_squares(left, starts[0])
        resting = next((start for start in starts if rests(k, start)), None)
        if resting is None or rests(k, best.x):
            return best.x
        still = least_squares(left, resting)
        looks = len(best.fun) / correlation_time([best.fun])
        better = looks / 2 * np.log(still.cost / max(best.cost, 1e-300))  # log-likelihood
        return best.x if better > -np.log(SIGNIFICANCE) else still.x

    alone = [place(k, None) if own else np.zeros(0) for k, own in enumerate(lost)]
    E, unit = map(np.concatenate, zip(*map(balance, range(len(trials)), alone), strict=True))
    friction = nnls(unit, -E)[0]
    offsets = [place(k, friction) if own else np.zeros(0) for k, own in enumerate(lost)]
    return [{c.signals[0]: signals[c.signals[0]] + offset for c, offset in zip(own, found, strict=True)}
            for signals, own, found in zip(trials, lost, offsets, strict=True)]  # fmt: skip


def _rows(system: System) -> list[list[Callable]]:
    """Of every free coordinate's equation over its inertia: E, then the friction of unit coefficients."""
    rows = []
    for c in system.free:
        E, unit = system.residual(c), []
        for view in system.each:
            unit += [view.jacobian[c.name] * sliding_friction(view, *pair) for pair in ((1.0, 0.0), (0.0, 1.0))]
        inertia = sp.diff(E, c.symbols[2])
        rows.append([motion_function(system, sp.sympify(e) / (inertia if inertia != 0 else 1)) for e in (E, *unit)])
    return rows


def _sliding(system: System, trials: Sequence[Signals], values: Mapping[str, float]) -> list[np.ndarray]:
    """Whether every contact slides at the samples of each trial, bool, shape (n,)."""
    slips = [[np.abs(motion_function(view, view.v_slip)(own, values)) for view in system.each] for own in trials]
    fast = [SLIDING * max(float(v.max()) for v in at) for at in zip(*slips, strict=True)]
    return [np.all([v > least for v, least in zip(at, fast, strict=True)], axis=0) for at in slips]


def _some(signals: Signals, mask: np.ndarray) -> Signals:
    """The samples of a mask, at most about ``MOST``."""
    at = np.flatnonzero(mask)
    return {name: x[at[:: max(len(at) // MOST, 1)]] for name, x in signals.items() if len(x) == len(mask)}
