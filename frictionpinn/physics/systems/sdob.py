"""Spring-damper-on-a-box: a sliding mass that carries a second one on a vertical spring and damper."""

from ..base import Parameter
from ..system import Coordinate, Input, System


class SpringDamperOnBox(System):
    """Mass m_1 at x on the ground, pulled by ``force``; mass m_2 at height y above it, guided to move with it along x.

    (m_1 + m_2) x'' = force - F_f,
    m_2 y'' = -m_2 g + k (rest - y) - c y',
    F_N = m_1 g + k (rest - y) - c y'.

    Units: m, N, kg, s. Source: Ozmen, Hespanha and Byl, arXiv 2504.12441; its values are not published, these make
    F_N swing by about 30 % while the box sticks and slips.
    """

    name = "sdob"
    title = "spring-damper on a box"
    coordinates = (
        Coordinate("x", ("x", "v", "a")),
        Coordinate("y", ("y", "v_y", "a_y")),
        Coordinate("y_1", constrained=True),
    )
    inputs = (Input("force", "N", "horizontal force that pulls the box"),)
    driven = ("y",)
    parameters = (
        Parameter("m_1", "kg", "mass of the box", 0.5),
        Parameter("m_2", "kg", "mass on the spring", 1.0),
        Parameter("k", "N/m", "spring stiffness", 150.0),
        Parameter("c", "N*s/m", "damping of the spring", 0.5),
        Parameter("rest", "m", "rest length of the spring", 0.3),
        Parameter("g", "m/s^2", "gravity", 9.81),
    )

    def kinetic(self, s, p):
        box = p.m_1 * (s.x_dot**2 + s.y_1_dot**2) / 2
        return box + p.m_2 * (s.x_dot**2 + s.y_dot**2) / 2

    def potential(self, s, p):
        weight = p.m_1 * p.g * s.y_1 + p.m_2 * p.g * s.y
        return weight + p.k * (p.rest - (s.y - s.y_1)) ** 2 / 2

    def dissipation(self, s, p):
        return p.c * (s.y_dot - s.y_1_dot) ** 2 / 2

    def applied(self, s, p):
        return {"x": s.force}

    def slip_velocity(self, s, p):
        return s.x_dot
