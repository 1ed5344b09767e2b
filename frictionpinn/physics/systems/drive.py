"""A drive: one translating mass moved by a motor force (EMPS, a linear axis)."""

from ..base import Parameter
from ..system import Coordinate, Input, System


class Drive(System):
    """M x'' = force - F_f.

    The normal force in a drive's guides and screw is not known: ``preload`` is 1 N by default, so that a friction
    coefficient reads as the friction force in newtons.

    Units: m, N, kg, s. Source: Janot, Gautier and Brunot, Nonlinear Benchmark Workshop (2019).
    """

    name = "drive"
    title = "linear drive"
    coordinates = (Coordinate("x", ("x", "v", "a")),)
    inputs = (Input("force", "N", "motor force"),)
    parameters = (
        Parameter("M", "kg", "moving mass, the motor's inertia included", 1.0),
        Parameter("preload", "N", "normal force in the guides", 1.0),
    )

    def kinetic(self, s, p):
        return p.M * s.x_dot**2 / 2

    def applied(self, s, p):
        return {"x": s.force}

    def slip_velocity(self, s, p):
        return s.x_dot

    def normal_force(self, s, p):
        return p.preload
