"""Drag that grows with the square of velocity."""

import sympy as sp

from ..effect import Effect, strength


class Drag(Effect):
    """F = F_law + drag v |v|.

    Units: drag in force per slip velocity squared.
    Neutral: drag = 0.
    Occurs: in air and water, with churned lubricant.
    Experiment: fast free motion: the decay is quicker at first than viscous friction explains.
    """

    name = "drag"
    parameters = (strength("drag", "{F}*s^2/{L}^2", "drag coefficient", 0.0),)

    def force(self, c, p, law):
        return p.drag * c.v * sp.Abs(c.v)
