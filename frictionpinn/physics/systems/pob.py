"""Pendulum-on-a-box: a box that slides on the ground, an upright link hinged on it that swings."""

import sympy as sp

from ..base import Parameter
from ..system import Coordinate, Input, System

ANGLE = ("rad", "rad/s", "rad/s^2")


class PendulumOnBox(System):
    """Box at x, link's centre of mass at (x + d sin theta, d cos theta), theta measured from upright.

    lagrange: (m_b + m_L) x'' + m_L d (theta'' cos theta - theta'^2 sin theta) = -F_f,
    (J_L + m_L d^2) theta'' + m_L d x'' cos theta - m_L g d sin theta = tau,
    F_N = (m_b + m_L) g - m_L d (theta'' sin theta + theta'^2 cos theta).

    published: the form printed in the paper, kept to measure its cost: the theta equation has J_L + m_L d and keeps
    -m_L d x' theta' sin theta, which Lagrange's method cancels; the normal force drops theta'' sin theta.

    Units: m, rad, N, kg, s. Source: Ozmen, Hespanha and Byl, arXiv 2504.12441, the equations derived anew.
    """

    name = "pob"
    title = "pendulum on a box"
    coordinates = (
        Coordinate("x", ("x", "v", "a")),
        Coordinate("theta", ("theta", "omega", "alpha"), ANGLE),
        Coordinate("y", constrained=True),
    )
    lever = ("d", "theta")
    inputs = (Input("tau", "N*m", "torque of the motor at the hinge"),)
    driven: tuple[str, ...] = ("theta",)
    equations_allowed = ("lagrange", "published")
    parameters: tuple[Parameter, ...] = (
        Parameter("m_b", "kg", "mass of the box", 0.5),
        Parameter("m_L", "kg", "mass of the link", 1.0),
        Parameter("d", "m", "distance from the hinge to the link's centre of mass", 0.25),
        Parameter("J_L", "kg*m^2", "link's moment of inertia about its centre of mass", 0.042),
        Parameter("g", "m/s^2", "gravity", 9.81),
    )

    def kinetic(self, s, p):
        vx = s.x_dot + p.d * sp.cos(s.theta) * s.theta_dot
        vy = s.y_dot - p.d * sp.sin(s.theta) * s.theta_dot
        box = p.m_b * (s.x_dot**2 + s.y_dot**2) / 2
        return box + p.m_L * (vx**2 + vy**2) / 2 + p.J_L * s.theta_dot**2 / 2

    def potential(self, s, p):
        return p.m_b * p.g * s.y + p.m_L * p.g * (s.y + p.d * sp.cos(s.theta))

    def applied(self, s, p):
        return {"theta": s.tau}

    def slip_velocity(self, s, p):
        return s.x_dot

    def normal_force(self, s, p):
        full = super().normal_force(s, p)
        return full if self.equations == "lagrange" else full.subs(s.theta_ddot, 0)

    def residual(self, coordinate):
        expr = super().residual(coordinate)
        if self.equations == "published" and coordinate.name == "theta":
            s, p = self.s, self.p
            expr += p.m_L * (p.d - p.d**2) * s.theta_ddot - p.m_L * p.d * s.x_dot * s.theta_dot * sp.sin(s.theta)
        return expr
