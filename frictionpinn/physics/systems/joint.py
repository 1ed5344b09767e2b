"""A rotary joint moved by a torque, with or without an arm that gravity pulls."""

import math

import sympy as sp

from ..base import Parameter
from ..system import Coordinate, Input, System


class Joint(System):
    """J theta'' + W_cos cos theta + W_sin sin theta = tau - T_f.

    ``W_cos`` and ``W_sin`` are what gravity asks for at theta = 0 and at 90 degrees, 0 without an arm: two numbers that
    are linear in the torque, whatever the angle from which theta is counted. The friction is a torque; ``preload`` is
    1 N m by default, so that a friction coefficient reads as the friction torque in newton metres.

    Units: rad, N m, kg m^2. Source: the energies of a rigid body on an axis.
    """

    name = "joint"
    title = "rotary joint"
    force_unit = "N*m"
    slip_unit = "rad"
    coordinates = (Coordinate("theta", ("theta", "omega", "alpha"), ("rad", "rad/s", "rad/s^2")),)
    inputs = (Input("tau", "N*m", "torque of the motor, behind the gear"),)
    parameters = (
        Parameter("J", "kg*m^2", "moment of inertia about the axis, the motor's included", 1.0),
        Parameter(
            "W_cos", "N*m", "torque that holds the arm against gravity at theta = 0", 0.0, -math.inf, neutral=0.0
        ),
        Parameter("W_sin", "N*m", "the same at theta = 90 degrees", 0.0, -math.inf, neutral=0.0),
        Parameter("preload", "N*m", "torque that stands for the load of gear and bearings", 1.0),
    )

    def kinetic(self, s, p):
        return p.J * s.theta_dot**2 / 2

    def potential(self, s, p):
        return p.W_cos * sp.sin(s.theta) - p.W_sin * sp.cos(s.theta)

    def applied(self, s, p):
        return {"theta": s.tau}

    def slip_velocity(self, s, p):
        return s.theta_dot

    def normal_force(self, s, p):
        return p.preload
