"""An identified robot: its bodies, its motors' inertias and the friction of each joint, all with their values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ..errors import UserError, choose, nearest
from ..numerics.imposed import ImposedFriction
from ..physics import FrictionLaw
from ..physics.base import at_contact
from ..physics.effects import EFFECTS
from ..physics.friction import CONTACT_LAWS
from ..physics.mechanism import Mechanism
from ..physics.robot import Robot
from ..physics.robot_joint import JOINT_EFFECTS, RobotJoint
from .bodies import bodies_of
from .recording import joint_names


@dataclass(frozen=True)
class Arm:
    """A robot with friction: tau = Y pi + I_a a + F(v, load, z), see :mod:`frictionpinn.physics.robot`.

    Attributes:
        robot: its bodies; armatures are those of the motors.
        mechanisms: friction of each joint: law and effects.
        values: parameter -> value by full name, ``joint_2.mu_c``, SI units.
        estimated: whether the bodies were estimated, and are not the file's.
        misfit: how far their base parameters are from the estimated ones, relative: 0 unless those cannot exist.
    """

    robot: Robot
    mechanisms: tuple[Mechanism, ...]
    values: Mapping[str, float]
    estimated: bool = False
    misfit: float = 0.0

    @classmethod
    def of(
        cls,
        robot: Robot,
        friction: str | FrictionLaw | Sequence[str | FrictionLaw] = "none",
        values: Mapping[str, float] | None = None,
        effects: Mapping[str, Sequence[str]] | Sequence[str] = (),
        armature: Sequence[float] | None = None,
    ) -> Arm:
        """Declare an arm.

        Args:
            robot: its bodies.
            friction: law of all joints, or of each.
            values: of their parameters, SI units, of one joint (``joint_2.mu_c``) or of all (``mu_c``).
            effects: at every joint, or joint -> names.
            armature: kg m^2; None: of the file.

        Raises:
            UserError: an unknown law, effect, joint or parameter, one without a value or with an impossible one.
        """
        names = joint_names(len(robot.joints))
        laws = [friction] * len(names) if isinstance(friction, str | FrictionLaw) else list(friction)
        if len(laws) != len(names):
            raise UserError("not one law for each joint", where="friction", received=len(laws), allowed=f"{len(names)}")
        table = effects if isinstance(effects, Mapping) else dict.fromkeys(names, effects)
        for name in table:
            choose(name, dict.fromkeys(names), "effects")
        mechanisms = []
        for name, law, turns in zip(names, laws, robot.turns, strict=True):
            made = choose(law, CONTACT_LAWS, "friction")() if isinstance(law, str) else law
            own = tuple(choose(e, {**EFFECTS, **JOINT_EFFECTS}, "effects")() for e in table.get(name, ()))
            mechanisms.append(Mechanism(RobotJoint(bool(turns)), made, own))
        if armature is not None and len(armature) != len(names):
            raise UserError("not one armature for each joint", where="armature", received=f"{len(armature)} long",
                            allowed=f"{len(names)}")  # fmt: skip
        bodies = robot if armature is None else robot.with_inertia(robot.inertial, np.asarray(armature, float))
        return cls(bodies, tuple(mechanisms), {}).with_values(**(values or {}))

    @classmethod
    def identified(cls, model: Any) -> Arm:
        """From the fitted model of an identification or diagnosis, :class:`frictionpinn.robots.balance.Model`.

        Only combinations of the inertial parameters are identified: bodies that have them, see :mod:`.bodies`. Effects
        on the robot as a whole (a payload, gains of motors) are no part of an arm.
        """
        names = joint_names(len(model.robot.joints))
        mechanisms = tuple(model.friction(k).mechanism for k in range(len(names)))
        estimated = any(name.startswith("inertia.") for name in model.free)
        inertial, misfit = bodies_of(model.robot, model.base, model.beta) if estimated else (model.robot.inertial, 0.0)
        armature = np.array([max(model.values[f"armature.{name}"], 0.0) for name in names])
        own = {f"{joint}.{par.name}" for joint, m in zip(names, mechanisms, strict=True) for par in m.parameters}
        values = {name: value for name, value in model.values.items() if name in own}
        arm = cls(model.robot.with_inertia(inertial, armature), mechanisms, {}, estimated, misfit)
        return arm.with_values(**values)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the joints in results."""
        return joint_names(len(self.robot.joints))

    def with_values(self, **values: float) -> Arm:
        """A copy with other values, by full name or for all joints; what nothing says has its usual value.

        Raises:
            UserError: an unknown parameter, one without a value or with an impossible one.
        """
        known, full = dict(self.values), {}
        for joint, mechanism in zip(self.names, self.mechanisms, strict=True):
            usual = {par.name: par.value for par in mechanism.parameters} | dict(mechanism.system.values)
            for name in usual:
                whole = at_contact(joint, name)
                value = values.get(whole, values.get(name, known.get(whole, usual[name])))
                if value is None:
                    raise UserError("parameter without a value", where=whole,
                                    fix=f"give {whole}, or {name} of all joints")  # fmt: skip
                full[whole] = value
        plain = {name.rpartition(".")[2] for name in full}
        for name in values:
            if name not in full and name not in plain:
                raise UserError("unknown parameter", where=name, allowed=", ".join(full),
                                fix=nearest(name, full) or "use one of these")  # fmt: skip
        made = replace(self, values=full)
        for k, (joint, mechanism) in enumerate(zip(self.names, self.mechanisms, strict=True)):
            mechanism.check_values(dict(zip(mechanism_names(mechanism), made.own(k), strict=True)), joint)
        return replace(made, values={name: float(value) for name, value in full.items()})

    def own(self, k: int) -> list[float]:
        """Values of a joint's friction, in the order of its mechanism."""
        return [self.values[at_contact(self.names[k], name)] for name in mechanism_names(self.mechanisms[k])]

    @cached_property
    def armature(self) -> np.ndarray:
        """Inertia of the motors seen at the joints, shape (joints,)."""
        return self.robot.armature

    def torques(self, t: np.ndarray, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Torques of bodies and motors' inertias, and of friction, along a given motion, both of shape (n, joints)."""
        bodies = self.robot.inverse_dynamics(q, v, a)
        load = bodies - self.armature * a
        friction = []
        for k, mechanism in enumerate(self.mechanisms):
            seen = {"t": t, "q": q[:, k], "v": v[:, k], "a": a[:, k], "load": load[:, k]}
            friction.append(ImposedFriction(mechanism).force(seen, self.own(k)))
        return bodies, np.stack(friction, axis=1)


def mechanism_names(mechanism: Mechanism) -> list[str]:
    """Names of a mechanism's parameters."""
    return [par.name for par in mechanism.parameters]
