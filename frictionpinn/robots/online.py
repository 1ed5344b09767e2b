"""Friction of a robot's joints online: one sample after the other, causal, with the bristles carried along.

    load = Y(q, v, a) pi,    (z_k - z_{k-1}) / h = f(z_k, v_k, load_k),    F_k = F(v_k, load_k, z_k)

Bristles advance by the implicit Euler method: one that settles within a sample does so, at any sample rate. A sample
takes one evaluation of the bodies (pinocchio) and a few of each joint's friction (compiled).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import UserError
from .arm import Arm
from .joints import joints_of

LAG = 0.01  # s: of the acceleration that is taken from velocities; ten samples of a usual controller
LONGEST = 0.1  # s: after a longer gap bristles begin anew; a joint crosses any presliding range in it


@dataclass(frozen=True)
class Sample:
    """What a model says at an instant, N m (N of a joint that slides), shape (joints,) each.

    Attributes:
        load: torques of the bodies, which the joints transmit.
        friction: torques of friction.
        torque: what the motors need for this motion: load, their own inertia and friction.
        unexplained: measured torque less that; NaN where none was given.
    """

    load: np.ndarray
    friction: np.ndarray
    torque: np.ndarray
    unexplained: np.ndarray


class Observer:
    """Friction of an arm's joints from positions and velocities as they come.

    Args:
        arm: bodies and friction with their values, of a file or identified.
        lag: s, of the filter that takes accelerations from velocities where none are given.
    """

    def __init__(self, arm: Arm, lag: float = LAG):
        self.arm, self.lag = arm, float(lag)
        self._joints = joints_of(arm.mechanisms, [arm.own(k) for k in range(len(arm.names))])
        self.reset()

    def reset(self) -> None:
        """Forget all samples."""
        n = len(self.arm.names)
        self._t, self._v, self._a = -np.inf, np.zeros(n), np.zeros(n)
        self._memory, self._rates = np.zeros(self._joints.count), np.zeros(self._joints.count)

    def step(
        self, t: float, q: np.ndarray, v: np.ndarray, a: np.ndarray | None = None, tau: np.ndarray | None = None
    ) -> Sample:
        """Take the newest sample.

        Args:
            t: s.
            q, v: measured positions and velocities, rad and rad/s, shape (joints,).
            a: accelerations, rad/s^2 (a reference's); None: the change of v, through a filter of first order.
            tau: measured torques: for ``unexplained``, and for the bristles of joints at rest when it begins.

        Raises:
            UserError: time that does not go on, or numbers that are no finite one for each joint.
        """
        q, v, measured = (self._checked(name, x) for name, x in (("q", q), ("v", v), ("tau", tau)))
        h, begins = t - self._t, False
        if not h > 0:
            raise UserError("time does not go on", where="t", received=f"{t:g} after {self._t:g}",
                            allowed="later samples", fix="call reset() between recordings")  # fmt: skip
        if h > LONGEST:
            begins, self._a = True, np.zeros_like(v)
        elif a is None:
            self._a = self._a + h / (self.lag + h) * ((v - self._v) / h - self._a)
        a = self._a if a is None else self._checked("a", a)
        bodies = self.arm.robot.inverse_dynamics(q[None], v[None], a[None])[0]  # and the motors' own inertia
        load = bodies - self.arm.armature * a
        if begins:
            needed = np.where(np.isnan(measured), 0.0, measured - load)
            self._memory, h = self._joints.start(q, v, load, needed), 0.0
            self._rates = np.zeros(self._joints.count)
        seen = np.stack([q, v, a, load], axis=1)
        friction, _ = self._joints.at(t, seen, self._memory, h, self._rates)
        self._memory = self._memory + h * self._rates
        self._t, self._v = t, v
        return Sample(load, friction, bodies + friction, measured - bodies - friction)

    def _checked(self, name: str, x: np.ndarray | None) -> np.ndarray:
        n = len(self.arm.names)
        if x is None:
            return np.full(n, np.nan)
        x = np.asarray(x, float)
        if x.shape != (n,) or not np.isfinite(x).all():
            raise UserError("not one number for each joint", where=name, received=x.tolist(),
                            allowed=f"{n} finite numbers")  # fmt: skip
        return x
