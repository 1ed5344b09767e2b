"""A gap in the presliding displacement."""

import sympy as sp

from ..effect import Effect, hidden, strength
from ..scan import Scan


class Backlash(Effect):
    """The bristle makes its force from z + (sqrt((z - gap)^2 + w^2) - sqrt((z + gap)^2 + w^2)) / 2 instead of z.

    That is a dead zone of half width gap = backlash_gap, rounded over w = backlash_width. For laws with a bristle, or
    beside the effect presliding.

    Units: both in the unit of slip.
    Neutral: backlash_gap = 0.
    Occurs: with pins, keys, gears and bands that have play between the contact and the body.
    Experiment: reversals at several amplitudes: after each the force stays near zero over twice the gap.
    """

    name = "backlash"
    # From a hundred-thousandth of the stroke, as little as a bristle bends; rounded over a tenth of that it is sharp.
    parameters = (
        strength("backlash_gap", "{L}", "half of the gap", 0.0, scan=Scan("stroke", 1e-5, 0.3, 5)),
        hidden("backlash_width", "{L}", "rounding of the dead zone", 1e-6, Scan("stroke", 1e-6, 3e-2, 6)),
    )

    def applies(self, system, law, others=()):
        return law.memory or "presliding" in others

    def deflection(self, z, p):
        gap, w = p.backlash_gap, p.backlash_width
        return z + (sp.sqrt((z - gap) ** 2 + w**2) - sp.sqrt((z + gap) ** 2 + w**2)) / 2
