"""One joint of a robot as a frictional contact whose motion is imposed, and the effects that only joints have."""

from __future__ import annotations

import sympy as sp

from .base import FrictionLaw, Parameter
from .effect import Effect, strength
from .system import Coordinate, Input, System

TORQUE = Input("tau", "N*m", "torque of friction")
LOAD = Input("load", "N*m", "torque that the joint transmits")
COVARIATE = Input("covariate", "1", "a measured quantity that friction may depend on, less its mean: a temperature")


class RobotJoint(System):
    """0 = tau - F_f: a joint of a robot, without the torque that its bodies ask for (:mod:`.robot`).

    ``load`` is that torque, which gear and bearings transmit: Y pi of the joint. The normal force that a friction law
    sees is 1, so that mu_c reads as the friction torque of the unloaded joint; effects let it grow with the load.

    Units: rad, N m, s; of a sliding joint m, N.
    """

    name = "robot_joint"
    title = "joint of a robot"
    massless = True
    force_unit = "N*m"
    slip_unit = "rad"
    coordinates = (Coordinate("q", ("q", "v", "a"), ("rad", "rad/s", "rad/s^2")),)
    inputs = (TORQUE, LOAD, COVARIATE)
    parameters = (Parameter("preload", "1", "load of the unloaded joint", 1.0),)

    def __init__(self, turns: bool = True, **options):
        if not turns:
            self.force_unit, self.slip_unit = "N", "m"
        super().__init__(**options)

    def applied(self, s, p):
        return {"q": s.tau}

    def slip_velocity(self, s, p):
        return s.q_dot

    def normal_force(self, s, p):
        return p.preload


class JointEffect(Effect):
    """An effect of joints whose law has Coulomb friction.

    At loads beyond those of the fit a level of dry friction could be negative, and a bristle of such a level grows
    without bound: it is taken by its size.
    """

    def applies(self, system: System, law: FrictionLaw, others: tuple[str, ...] = ()) -> bool:
        return isinstance(system, RobotJoint) and any(par.name == "mu_c" for par in law.parameters)


class LoadFriction(JointEffect):
    """Dry friction grows with the transmitted torque: mu_c becomes mu_c + load_friction |load|.

    Units: load_friction dimensionless: 0.05 is 5 N m of dry friction more at 100 N m of load.
    Neutral: load_friction = 0.
    Occurs: in gears (strain wave, planetary, worm) and loaded bearings.
    Experiment: the same slow motion with the arm stretched out and folded, or with and without a payload.
    """

    name = "load_friction"
    parameters = (strength("load_friction", "1", "dry friction by transmitted torque"),)

    def load(self, N, c, p):
        return sp.Abs(N + p.load_friction * sp.Abs(LOAD.symbol) / p.mu_c)


class LoadDirection(JointEffect):
    """Load-dependent friction that differs by the flow of power: mu_c becomes mu_c + load_direction |load| s, s = 1
    where the motor drives the load, -1 where the load drives the motor back.

    Units: load_direction dimensionless, as load_friction.
    Neutral: load_direction = 0.
    Occurs: in gears whose teeth have another efficiency driving than back-driven: worm, strain wave.
    Experiment: lift and lower the same load at the same speeds.
    """

    name = "load_direction"
    parameters = (strength("load_direction", "1", "dry friction by transmitted torque, driving less back-driven, / 2"),)

    def load(self, N, c, p):
        return sp.Abs(N + p.load_direction * LOAD.symbol * sp.sign(c.v) / p.mu_c)


class Temperature(JointEffect):
    """Friction that follows a measured covariate T, less its mean: the law's force times 1 + temperature T.

    Units: temperature per unit of the covariate.
    Neutral: temperature = 0.
    Occurs: with greased gears: cold grease is stiff.
    Experiment: the same motion cold and warm.
    """

    name = "temperature"
    parameters = (strength("temperature", "1", "relative change of friction by the covariate"),)

    def force(self, c, p, law):
        return p.temperature * COVARIATE.symbol * law.force(c, p)


class Dither(JointEffect):
    """Vibration too fast for the recording to show wears the bristle off while the joint seems to stand: |v| in z'
    becomes its mean E|v + n|, n normal of standard deviation s = dither,

    E|v + n| = s sqrt(2 / pi) exp(-v^2 / (2 s^2)) + v erf(v / (s sqrt(2))).

    Units: dither in slip velocity: rad/s.
    Neutral: none: it is a part of every joint whose law has a bristle, and small where nothing vibrates.
    Occurs: wherever a controller answers the noise of an encoder, and with motors' torque ripple.
    Experiment: stand still under a torque below breakaway: friction creeps to what the torque asks.
    Source: LuGre's drift under vibration: Dupont, Hayward, Armstrong and Altpeter, IEEE Trans. Automatic Control 47
    (2002).
    """

    name = "dither"
    parameters = (Parameter("dither", "{L}/s", "standard deviation of the velocity that is too fast to be seen",
                            low=1e-9),)  # fmt: skip

    def applies(self, system, law, others=()):
        return isinstance(system, RobotJoint) and law.memory

    def slip_speed(self, speed, c, p):
        s, v = p.dither, sp.Abs(c.v)
        return s * sp.sqrt(2 / sp.pi) * sp.exp(-(v**2) / (2 * s**2)) + v * sp.erf(v / (s * sp.sqrt(2)))


class ShearThinning(JointEffect):
    """Viscous friction that grows less than the speed: sigma_2 v becomes sigma_2 v / (1 + shear_thinning |v|).

    Units: shear_thinning per slip velocity: at its inverse the viscous friction is half of what it would be.
    Neutral: shear_thinning = 0.
    Occurs: in greased gears: grease thins with the rate of shear, and warms where it is sheared.
    Experiment: constant speeds over the whole range.
    """

    name = "shear_thinning"
    parameters = (strength("shear_thinning", "s/{L}", "inverse of the speed that halves viscous friction", 0.0),)

    def applies(self, system, law, others=()):
        return super().applies(system, law, others) and any(par.name == "sigma_2" for par in law.parameters)

    def force(self, c, p, law):
        return p.sigma_2 * c.v * (1 / (1 + p.shear_thinning * sp.Abs(c.v)) - 1)


JOINT_EFFECTS: dict[str, type[Effect]] = {
    e.name: e for e in (LoadFriction, LoadDirection, Dither, ShearThinning, Temperature)
}
