"""Viscous friction, for a law without it."""

from ..effect import Effect, strength


class Viscous(Effect):
    """F = F_law + viscous v; for laws without sigma_2 (where there is none, see friction).

    Units: viscous in force per slip velocity.
    Neutral: viscous = 0.
    Occurs: in every lubricated contact and bearing.
    Experiment: constant speeds: the force climbs linearly with speed.
    """

    name = "viscous"
    parameters = (strength("viscous", "{F}*s/{L}", "viscous friction", 0.0),)

    def applies(self, system, law, others=()):
        return bool(law.parameters) and not any(par.name == "sigma_2" for par in law.parameters)

    def force(self, c, p, law):
        return p.viscous * c.v
