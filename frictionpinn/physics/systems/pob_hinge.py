"""Pendulum-on-a-box whose hinge has friction too."""

from ..base import Parameter
from ..system import FrictionalContact
from .pob import PendulumOnBox


class PendulumOnBoxWithHinge(PendulumOnBox):
    """The equations of :class:`.pob.PendulumOnBox` with -F_f,box in that of x and -T_f,hinge in that of theta.

    The torque at the hinge is an input and both coordinates are free; with ``driven=("theta",)`` the swing is
    prescribed, and then no equation that is simulated holds the hinge's friction. ``preload`` is 1 N m by default, so
    that a friction coefficient of the hinge reads as a torque in newton metres.

    Units: m, rad, N, N m, kg, s. Source: Ozmen, Hespanha and Byl, arXiv 2504.12441, the hinge's friction added.
    """

    name = "pob_hinge"
    title = "pendulum on a box with friction in the hinge"
    contacts = (
        FrictionalContact("box", text="the box on the ground"),
        FrictionalContact("hinge", "N*m", "rad", "the hinge of the link"),
    )
    driven = ()
    parameters = (
        *PendulumOnBox.parameters,
        Parameter("preload", "N*m", "torque that stands for the load of the hinge's bearing", 1.0),
    )

    def slip_velocity(self, s, p):
        return {"box": s.x_dot, "hinge": s.theta_dot}

    def normal_force(self, s, p):
        return {"box": super().normal_force(s, p), "hinge": p.preload}
