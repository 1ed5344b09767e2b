"""A friction damper on a test bench: its motion is imposed, its force is measured."""

from ..base import Parameter
from ..system import Coordinate, Input, System


class Damper(System):
    """0 = force - F_f: the measured force is the friction force, no inertia takes part.

    ``preload`` is 1 N by default, so that a friction coefficient reads as the friction force in newtons.

    Units: m, N, s. Source: Coble et al., banded rotary friction damper data set.
    """

    name = "damper"
    title = "friction damper"
    massless = True
    coordinates = (Coordinate("x", ("x", "v", "a")),)
    inputs = (Input("force", "N", "measured force"),)
    parameters = (Parameter("preload", "N", "normal force of the contact", 1.0),)

    def applied(self, s, p):
        return {"x": s.force}

    def slip_velocity(self, s, p):
        return s.x_dot

    def normal_force(self, s, p):
        return p.preload
