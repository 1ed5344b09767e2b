"""No friction, for a contact that has none or whose friction is still to be found."""

import sympy as sp

from ..base import FrictionLaw


class NoFriction(FrictionLaw):
    """F = 0."""

    name = "none"

    def capacity(self, c, p):
        return sp.Integer(0)

    def force(self, c, p):
        return sp.Integer(0)
