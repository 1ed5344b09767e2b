"""A force that is periodic in time."""

import sympy as sp

from ..effect import Effect, hidden, strength
from ..scan import Scan


class Vibration(Effect):
    """F = F_law + vibration_sin sin(2 pi f t) + vibration_cos cos(2 pi f t) with f = vibration_frequency.

    t is the time of each trial as recorded: pauses between trials are seldom known to a fraction of a period.

    Units: amplitudes in the system's unit of force, vibration_frequency in Hz.
    Neutral: vibration_sin = 0, vibration_cos = 0.
    Occurs: with machines nearby, unbalanced rotors, mains hum.
    Experiment: a recording at rest or at constant speed, much longer than a period.
    """

    name = "vibration"
    parameters = (
        strength("vibration_sin", "{F}", "sine amplitude"),
        strength("vibration_cos", "{F}", "cosine amplitude"),
        hidden("vibration_frequency", "Hz", "frequency", 1.0, Scan("frequency", 1, 100, 199, "linear")),
    )

    def force(self, c, p, law):
        phase = 2 * sp.pi * p.vibration_frequency * c.t
        return p.vibration_sin * sp.sin(phase) + p.vibration_cos * sp.cos(phase)
