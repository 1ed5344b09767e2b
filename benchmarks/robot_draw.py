"""How large an undeclared effect of a simulated arm is, and how surely its recording can tell it.

An effect's torque along the motion that is asked for, below the frequency at which arms are rigid, less all that the
declared model could take it for: base parameters of the bodies, motors' inertias, viscous friction, both levels and the
velocity of the Stribeck curve, stiffness and damping of the bristle, a lag of the log. What is left over, over the
friction of its joint, is its ``share``; over the noise of the torques, ``z``: standard errors of its strength by the
bound of Cramer and Rao.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from robot_arms import EVERY, NOISE, STEP, Arm
from scipy.signal import butter, sosfiltfilt

from frictionpinn.physics.robot import Base
from frictionpinn.robots.motion import RIGID_HZ

THINNED = 20  # recorded samples between those that are compared: 50 Hz
SHARES = (0.05, 0.10)  # of a joint's friction, between which an effect is drawn
AWAY = 0.05  # of a bristle's stiffness, to either side of which its derivative is taken
# Strengths beyond which no arm has an effect; of loads as far as friction of the joint stays positive.
MOST = {"load_friction": 0.3, "gain_error": 0.3, "asymmetry": 0.4, "ripple": 0.5, "constant_force": 1.0,
        "load_direction": 0.8, "coupling": 0.3, "delay": 0.03, "position_friction": 0.25,
        "compliance": 1e-3}  # fmt: skip
OF_COULOMB = ("ripple", "constant_force")  # those in units of mu_c
Motion = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def torques(arm: Arm, t: np.ndarray, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What the channels show along a motion of the motors, and the friction in it, shape (n, joints)."""
    model, upright = arm.robot.model, np.array(arm.robot.model.gravity.linear)
    model.gravity.linear = arm.gravity()
    load = arm.robot.inverse_dynamics(q, v, a)
    if (twist := arm.effect("compliance")).any():
        moved = [x - y for x, y in zip((q, v, a), _rates(twist * load, t), strict=True)]
        load = arm.robot.inverse_dynamics(*moved)
    model.gravity.linear = upright
    g, beside = arm.friction()(load, q, v, t[:, None])
    friction = _bristles(arm.sigma_0, arm.sigma_1, g, v, t) + beside
    return arm.channels(t, load + arm.armature * a + friction), friction


def _bristles(sigma_0: np.ndarray, sigma_1: np.ndarray, g: np.ndarray, v: np.ndarray, t: np.ndarray) -> np.ndarray:
    """LuGre's force without its viscous part along a motion, shape (n, ..., joints)."""
    h, z, forces = t[1] - t[0], g[0] * np.sign(v[0]) / sigma_0, []
    for level, speed in zip(g, v, strict=True):
        slope = sigma_0 * np.abs(speed) / level
        steady = speed / np.maximum(slope, 1e-12)
        z = np.where(slope * h > 1e-9, steady + (z - steady) * np.exp(-slope * h), z + h * speed)
        forces.append(sigma_0 * z + sigma_1 * (speed - slope * z))
    return np.array(forces)


def _rates(x: np.ndarray, t: np.ndarray) -> list[np.ndarray]:
    first = np.gradient(x, t, axis=0)
    return [x, first, np.gradient(first, t, axis=0)]


class Declared:
    """What the declared model of an arm can take an effect for along a motion at every step."""

    def __init__(self, arm: Arm, motion: Motion):
        self.motion = t, q, v, a = tuple(x[::EVERY] for x in motion)
        plain = replace(arm, effects={}, tilt=(0.0, 0.0))
        (self.shown, friction), base, n = torques(plain, *self.motion), Base.of(arm.robot), len(arm.mu_c)
        dip = np.exp(-((v / arm.v_s) ** 2))
        g = arm.mu_c + (arm.mu_s - arm.mu_c) * dip
        side = 1 + AWAY * np.array([[1.0], [-1.0], [0.0], [0.0]])
        more = np.array([[1.0], [1.0], [1.0], [1 + AWAY]])
        F = _bristles(side * arm.sigma_0, more * arm.sigma_1, g[:, None], v[:, None], t)
        columns = [base.reduced(arm.robot.regressor(q, v, a)), np.gradient(self.shown, t, axis=0)[:, :, None]]
        stiffness, damping = F[:, 0] - F[:, 1], F[:, 3] - F[:, 2]
        for own in (a, v, np.sign(v) * (1 - dip), np.sign(v) * dip, np.sign(v) * dip * (v / arm.v_s) ** 2,
                    stiffness, damping):  # fmt: skip
            columns.append(own[:, :, None] * np.eye(n))
        self.noise = NOISE * np.sqrt(np.mean(self.shown**2, axis=0)) * np.sqrt(2 * RIGID_HZ * EVERY * STEP)
        self.friction = np.sqrt(np.mean(friction**2, axis=0))
        C = (_rigid(np.concatenate(columns, axis=2)) / self.noise[:, None]).reshape(
            -1, sum(c.shape[2] for c in columns)
        )
        U, size, _ = np.linalg.svd(C / np.maximum(np.linalg.norm(C, axis=0), 1e-300), full_matrices=False)
        self.taken = U[:, size > 1e-10 * size[0]]

    def bound(self, arm: Arm, joint: int | None) -> tuple[float, float]:
        """Share and z of the effect that an arm has beside the declared one at a joint; None: the largest share."""
        e = (_rigid(torques(arm, *self.motion)[0] - self.shown) / self.noise).ravel()
        left = (e - self.taken @ (self.taken.T @ e)).reshape(-1, len(self.noise))
        shares = np.sqrt(np.mean((left * self.noise) ** 2, axis=0)) / self.friction
        return float(shares.max() if joint is None else shares[joint]), float(np.linalg.norm(left))

    def sized(self, arm: Arm, effect: str, joint: int, share: float) -> Arm | None:
        """The arm with an effect of this share at a joint; None where no strength of ``MOST`` makes it."""
        most = MOST[effect]
        if effect in OF_COULOMB:
            most *= arm.mu_c[joint]
        if effect == "load_direction":
            load = arm.robot.inverse_dynamics(*self.motion[1:])[:, joint]
            most *= arm.mu_c[joint] / np.abs(load).max()

        def at(strength: float) -> Arm:
            return replace(arm, effects={effect: {joint: strength}})

        reached = self.bound(at(most), joint)[0]
        if reached < share:
            return None
        strength = most
        for _ in range(4):  # nearly proportional
            strength = min(strength * share / reached, most)
            reached = self.bound(at(strength), joint)[0]
        return at(strength)


def _rigid(values: np.ndarray) -> np.ndarray:
    """Behind a low-pass at the frequency at which arms are no longer rigid, and thinned."""
    return sosfiltfilt(butter(4, RIGID_HZ, fs=1 / (EVERY * STEP), output="sos"), values, axis=0)[::THINNED]
