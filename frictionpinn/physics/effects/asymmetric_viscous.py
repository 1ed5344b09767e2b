"""Viscous friction that differs by direction."""

import sympy as sp

from ..effect import Effect, strength


class AsymmetricViscous(Effect):
    """F = F_law + asymmetric_viscous |v|: it adds to viscous friction forwards and lessens it backwards.

    Units: asymmetric_viscous in force per slip velocity.
    Neutral: asymmetric_viscous = 0.
    Occurs: in screws, gears, seals and check valves.
    Experiment: both directions at several constant speeds.
    """

    name = "asymmetric_viscous"
    parameters = (
        strength("asymmetric_viscous", "{F}*s/{L}", "half the difference of viscous friction forwards and backwards"),
    )

    def force(self, c, p, law):
        return p.asymmetric_viscous * sp.Abs(c.v)
