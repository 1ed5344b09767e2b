"""The smoothed motion of a trial, and what follows from it before any simulation: slip, normal force, sliding."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import sympy as sp
from scipy.integrate import cumulative_trapezoid
from scipy.signal import find_peaks

from ..physics.mechanism import Mechanism
from ..physics.system import System
from .motion_function import motion_function
from .placing import SLIDING, placed
from .smoothing import Coordinate
from .spline_basis import smooth_together

CLEAR = 4.0  # and of the velocity's noise, in standard deviations
SHORTEST_WINDOW = 24  # samples in a window between two peaks of the slip velocity


@dataclass(frozen=True)
class Motion:
    """Smoothed signals of one trial, and what follows from them.

    Attributes:
        mechanism, t: what moves, and times, s, shape (n,).
        signals: name -> samples, shape (n,), SI units: free and driven coordinates and inputs.
        slips: contact -> slip velocity, shape (n,).
        fast: samples at which every contact slides for certain, shape (n,), bool.
        pace: slip velocity, shape (n,); with several contacts the least of them, in units of what is usual there.
    """

    mechanism: Mechanism
    t: np.ndarray
    signals: dict[str, np.ndarray]
    slips: dict[str, np.ndarray]
    fast: np.ndarray
    pace: np.ndarray

    @property
    def v_slip(self) -> np.ndarray:
        """Slip velocity at the only contact, shape (n,)."""
        (v_slip,) = self.slips.values()
        return v_slip

    def at(self, contact: str) -> Motion:
        """The motion as one contact sees it."""
        return replace(self, slips={contact: self.slips[contact]})

    @property
    def _system(self) -> System:
        (contact,) = self.slips
        return self.mechanism.system.at(contact)

    @property
    def edges(self) -> list[int]:
        """Samples between which a window holds one stretch of low speed: peaks of the slip velocity, and the ends."""
        speed, last = np.abs(self.pace), len(self.pace) - 1
        peaks, _ = find_peaks(np.where(self.fast, speed, 0.0), distance=SHORTEST_WINDOW)
        return [0, *(int(k) for k in peaks if SHORTEST_WINDOW <= k <= last - SHORTEST_WINDOW), last]

    @property
    def normal(self) -> np.ndarray:
        """Normal force, shape (n,), as far as the motion tells it."""
        return self._samples(self._system.N)

    @property
    def position(self) -> np.ndarray:
        """Slip position, shape (n,); the integral of the slip velocity where no expression gives it."""
        position = self._system.slip_position
        if position is None:
            return cumulative_trapezoid(self.v_slip, self.t, initial=0.0)
        return self._samples(position)

    def _samples(self, expr: sp.Expr) -> np.ndarray:
        return motion_function(self.mechanism.system, expr)(self.signals, typical(self.mechanism))


def smoothed(
    mechanism: Mechanism,
    times: Sequence[np.ndarray],
    inputs: Sequence[Mapping[str, np.ndarray]],
    outputs: Sequence[Mapping[str, np.ndarray]],
    sigmas: Mapping[str, float],
) -> list[Motion]:
    """Trials with free coordinates smoothed by splines, the inputs as they are given; positions that act and were not
    measured begin where the forces put them (:mod:`frictionpinn.numerics.placing`).

    Args:
        mechanism: what moves.
        times: of every trial, s.
        inputs, outputs: name -> samples of every trial, SI units; NaN where an output is missing.
        sigmas: noise standard deviations by signal, SI units.
    """
    signals = [dict(own) for own in inputs]
    if mechanism.system.massless:  # the force of an imposed motion is measured, not an input
        for own, rows in zip(signals, outputs, strict=True):
            own.update({name: np.nan_to_num(y) for name, y in rows.items()})
    for c in mechanism.free:
        data: list[Coordinate] = [
            (t, rows.get(c.signals[0]), rows.get(c.signals[1]), rows.get(c.signals[2]))
            for t, rows in zip(times, outputs, strict=True)
        ]
        for own, smooth in zip(signals, smooth_together(data, [sigmas.get(name) for name in c.signals]), strict=True):
            own.update(zip(c.signals, smooth[:3], strict=True))
    usual = typical(mechanism)
    recorded = [{name for name, y in rows.items() if np.isfinite(y).any()} for rows in outputs]
    for own, positions in zip(signals, placed(mechanism.system, signals, recorded, usual), strict=True):
        own.update(positions)
    slips = [
        {c.name: motion_function(c.system, c.system.v_slip)(own, usual) for c in mechanism.contacts} for own in signals
    ]
    noise = max([sigmas[c.signals[1]] for c in mechanism.free if c.signals[1] in sigmas], default=0.0)
    fast, paces = [np.ones(len(t), bool) for t in times], [np.full(len(t), np.inf) for t in times]
    for contact in mechanism.contacts:
        largest = max(float(np.quantile(np.abs(v[contact.name]), 0.99)) for v in slips)
        threshold = max(SLIDING * largest, min(CLEAR * noise, 0.5 * largest))
        for k, v in enumerate(slips):
            own = v[contact.name] if len(v) == 1 else v[contact.name] / (largest or 1.0)
            fast[k] &= np.abs(v[contact.name]) > threshold
            paces[k] = np.where(np.abs(own) < np.abs(paces[k]), own, paces[k])
    parts = zip(times, signals, slips, fast, paces, strict=True)
    return [Motion(mechanism, *part) for part in parts]


def typical(mechanism: Mechanism) -> dict[str, float]:
    """Values of all parameters, 1 where one has none."""
    values = {par.name: par.value for par in mechanism.parameters} | mechanism.system.values
    return {name: 1.0 if value is None else float(value) for name, value in values.items()}
