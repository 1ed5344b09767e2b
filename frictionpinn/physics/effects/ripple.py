"""Force or friction that is periodic in the position."""

import sympy as sp

from ..effect import Effect, hidden, strength
from ..scan import Scan


class Ripple(Effect):
    """F = F_law + ripple_sin sin(k s) + ripple_cos cos(k s) with k = 2 pi / ripple_wavelength, s the slip position, and
    the law sees N (1 + ripple_friction_sin sin(k s) + ripple_friction_cos cos(k s)).

    Units: ripple_sin, ripple_cos in the system's unit of force, ripple_friction_* dimensionless, ripple_wavelength in
    the unit of slip.
    Neutral: all four amplitudes = 0.
    Occurs: cogging of motors (a force, the same both ways), screws, gears and chains (friction, with its sign).
    Experiment: slow motion at constant speed over many wavelengths, both ways.
    """

    name = "ripple"
    parameters = (
        strength("ripple_sin", "{F}", "sine amplitude of a periodic force", group="force"),
        strength("ripple_cos", "{F}", "cosine amplitude of a periodic force", group="force"),
        strength("ripple_friction_sin", "1", "sine share of dry friction", -1.0, 1.0, group="friction"),
        strength("ripple_friction_cos", "1", "cosine share of dry friction", -1.0, 1.0, group="friction"),
        hidden("ripple_wavelength", "{L}", "wavelength", 1e-2, Scan("stroke", 9e-3, 2.0, 222, "inverse")),
    )

    def applies(self, system, law, others=()):
        return system.slip_position is not None

    def load(self, N, c, p):
        phase = 2 * sp.pi * c.s / p.ripple_wavelength
        return N * (1 + p.ripple_friction_sin * sp.sin(phase) + p.ripple_friction_cos * sp.cos(phase))

    def force(self, c, p, law):
        phase = 2 * sp.pi * c.s / p.ripple_wavelength
        return p.ripple_sin * sp.sin(phase) + p.ripple_cos * sp.cos(phase)
