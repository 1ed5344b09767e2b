"""Simulated arms in closed loop: a UR10e and an arm of seven joints, LuGre friction, encoder, noisy motor torques.

    q'' from the forward dynamics under u - F, every 0.5 ms; recorded every 1 ms: q as the encoder shows it (2^-19 of a
    turn, and noise of as much), tau = u (1 + gain) + coupling + 2 % of white noise.

The log shows the motor's side of a gear; the controller sees an encoder at the link alone: computed torque with masses
10 % off, and feedback on position and rate, 6 Hz, through the mass matrix along the motion that is asked for.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from frictionpinn.data.recording import Recording, Trial
from frictionpinn.physics.robot import Robot

STEP, EVERY = 5e-4, 2
ENCODER = 2 * np.pi / 2**19
NOISE = 0.02
REACH = 2.2  # rad, that joints turn from their middle at most
RIPPLES = 9  # of a turn


def seven(path: Path) -> Path:
    """A URDF of seven turning joints whose axes alternate, of the size of a collaborative arm."""
    axes = ["0 0 1", "0 1 0", "0 0 1", "0 -1 0", "0 0 1", "0 1 0", "0 0 1"]
    lengths, masses = [0.3, 0.2, 0.25, 0.2, 0.25, 0.1, 0.1], [4.0, 3.5, 3.0, 3.0, 2.0, 1.5, 0.8]
    parts, parent = ['<robot name="seven"><link name="base"/>'], "base"
    for k, (axis, length, mass) in enumerate(zip(axes, lengths, masses, strict=True), 1):
        J = mass * length**2 / 6 + 2e-3
        parts += [
            f'<link name="l{k}"><inertial><origin xyz="0.01 {0.02 - 0.005 * k} {length / 2}"/><mass value="{mass}"/>'
            f'<inertia ixx="{J}" ixy="0.001" ixz="0.0005" iyy="{1.1 * J}" iyz="-0.0005" izz="{0.4 * J}"/></inertial>'
            "</link>"
            f'<joint name="j{k}" type="revolute"><parent link="{parent}"/><child link="l{k}"/>'
            f'<origin xyz="0 0 {lengths[k - 2] if k > 1 else 0.1}"/><axis xyz="{axis}"/>'
            '<limit effort="300" velocity="4" lower="-3" upper="3"/></joint>'
        ]
        parent = f"l{k}"
    path.write_text("".join([*parts, "</robot>"]))
    return path


class NoSuchDraw(Exception):
    """An arm that cannot be: the seed is passed over."""


@dataclass
class Arm:
    """Parameters of a simulated arm: LuGre by joint, motors' inertias, and one undeclared effect at some joints.

    ``effects``: name -> {joint index: value}; ``tilt``: two angles.
    """

    robot: Robot
    mu_c: np.ndarray
    mu_s: np.ndarray
    v_s: np.ndarray
    sigma_0: np.ndarray
    sigma_1: np.ndarray
    sigma_2: np.ndarray
    armature: np.ndarray
    effects: dict[str, dict[int, float]] = field(default_factory=dict)
    tilt: tuple[float, float] = (0.0, 0.0)

    def effect(self, name: str) -> np.ndarray:
        """Strength of an effect at each joint."""
        values = np.zeros(len(self.mu_c))
        for k, value in self.effects.get(name, {}).items():
            values[k] = value
        return values

    def friction(self) -> Callable[..., tuple[np.ndarray, np.ndarray]]:
        """Of load, q, v and t the dry friction g(v) that bristles carry in steady sliding, and what acts beside it."""
        load_k, direction, asymmetry = (self.effect(e) for e in ("load_friction", "load_direction", "asymmetry"))
        offset, ripple, drag = (self.effect(e) for e in ("constant_force", "ripple", "shear_thinning"))
        drift, position = self.effect("drift"), self.effect("position_friction")

        def of(load, q, v, t):
            more = (load_k * np.abs(load) + direction * load * np.sign(v)) / self.mu_c
            N = (1 + asymmetry * np.sign(v)) * (1 + drift * t) * (1 + position * q) + more
            g = N * (self.mu_c + (self.mu_s - self.mu_c) * np.exp(-((v / self.v_s) ** 2)))
            return g, self.sigma_2 * v / (1 + drag * np.abs(v)) + offset + ripple * np.sin(RIPPLES * q)

        return of

    def gravity(self) -> np.ndarray:
        """Of the leaning base, m/s^2, shape (3,)."""
        upright = np.array(self.robot.model.gravity.linear)
        return upright + float(np.linalg.norm(upright)) * np.array([*self.tilt, 0.0])

    def channels(self, clock: np.ndarray, torque: np.ndarray) -> np.ndarray:
        """What is recorded of the motors' torques, but for noise, shape (n, joints)."""
        shown = torque * (1 + self.effect("gain_error"))
        for k, value in self.effects.get("coupling", {}).items():
            shown[:, k] += value * torque[:, k - 1 if k else 1]
        for k, late in self.effects.get("delay", {}).items():
            shown[:, k] = np.interp(clock - late, clock, shown[:, k])
        return shown


def draw(robot: Robot, rng: np.random.Generator, effort: np.ndarray) -> Arm:
    """An arm whose friction is some per cent of what its joints carry."""
    n = len(effort)
    mu_c = effort * rng.uniform(0.08, 0.2, n)
    armature = effort * rng.uniform(0.002, 0.006, n)
    length = 10 ** rng.uniform(-3.6, -3.0, n)
    sigma_0 = mu_c / length
    return Arm(robot, mu_c, mu_c * rng.uniform(1.1, 1.4, n), rng.uniform(0.03, 0.1, n), sigma_0,
               0.4 * np.sqrt(sigma_0 * armature), mu_c * rng.uniform(0.3, 0.8, n), armature)  # fmt: skip


def reference(
    rng: np.random.Generator, n: int, duration: float, speeds: tuple[float, float] | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Fourier series of each joint; t, q, v, a. With ``speeds`` its fastest is drawn between them, rad/s, as far as it
    stays within ``REACH`` of its middle."""
    t = np.arange(int(duration / STEP)) * STEP
    q, v, a = np.zeros((3, len(t), n))
    for k in range(n):
        middle = rng.uniform(-0.6, 0.6)
        for f in rng.uniform(0.05, 0.45, 4):
            w, size, phase = 2 * np.pi * f, rng.uniform(0.1, 0.5) * min(1.0, 0.15 / f), rng.uniform(0, 2 * np.pi)
            q[:, k] += size * np.sin(w * t + phase)
            v[:, k] += size * w * np.cos(w * t + phase)
            a[:, k] -= size * w**2 * np.sin(w * t + phase)
        if speeds is not None:
            factor = min(rng.uniform(*speeds) / np.abs(v[:, k]).max(), REACH / np.abs(q[:, k]).max())
            for x in (q, v, a):
                x[:, k] *= factor
        q[:, k] += middle
    return t, q, v, a


def simulate(
    arm: Arm,
    rng: np.random.Generator,
    duration: float,
    name: str = "run",
    speeds: tuple[float, float] | None = None,
) -> Trial:
    """One recording of the arm.

    Raises:
        NoSuchDraw: a load takes more than all of a joint's friction away.
    """
    import pinocchio as pin

    robot, n = arm.robot, len(arm.mu_c)
    model, data = robot.model, robot.model.createData()
    t, qr, vr, ar = reference(rng, n, duration, speeds)
    nominal = 0.9 * robot.inverse_dynamics(qr[::EVERY], vr[::EVERY], ar[::EVERY])
    upright = model.gravity.linear.copy()
    model.gravity.linear = arm.gravity()
    model.armature = arm.armature
    kp = (2 * np.pi * 6) ** 2
    kd = 2 * 0.8 * np.sqrt(kp)
    friction = arm.friction()
    compliance = arm.effect("compliance")
    q, v, z = qr[0].copy(), vr[0].copy(), np.zeros(n)
    a, command = np.zeros(n), nominal[0].copy()
    seen = np.round(q / ENCODER) * ENCODER
    rate, twist = v.copy(), np.zeros(n)
    shown, torque, true = np.empty((3, len(t) // EVERY, n))
    for i in range(len(t)):
        if i % EVERY == 0:
            noisy = np.round(q / ENCODER + rng.standard_normal(n)) * ENCODER
            rate += 0.2 * ((noisy - seen) / (EVERY * STEP) - rate)
            seen = noisy
            M = np.triu(pin.crba(model, data, qr[i]))  # armatures included
            asked = kp * (qr[i] - seen) + kd * (vr[i] - rate)
            command = nominal[i // EVERY] + M @ asked + np.triu(M, 1).T @ asked
            shown[i // EVERY], torque[i // EVERY] = noisy + np.round(twist / ENCODER) * ENCODER, command
        load = pin.rnea(model, data, q, v, a) - arm.armature * a
        twist = compliance * load
        g, beside = friction(load, q, v, t[i])
        if not (g > 0).all():  # loads beyond those along the motion that is asked for
            raise NoSuchDraw(f"{name}: a joint whose friction drives it at {t[i]:.2f} s")
        slope = arm.sigma_0 * np.abs(v) / g
        F = arm.sigma_0 * z + arm.sigma_1 * (v - slope * z) + beside
        if i % EVERY == 0:
            true[i // EVERY] = F
        a = pin.aba(model, data, q, v, command - F)
        v = v + STEP * a
        q = q + STEP * v
        slope = arm.sigma_0 * np.abs(v) / g  # the bristle goes with the step that position makes
        steady = v / np.maximum(slope, 1e-12)
        z = np.where(slope * STEP > 1e-9, steady + (z - steady) * np.exp(-slope * STEP), z + STEP * v)
    model.gravity.linear, model.armature = upright, np.zeros(n)
    channels = arm.channels(t[::EVERY], torque)
    channels += NOISE * np.sqrt(np.mean(channels**2, axis=0)) * rng.standard_normal(channels.shape)
    signals = {f"q_{k + 1}": shown[:, k] for k in range(n)} | {f"tau_{k + 1}": channels[:, k] for k in range(n)}
    return Trial(name, t[::EVERY], signals, {f"F_{k + 1}": true[:, k] for k in range(n)}, start=0.0)


def recorded(
    arm: Arm, rng: np.random.Generator, durations: tuple[float, ...], speeds: tuple[float, float] | None = None
) -> Recording:
    """Several recordings of one arm."""
    trials = tuple(simulate(arm, rng, d, f"run_{k + 1}", speeds) for k, d in enumerate(durations))
    units = {name: "rad" if name.startswith("q") else "N*m" for name in trials[0].signals}
    return Recording(trials, units, "simulated arm")
