"""A cart on a rail that carries a free pole: friction on the rail and in the pole's bearing."""

import sympy as sp

from ..base import Parameter
from ..system import Coordinate, FrictionalContact, Input, System


class CartPole(System):
    """Cart at x, pole's centre of mass at (x + l sin theta, l cos theta), theta measured from upright (hanging at pi).

    (m_c + m_p) x'' + m_p l (theta'' cos theta - theta'^2 sin theta) = force - F_f,rail,
    (J + m_p l^2) theta'' + m_p l x'' cos theta - m_p g l sin theta = -T_f,bearing,
    F_N,rail = (m_c + m_p) g - m_p l (theta'' sin theta + theta'^2 cos theta).

    ``preload`` is 1 N m by default, so that a friction coefficient of the bearing reads as a torque in newton metres.

    Units: m, rad, N, N m, kg, s. Source: A. G. Barto, R. S. Sutton and C. W. Anderson, IEEE Trans. SMC 13 (1983), whose
    friction terms are those of the contacts here; R. V. Florian, Correct equations for the cart-pole (2005), for F_N.
    """

    name = "cartpole"
    title = "cart with a pole"
    coordinates = (
        Coordinate("x", ("x", "v", "a")),
        Coordinate("theta", ("theta", "omega", "alpha"), ("rad", "rad/s", "rad/s^2")),
        Coordinate("y", constrained=True),
    )
    contacts = (
        FrictionalContact("rail", text="the cart on its rail"),
        FrictionalContact("bearing", "N*m", "rad", "the bearing of the pole"),
    )
    lever = ("l", "theta")
    inputs = (Input("force", "N", "force of the motor on the cart"),)
    parameters = (
        Parameter("m_c", "kg", "mass of the cart", 1.0),
        Parameter("m_p", "kg", "mass of the pole", 0.3),
        Parameter("l", "m", "distance from the bearing to the pole's centre of mass", 0.3),
        Parameter("J", "kg*m^2", "pole's moment of inertia about its centre of mass", 0.009),
        Parameter("g", "m/s^2", "gravity", 9.81),
        Parameter("preload", "N*m", "torque that stands for the bearing's load", 1.0),
    )

    def kinetic(self, s, p):
        vx = s.x_dot + p.l * sp.cos(s.theta) * s.theta_dot
        vy = s.y_dot - p.l * sp.sin(s.theta) * s.theta_dot
        cart = p.m_c * (s.x_dot**2 + s.y_dot**2) / 2
        return cart + p.m_p * (vx**2 + vy**2) / 2 + p.J * s.theta_dot**2 / 2

    def potential(self, s, p):
        return p.m_c * p.g * s.y + p.m_p * p.g * (s.y + p.l * sp.cos(s.theta))

    def applied(self, s, p):
        return {"x": s.force}

    def slip_velocity(self, s, p):
        return {"rail": s.x_dot, "bearing": s.theta_dot}

    def normal_force(self, s, p):
        return {"rail": self.constraint_force(), "bearing": p.preload}
