"""Dry friction that falls or rises exponentially at low speed."""

import sympy as sp

from ..effect import Effect, hidden, strength
from ..scan import Scan


class LowSpeed(Effect):
    """The law sees N (1 + low_speed exp(-|v| / low_speed_scale)).

    Units: low_speed dimensionless, low_speed_scale in slip per second.
    Neutral: low_speed = 0.
    Occurs: in ball screws and recirculating bearings (friction falls towards rest), in mixed lubrication (it rises).
    Experiment: constant speeds from creep upwards.
    """

    name = "low_speed"
    parameters = (
        strength("low_speed", "1", "share by which dry friction changes towards rest", -1.0),
        hidden("low_speed_scale", "{L}/s", "speed over which it changes", 1e-2, Scan("speed", 3e-3, 0.5, 10)),
    )

    def load(self, N, c, p):
        return N * (1 + p.low_speed * sp.exp(-sp.Abs(c.v) / p.low_speed_scale))
