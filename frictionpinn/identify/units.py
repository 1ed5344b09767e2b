"""How large a parameter is on this data: the unit in which one that may be zero is searched, and where it starts."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from scipy.integrate import cumulative_trapezoid

from ..physics.base import Parameter
from ..physics.mechanism import Mechanism
from ..physics.scan import Scan, data_scales
from .motion import Motion, _defaults, _function

FACTOR = re.compile(r"([*/]?)(\{?[A-Za-z]+\}?|1)(?:\^(\d+))?")
NUDGE = 0.3  # of its size: where a strength starts whose effect has a shape to find as well


class Sizes:
    """Orders of magnitude of force, slip, speed and time in a recording, and of parameters that follow from them.

    Args:
        mechanism: the model.
        motions: smoothed trials.
        force: dry friction force, in the system's unit of force.
    """

    def __init__(self, mechanism: Mechanism, motions: Sequence[Motion], force: float):
        self.mechanism = mechanism
        t, speed = [m.model.t for m in motions], [m.v_slip for m in motions]
        place = [_position(mechanism, m) for m in motions]
        load = [np.ones(1) * mean_load(motions)]
        self.scales = data_scales(t, place, speed, load)
        stroke = self.scales["stroke"][1] or 1.0
        velocity = float(np.sqrt(np.mean(np.concatenate(speed) ** 2))) or 1.0
        time, turns = stroke / velocity, mechanism.system.slip_unit == "rad"
        length = 1.0 if turns else stroke  # a rotating system's lengths are levers
        self.base = {
            "1": 1.0, "s": time, "Hz": 1 / time, "m": length, "rad": stroke if turns else 1.0, "N": force,
            "{F}": force, "{L}": stroke, "kg": force * time**2 / (length if not turns else stroke),
        }  # fmt: skip

    def of_unit(self, unit: str) -> float:
        """Size of a quantity with this unit, as in :class:`Parameter`."""
        result = 1.0
        for sign, name, power in FACTOR.findall(unit):
            result *= self.base[name] ** (int(power or 1) * (-1 if sign == "/" else 1))
        return result

    def of(self, par: Parameter) -> float:
        """Size of a parameter: of the values that its effect would scan, else of its unit."""
        size = self.of_unit(par.unit)
        if par.scan is not None:
            low, high = self.ends(par.scan)
            size = (high - low) / 4 if par.scan.spacing == "linear" else float(np.sqrt(low * high))
        return min(size, par.high) if par.high > 0 else size

    def ends(self, scan: Scan) -> tuple[float, float]:
        """Least and largest value of a scan, SI units."""
        values = scan.values(self.scales)
        return float(values[0]), float(values[-1])

    def start(self, par: Parameter, shaped: bool) -> float:
        """Where a parameter of an effect starts: the middle of its scan, the neutral value, or a little beside that."""
        if par.scan is not None and par.hidden:
            low, high = self.ends(par.scan)
            return (low + high) / 2 if par.scan.spacing == "linear" else float(np.sqrt(low * high))
        if par.neutral is None:
            return float(par.value or 1.0)
        return par.neutral + (NUDGE * self.of(par) if shaped else 0.0)


def shaped(mechanism: Mechanism, names: Sequence[str]) -> frozenset[str]:
    """Strengths of effects of which a hidden parameter is free too: at the neutral value it would not show."""
    result: set[str] = set()
    for effect in mechanism.effects:
        own = effect.parameters_on(mechanism.system, mechanism.law)
        if any(par.hidden and par.name in names for par in own):
            result |= {par.name for par in own if not par.hidden}
    return frozenset(result)


def mean_load(motions: Sequence[Motion]) -> float:
    """Mean normal force."""
    mechanism = motions[0].model.simulator.mechanism
    f, p = _function(mechanism, mechanism.system.N), _defaults(mechanism)
    return max(float(np.mean([np.mean(np.abs(f(motion.signals, p))) for motion in motions])), 1e-12)


def _position(mechanism: Mechanism, motion: Motion) -> np.ndarray:
    """Slip position of a trial; the integral of the slip velocity where no expression gives it."""
    position = mechanism.system.slip_position
    if position is None:
        return cumulative_trapezoid(motion.v_slip, motion.model.t, initial=0.0)
    return _function(mechanism, position)(motion.signals, _defaults(mechanism))
