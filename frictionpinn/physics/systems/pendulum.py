"""A pendulum with friction in its hinge, free or driven by a torque."""

import sympy as sp

from ..base import Parameter
from ..system import Coordinate, Input, System


class Pendulum(System):
    """(J + m l^2) theta'' - m g l sin theta = tau - T_f, theta measured from upright (it hangs at pi).

    The friction is a torque; ``preload`` is 1 N m by default, so that a friction coefficient reads as the friction
    torque in newton metres.

    Units: rad, N m, kg, m, s. Source: the energies of a rigid pendulum.
    """

    name = "pendulum"
    title = "pendulum"
    force_unit = "N*m"
    slip_unit = "rad"
    coordinates = (Coordinate("theta", ("theta", "omega", "alpha"), ("rad", "rad/s", "rad/s^2")),)
    lever = ("l", "theta")
    inputs = (Input("tau", "N*m", "torque of a motor at the hinge; 0 where it swings freely"),)
    parameters = (
        Parameter("m", "kg", "mass", 1.0),
        Parameter("l", "m", "distance from the hinge to the centre of mass", 0.5),
        Parameter("J", "kg*m^2", "moment of inertia about the centre of mass", 0.02),
        Parameter("g", "m/s^2", "gravity", 9.81),
        Parameter("preload", "N*m", "torque that stands for the bearing's load", 1.0),
    )

    def kinetic(self, s, p):
        return (p.J + p.m * p.l**2) * s.theta_dot**2 / 2

    def potential(self, s, p):
        return p.m * p.g * p.l * sp.cos(s.theta)

    def applied(self, s, p):
        return {"theta": s.tau}

    def slip_velocity(self, s, p):
        return s.theta_dot

    def normal_force(self, s, p):
        return p.preload
