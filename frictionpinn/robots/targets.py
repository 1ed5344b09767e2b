"""What other simulators can say of a joint's friction, and what the rest costs in torque along a motion.

Each target's friction is one of the house's laws with some effects. Its parameters are those of the joint where they
mean the same; where the target lacks something, they are fitted to the joint's friction along the motion, so that what
is told is the least that it costs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import sympy as sp
from scipy.optimize import least_squares

from ..numerics.imposed import ImposedFriction
from ..physics import EFFECTS
from ..physics.base import CONTACT
from ..physics.friction import CONTACT_LAWS
from ..physics.mechanism import Mechanism
from ..physics.robot_joint import JOINT_EFFECTS, RobotJoint
from .arm import Arm, mechanism_names

FITTED = ("mu_c", "mu_s", "sigma_2", "load_friction")  # in whose place nothing else of the joint's law stands
EXACT = 1e-9  # of a torque: rounding
STRIBECK = 1.0  # rad/s, of a target whose law asks for a Stribeck velocity where the joint has none: it says nothing
SHAPE = 2.0  # exponent of the Stribeck curve where a target with a bristle has no other
THINNEST = 2000  # samples to which a law without memory is fitted: some parameters do not need more


@dataclass(frozen=True)
class Target:
    """A place to hand friction to.

    Attributes:
        name: as it is asked for.
        armature: whether it has a place for a motor's inertia.
        stribeck, memory, load: whether it knows the Stribeck effect, a bristle, dry friction that grows with the load.
        rotor: both sides of the gear count as load: what gravity asks for and the motor's torque.
    """

    name: str
    armature: bool
    stribeck: bool = False
    memory: bool = False
    load: bool = False
    rotor: bool = False

    def mechanism(self, own: Mechanism) -> Mechanism:
        """Friction of a joint as the target can have it: no more than the joint needs."""
        has = set(mechanism_names(own))
        if self.memory and own.law.memory:
            law = "lugre"
        elif self.stribeck and "mu_s" in has:
            law = "stribeck"
        elif has - {"preload"}:
            law = "coulomb_viscous"
        else:
            law = "none"
        effects = ("load_friction",) if self.load and "load_friction" in has else ()
        made = {**EFFECTS, **JOINT_EFFECTS}
        turns = own.system.slip_unit == "rad"
        return Mechanism(RobotJoint(turns), CONTACT_LAWS[law](), tuple(made[name]() for name in effects))


@dataclass(frozen=True)
class Reduced:
    """A joint's friction as a target has it.

    Attributes:
        joint: name.
        target: where.
        values: parameters of the target's law, SI units.
        static: torque at rest that it holds without load, N m.
        armature: inertia of the motor, kg m^2.
        left_out: parameters of the joint that the target has no place for.
        error: rms of the difference of the friction torques along the motion, relative to the friction's.
        inertia_error: the same of the torque that the motor's inertia asks for, where it has no place.
    """

    joint: str
    target: str
    values: Mapping[str, float]
    static: float
    armature: float
    left_out: tuple[str, ...]
    error: float
    inertia_error: float


def reduce(arm: Arm, target: Target, t: np.ndarray, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> list[Reduced]:
    """Every joint of an arm as a target has it.

    Args:
        t: even steps, s, shape (n,).
        q, v, a: a motion that the arm is used for, shape (n, joints).
    """
    bodies, friction = arm.torques(t, q, v, a)
    load = bodies - arm.armature * a
    if target.rotor:  # halved: the same number then stands for the same friction in slow motion
        load = 0.5 * (arm.robot.inverse_dynamics(q, v, np.zeros_like(a)) + bodies + friction)
    found = []
    for k, own in enumerate(arm.mechanisms):
        seen = {"t": t, "q": q[:, k], "v": v[:, k], "a": a[:, k], "load": load[:, k]}
        found.append(_reduced(arm, k, target, own, seen, friction[:, k]))
    return found


def _reduced(arm: Arm, k: int, target: Target, own: Mechanism, seen: Mapping, F: np.ndarray) -> Reduced:
    mechanism = target.mechanism(own)
    imposed, have = ImposedFriction(mechanism), dict(zip(mechanism_names(own), arm.own(k), strict=True))
    start = _start(mechanism, own, have)
    size = float(np.sqrt(np.mean(F**2))) or 1.0
    free = [name for name in FITTED if name in imposed.names]

    def values(x: np.ndarray) -> dict[str, float]:
        made = start | dict(zip(free, np.abs(x), strict=True))
        if "mu_s" in made and "mu_c" in made:
            made["mu_s"] = max(made["mu_s"], made["mu_c"])
        return made

    thin = 1 if mechanism.memory else max(len(F) // THINNEST, 1)
    some = {name: x[::thin] for name, x in seen.items()}

    def left(x: np.ndarray) -> np.ndarray:
        made = values(x)
        return (imposed.force(some, [made[name] for name in imposed.names]) - F[::thin]) / size

    x = np.array([start[name] for name in free])
    if free and np.sqrt(np.mean(left(x) ** 2)) > EXACT:
        x = least_squares(left, x, x_scale=np.maximum(np.abs(x), 1e-2 * size)).x
    made = values(x)
    error = imposed.force(seen, [made[name] for name in imposed.names]) - F
    lost = 0.0 if target.armature else arm.armature[k] * np.asarray(seen["a"])
    static = made.get("mu_s", made.get("mu_c", 0.0))
    if "mu_s" in have and "mu_s" not in made and have["mu_c"] > 0:
        static *= have["mu_s"] / have["mu_c"]
    left_out = _left_out(own, have, made)
    off, inertia = (float(np.sqrt(np.mean(np.square(x)))) / size for x in (error, lost))
    return Reduced(arm.names[k], target.name, made, static, float(arm.armature[k]), left_out, off, inertia)


def _start(mechanism: Mechanism, own: Mechanism, have: Mapping[str, float]) -> dict[str, float]:
    """Values of a target's law: those of the joint that mean the same; of its bristle, what its force says."""
    usual = {par.name: par.value for par in mechanism.parameters} | dict(mechanism.system.values)
    start = {name: have.get(name, value) for name, value in usual.items()}
    if mechanism.memory:
        at = {par.symbol: have[par.name] for par in own.parameters if par.name in have}
        force = sp.sympify(own.law.force(CONTACT, own.p))
        for name, symbol in (("sigma_0", CONTACT.z), ("sigma_1", CONTACT.zdot), ("sigma_2", CONTACT.v)):
            start[name] = float(sp.diff(force, symbol).subs(at))
        start["alpha"] = SHAPE
    dry = have.get("mu_c", 0.0)
    other = {"mu_c": dry, "mu_s": have.get("mu_s", dry), "sigma_2": 0.0, "load_friction": 0.0, "v_s": STRIBECK}
    return {name: float(other.get(name, 0.0) if value is None else value) for name, value in start.items()}


def _left_out(own: Mechanism, have: Mapping[str, float], made: Mapping[str, float]) -> tuple:
    """Parameters of a joint that say something and that its target lacks, or has another value of."""
    silent, neutral = {"preload", "v_t", "v_sign", "tied_inertia"}, {par.name: par.neutral for par in own.parameters}
    if have.get("mu_s") == have.get("mu_c"):
        silent |= {"mu_s", "v_s", "alpha"}  # a Stribeck curve that is flat
    found = []
    for name, value in have.items():
        if name in silent or value == neutral[name] or not _acts(own, name, have):
            continue
        if value != SHAPE if name == "alpha" else name not in made:
            found.append(name)
    return tuple(found) if "alpha" not in made or made["alpha"] == SHAPE else tuple(n for n in found if n != "alpha")


def _acts(own: Mechanism, name: str, have: Mapping[str, float]) -> bool:
    """Whether a shape parameter belongs to an effect that is not at its neutral strength."""
    for effect in own.effects:
        mine = effect.parameters_on(own.system, own.law)
        if name in {par.name for par in mine if par.hidden}:
            return any(have.get(par.name) != par.neutral for par in mine if par.neutral is not None)
    return True


def names_of(rows: Sequence[Reduced]) -> list[str]:
    """Targets of rows, each once."""
    return list(dict.fromkeys(row.target for row in rows))
