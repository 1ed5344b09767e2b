"""A double pendulum with friction in both bearings, free or driven by torques."""

import sympy as sp

from ..base import Parameter
from ..system import Coordinate, FrictionalContact, Input, System

ANGLE = ("rad", "rad/s", "rad/s^2")


class DoublePendulum(System):
    """M(theta_2) theta'' + C + G = (tau_1 - T_f,shoulder, tau_2 - T_f,elbow), by the energies of two rigid links.

    theta_1 is measured from hanging, theta_2 from the line of the first link: the slip of each bearing is the rate of
    its own angle. Centres of mass at r_1 and r_2 from the bearings, which are l_1 apart. The preloads are 1 N m by
    default, so that friction coefficients read as torques in newton metres.

    Units: rad, N m, kg, m, s. Source: F. Wiebe et al., Open Source Dual-Purpose Acrobot and Pendubot Platform, IEEE
    Robotics & Automation Magazine 31 (2024), whose angles these are.
    """

    name = "double_pendulum"
    title = "double pendulum"
    coordinates = (
        Coordinate("theta_1", ("theta_1", "omega_1", "alpha_1"), ANGLE),
        Coordinate("theta_2", ("theta_2", "omega_2", "alpha_2"), ANGLE),
    )
    contacts = (
        FrictionalContact("shoulder", "N*m", "rad", "the bearing of the first link"),
        FrictionalContact("elbow", "N*m", "rad", "the bearing between the links"),
    )
    inputs = (
        Input("tau_1", "N*m", "torque of a motor at the shoulder; 0 where it swings freely"),
        Input("tau_2", "N*m", "torque of a motor at the elbow; 0 where it swings freely"),
    )
    parameters = (
        Parameter("m_1", "kg", "mass of the first link", 0.6),
        Parameter("m_2", "kg", "mass of the second link", 0.6),
        Parameter("l_1", "m", "length of the first link, from bearing to bearing", 0.3),
        Parameter("r_1", "m", "distance from the shoulder to the first link's centre of mass", 0.25),
        Parameter("r_2", "m", "distance from the elbow to the second link's centre of mass", 0.2),
        Parameter("J_1", "kg*m^2", "first link's moment of inertia about its centre of mass", 0.01),
        Parameter("J_2", "kg*m^2", "second link's moment of inertia about its centre of mass", 0.005),
        Parameter("g", "m/s^2", "gravity", 9.81),
        Parameter("preload_1", "N*m", "torque that stands for the load of the shoulder's bearing", 1.0),
        Parameter("preload_2", "N*m", "torque that stands for the load of the elbow's bearing", 1.0),
    )

    def kinetic(self, s, p):
        rate = s.theta_1_dot + s.theta_2_dot
        across = p.l_1**2 * s.theta_1_dot**2 + 2 * p.l_1 * p.r_2 * sp.cos(s.theta_2) * s.theta_1_dot * rate
        first = (p.J_1 + p.m_1 * p.r_1**2) * s.theta_1_dot**2 / 2
        return first + p.m_2 * (across + p.r_2**2 * rate**2) / 2 + p.J_2 * rate**2 / 2

    def potential(self, s, p):
        first = -(p.m_1 * p.r_1 + p.m_2 * p.l_1) * p.g * sp.cos(s.theta_1)
        return first - p.m_2 * p.g * p.r_2 * sp.cos(s.theta_1 + s.theta_2)

    def applied(self, s, p):
        return {"theta_1": s.tau_1, "theta_2": s.tau_2}

    def slip_velocity(self, s, p):
        return {"shoulder": s.theta_1_dot, "elbow": s.theta_2_dot}

    def normal_force(self, s, p):
        return {"shoulder": p.preload_1, "elbow": p.preload_2}
