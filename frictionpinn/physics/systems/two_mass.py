"""A drive whose motor turns the load through a compliant coupling: friction on both sides."""

from ..base import Parameter
from ..system import Coordinate, FrictionalContact, Input, System

ANGLE = ("rad", "rad/s", "rad/s^2")


class TwoMassDrive(System):
    """J_m theta_m'' = tau - T_c - T_f,motor,  J_l theta_l'' = T_c - T_f,load,
    T_c = k (theta_m - theta_l) + c (theta_m' - theta_l').

    The preloads are 1 N m by default, so that friction coefficients read as torques in newton metres.

    Units: rad, N m, kg m^2, s. Source: the two-mass system of drive control (Szabat and Orlowska-Kowalska, IEEE Trans.
    Industrial Electronics 54, 2007).
    """

    name = "two_mass"
    title = "drive with a compliant coupling"
    coordinates = (
        Coordinate("motor", ("theta_m", "omega_m", "alpha_m"), ANGLE),
        Coordinate("load", ("theta_l", "omega_l", "alpha_l"), ANGLE),
    )
    contacts = (
        FrictionalContact("motor", "N*m", "rad", "bearings and seals of the motor"),
        FrictionalContact("load", "N*m", "rad", "bearings and guides of the load"),
    )
    inputs = (Input("tau", "N*m", "torque of the motor"),)
    parameters = (
        Parameter("J_m", "kg*m^2", "motor's moment of inertia", 0.01),
        Parameter("J_l", "kg*m^2", "load's moment of inertia", 0.02),
        Parameter("k", "N*m/rad", "torsional stiffness of the coupling", 50.0),
        Parameter("c", "N*m*s/rad", "damping of the coupling", 0.01),
        Parameter("preload_m", "N*m", "torque that stands for the load of the motor's bearings", 1.0),
        Parameter("preload_l", "N*m", "torque that stands for the load of the load's bearings", 1.0),
    )

    def kinetic(self, s, p):
        return (p.J_m * s.motor_dot**2 + p.J_l * s.load_dot**2) / 2

    def potential(self, s, p):
        return p.k * (s.motor - s.load) ** 2 / 2

    def dissipation(self, s, p):
        return p.c * (s.motor_dot - s.load_dot) ** 2 / 2

    def applied(self, s, p):
        return {"motor": s.tau}

    def slip_velocity(self, s, p):
        return {"motor": s.motor_dot, "load": s.load_dot}

    def normal_force(self, s, p):
        return {"motor": p.preload_m, "load": p.preload_l}
