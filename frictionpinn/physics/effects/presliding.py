"""Presliding, for a law without memory: friction that builds up over a displacement."""

from dataclasses import replace

import sympy as sp

from ..base import CONTACT
from ..effect import Effect, direction, hidden, strength
from ..scan import Scan


class Presliding(Effect):
    """F = F_law + presliding (k z - g sign(v)), z' = v - |v| k z / g with k = g(0, N) / presliding_length.

    g is the law's dry friction. The share ``presliding`` of it follows a bristle of stiffness k instead of the sign of
    the velocity: at 1 it is Dahl's model. Only for laws without memory.

    Units: presliding dimensionless, z and presliding_length in the unit of slip.
    Neutral: presliding = 0.
    Occurs: in every contact at reversals: micrometres in metal on metal, millimetres in bands and rubber.
    Experiment: small reversals, and force ramps below breakaway: force against displacement is a hysteresis loop.
    """

    name = "presliding"
    memory = True
    signed = True
    parameters = (
        strength("presliding", "1", "share of dry friction that builds up over a displacement", 0.0, 1.0),
        hidden("presliding_length", "{L}", "displacement over which it builds up", 1e-5, Scan("stroke", 1e-4, 0.5, 14)),
    )

    def applies(self, system, law, others=()):
        return not law.memory

    def bristle_rate(self, c, p, law):
        return c.v - sp.Abs(c.v) * self._stiffness(p, law) * c.z / law.capacity(c, p)

    def force(self, c, p, law):
        return p.presliding * (self._stiffness(p, law) * c.z - law.capacity(c, p) * direction(c, p))

    def _stiffness(self, p, law):
        """Without what other effects do to the load, lest the force jump with them at a reversal."""
        return law.capacity(replace(CONTACT, v=sp.Integer(0)), p) / p.presliding_length
