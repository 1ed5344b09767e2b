"""The force balance of a robot.

    tau_i = (1 + gain_i) m_i + sum_j coupling_ij m_j,   m_i = Y_i beta + I_i a_i + F_i(v_i, load_i, z_i) + ...,
    load_i = Y_i beta,

at every instant, filtered. beta are the base parameters, which all joints share; F_i is the friction of joint i, a law
and effects as everywhere else, along the recorded motion; load_i, the torque that the gear transmits, moves with beta,
and so do its derivatives. Further terms act on the robot as a whole (:mod:`.whole`).

Public: :class:`Model` (the terms and their values), :func:`friction_of`, :func:`as_text`. Fitted by
:mod:`.least_squares`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from ..numerics.imposed import ImposedFriction
from ..physics import FrictionLaw
from ..physics.base import Parameter, at_contact, contact_of, plain_name
from ..physics.effect import Effect
from ..physics.mechanism import Mechanism
from ..physics.robot import Base, Robot
from ..physics.robot_joint import RobotJoint
from .motion import Prepared
from .recording import joint_names
from .whole import Whole

WIDTH = 1.5  # standard deviation of a logarithm's prior about the start: a factor of 20 either way in 95 %


@lru_cache(maxsize=512)
def friction_of(law: FrictionLaw, effects: tuple[Effect, ...], turns: bool) -> ImposedFriction:
    """Friction of a joint with these effects along a motion."""
    return ImposedFriction(Mechanism(RobotJoint(turns), law, effects))


@dataclass(frozen=True)
class Model:
    """What acts on a robot.

    Attributes:
        robot, base: its rigid bodies.
        laws: friction law of each joint.
        effects: of each joint, beside its law.
        whole: effects on the robot as a whole.
        values: parameter -> value, SI units: ``joint_2.mu_c``, ``inertia.<base parameter>``, ``armature.joint_2``.
        free: names that are estimated.
        priors: of those that have one, centre and standard deviation: of the logarithm where that is searched.
    """

    robot: Robot
    base: Base
    laws: tuple[FrictionLaw, ...]
    effects: tuple[tuple[Effect, ...], ...]
    whole: tuple[Whole, ...] = ()
    values: Mapping[str, float] = field(default_factory=dict)
    free: tuple[str, ...] = ()
    priors: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the joints."""
        return joint_names(len(self.robot.joints))

    def friction(self, k: int) -> ImposedFriction:
        """Friction of a joint."""
        return friction_of(self.laws[k], self.effects[k], bool(self.robot.turns[k]))

    def parameters(self, k: int) -> dict[str, Parameter]:
        """Parameters of a joint's friction by their full names."""
        table = self.friction(k).mechanism.parameters
        return {at_contact(self.names[k], par.name): par for par in table}

    @cached_property
    def logarithmic(self) -> frozenset[str]:
        """Stiffnesses, speeds and lengths, never 0 and of unknown size: searched by their logarithm."""
        return frozenset(n for k in range(len(self.names)) for n, par in self.parameters(k).items() if par.low > 0)

    def held_near(self) -> Model:
        """The model with a weak prior about where they are now for free parameters of unknown size that have none."""
        priors = {n: (float(np.log(self.values[n])), WIDTH) for n in self.free if n in self.logarithmic}
        return replace(self, priors={**priors, **self.priors})

    def own_values(self, k: int, values: Mapping[str, float] | None = None) -> list[float]:
        """Values of a joint's friction, in its order."""
        values = self.values if values is None else values
        return [float(values[at_contact(self.names[k], name)]) for name in self.friction(k).names]

    @property
    def beta(self) -> np.ndarray:
        """Base parameters."""
        return np.array([self.values[f"inertia.{name}"] for name in self.base.names])

    def with_values(self, **values: float) -> Model:
        """A copy with other values."""
        return replace(self, values={**self.values, **values})

    def loads(self, trial: Prepared) -> np.ndarray:
        """Torques that the joints transmit, N m, shape (n, joints): of the bodies, payload and tilt included."""
        load = trial.Y @ self.beta
        for w in self.whole:
            load = load + w.load(self, trial)
        return load

    def motion(self, trial: Prepared, k: int, load: np.ndarray) -> dict[str, np.ndarray]:
        """What a joint's friction sees."""
        seen = {"t": trial.t, "session": trial.session, "q": trial.q[:, k], "v": trial.v[:, k], "a": trial.a[:, k]}
        seen["load"] = load[:, k]
        if trial.covariate is not None:
            seen["covariate"] = trial.covariate[:, k]
        return seen

    def torques(self, trial: Prepared) -> tuple[np.ndarray, np.ndarray]:
        """Torques m of bodies and friction together, and of friction alone, shape (n, joints)."""
        load = self.loads(trial)
        friction = np.stack(
            [self.friction(k).force(self.motion(trial, k, load), self.own_values(k)) for k in range(len(self.names))],
            axis=1,
        )
        armature = np.array([self.values[f"armature.{name}"] for name in self.names])
        return load + armature * trial.a + friction, friction

    def recorded(self, trial: Prepared) -> np.ndarray:
        """What the torques' channels show, filtered, shape (m, joints)."""
        shown = self.torques(trial)[0]
        for w in self.whole:
            shown = w.shown(self, trial, shown)
        return trial.filtered(shown)

    def columns(self, trial: Prepared, names: Sequence[str]) -> np.ndarray:
        """Derivatives of what is recorded in parameters, shape (m, joints, names)."""
        load, wanted = self.loads(trial), {name: c for c, name in enumerate(names)}
        result = np.zeros((len(trial.tau), len(self.names), len(names)))
        bodies = [(wanted[f"inertia.{n}"], j) for j, n in enumerate(self.base.names) if f"inertia.{n}" in wanted]
        at, of = (np.array(x, int) for x in zip(*bodies, strict=True)) if bodies else (np.zeros(0, int),) * 2
        slopes = np.zeros_like(load)  # d F / d load
        for k, joint in enumerate(self.names):
            f, motion, values = self.friction(k), self.motion(trial, k, load), self.own_values(k)
            own = [n for n in names if contact_of(n) == joint and plain_name(n) in f.names]
            made = [f.columns(motion, values, [plain_name(n) for n in own])]
            places = [wanted[n] for n in own]
            if (armature := f"armature.{joint}") in wanted:
                made.append(trial.a[:, k : k + 1])
                places.append(wanted[armature])
            if any("load" in e.name for e in self.effects[k]):
                size = 1e-4 * max(float(np.sqrt(np.mean(load[:, k] ** 2))), 1e-6)
                slopes[:, k] = f.by_signal(motion, values, "load", size)
                result[:, k, at] = trial.filtered(slopes[:, k, None] * trial.Y[:, k, of])
            result[:, k, places] = trial.filtered(np.concatenate(made, axis=1))
        result[:, :, at] += trial.Y_filtered[:, :, of]
        for w in self.whole:
            for name in w.parameters:
                if name in wanted:
                    result[:, :, wanted[name]] = trial.filtered(w.column(self, trial, name, 1 + slopes))
        # Of the channels' effects those mix torques of one instant, and so filtered ones alike.
        for w in self.whole:
            others = [c for name, c in wanted.items() if name not in w.parameters or not w.at_the_channel]
            result[:, :, others] = w.shown_change(self, trial, result[:, :, others])
        return result


def as_text(model: Model) -> dict[str, Any]:
    """A model as plain types: laws and effects of each joint by name, effects on the robot, all values."""
    return {
        "friction": {name: law.name for name, law in zip(model.names, model.laws, strict=True)},
        "effects": {name: [e.name for e in effects] for name, effects in zip(model.names, model.effects, strict=True)},
        "whole": [w.name for w in model.whole],
        "values": {name: float(value) for name, value in model.values.items()},
        "free": list(model.free),
    }
