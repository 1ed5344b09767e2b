"""How large an undeclared effect of a simulated arm is, and how surely its recording can tell it.

An effect's torque along the motion that is asked for, in steady sliding, less all that the declared model could take it
for: base parameters of the bodies, motors' inertias, viscous friction, both levels and the velocity of the Stribeck
curve, a lag of the log. What is left over, over the friction of its joint, is its ``share``; over the noise of the
torques, ``z``: standard errors of its strength by the bound of Cramer and Rao.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from robot_arms import EVERY, NOISE, Arm

from frictionpinn.physics.robot import Base

THINNED = 40  # steps of the motion between samples: 50 Hz, far above what is in it
SHARES = (0.05, 0.10)  # of a joint's friction, between which an effect is drawn
# Strengths beyond which no arm has an effect; of loads as far as friction of the joint stays positive.
MOST = {"load_friction": 0.3, "gain_error": 0.3, "asymmetry": 0.4, "ripple": 0.5, "constant_force": 1.0,
        "load_direction": 0.8, "coupling": 0.3, "delay": 0.03, "position_friction": 0.25,
        "compliance": 1e-3}  # fmt: skip
OF_COULOMB = ("ripple", "constant_force")  # those in units of mu_c


def torques(arm: Arm, t: np.ndarray, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What the channels show along a motion of the motors in steady sliding, and the friction in it."""
    model, upright = arm.robot.model, np.array(arm.robot.model.gravity.linear)
    model.gravity.linear = arm.gravity()
    load = arm.robot.inverse_dynamics(q, v, a)
    if (twist := arm.effect("compliance")).any():
        moved = [x - y for x, y in zip((q, v, a), _rates(twist * load, t), strict=True)]
        load = arm.robot.inverse_dynamics(*moved)
    model.gravity.linear = upright
    g, beside = arm.friction()(load, q, v, t[:, None])
    friction = g * np.sign(v) + beside
    return arm.channels(t, load + arm.armature * a + friction), friction


def _rates(x: np.ndarray, t: np.ndarray) -> list[np.ndarray]:
    first = np.gradient(x, t, axis=0)
    return [x, first, np.gradient(first, t, axis=0)]


def bound(arm: Arm, joint: int | None, motion: tuple[np.ndarray, ...]) -> tuple[float, float]:
    """Share and z of an arm's effect at a joint (None: the largest share of any) along a motion at every step."""
    t, q, v, a = (x[::THINNED] for x in motion)
    plain = replace(arm, effects={}, tilt=(0.0, 0.0))
    (shown, friction), base = torques(plain, t, q, v, a), Base.of(arm.robot)
    effect = torques(arm, t, q, v, a)[0] - shown
    n = len(arm.mu_c)
    dip = np.exp(-((v / arm.v_s) ** 2))
    columns = [base.reduced(arm.robot.regressor(q, v, a)), np.gradient(shown, t, axis=0)[:, :, None]]
    for own in (a, v, np.sign(v) * (1 - dip), np.sign(v) * dip, np.sign(v) * dip * (v / arm.v_s) ** 2):
        columns.append(own[:, :, None] * np.eye(n))
    noise = NOISE * np.sqrt(np.mean(shown**2, axis=0))
    C = (np.concatenate(columns, axis=2) / noise[:, None]).reshape(len(t) * n, -1)
    size = np.maximum(np.linalg.norm(C, axis=0), 1e-300)
    e = (effect / noise).ravel()
    left = (e - (C / size) @ np.linalg.lstsq(C / size, e, rcond=1e-10)[0]).reshape(len(t), n)
    shares = np.sqrt(np.mean((left * noise) ** 2, axis=0)) / np.sqrt(np.mean(friction**2, axis=0))
    share = float(shares.max() if joint is None else shares[joint])
    return share, float(np.linalg.norm(left) * np.sqrt(THINNED / EVERY))


def sized(arm: Arm, effect: str, joint: int, motion: tuple[np.ndarray, ...], share: float) -> Arm | None:
    """The arm with an effect of this share at a joint; None where no strength of ``MOST`` makes it."""
    most = MOST[effect]
    if effect in OF_COULOMB:
        most *= arm.mu_c[joint]
    if effect == "load_direction":
        load = arm.robot.inverse_dynamics(*(x[::THINNED] for x in motion[1:]))[:, joint]
        most *= arm.mu_c[joint] / np.abs(load).max()

    def at(strength: float) -> Arm:
        return replace(arm, effects={effect: {joint: strength}})

    reached = bound(at(most), joint, motion)[0]
    if reached < share:
        return None
    strength = most
    for _ in range(4):  # nearly proportional
        strength = min(strength * share / reached, most)
        reached = bound(at(strength), joint, motion)[0]
    return at(strength)
