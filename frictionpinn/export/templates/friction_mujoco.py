"""Friction of an exported model in a MuJoCo simulation. Needs numpy and mujoco alone.

    friction = Friction(model, "law", joint="x", normal=Reaction("box"))
    while data.time < 2.0:
        friction.step(data)  # instead of mujoco.mj_step(model, data)

Every step solves F = friction(slip velocity and normal force that F leads to) with MuJoCo's own response to F, so that
neither a stiff bristle nor a steep network limits the timestep. This is a step and not a callback of MuJoCo's because a
passive force is asked for before the normal force is known, several times a step, and for every model of the process.
Integrators: Euler, implicitfast, implicit (not RK4, which MuJoCo cannot split).
"""

from __future__ import annotations

import json
import math
from pathlib import Path

import mujoco
import numpy as np
from friction_model import Law, Network

HERE = Path(__file__).resolve().parent


class Reaction:
    """Normal force of a joint: the reaction between a body and its parent along an axis of the world."""

    def __init__(self, body: str, axis=(0.0, 0.0, 1.0)):
        self.body, self.axis = body, np.asarray(axis, float)

    def __call__(self, model, data) -> float:
        mujoco.mj_rnePostConstraint(model, data)
        return abs(float(data.cfrc_int[model.body(self.body).id, 3:] @ self.axis))


class Preload:
    """A constant normal force (1 where a coefficient reads as the force itself)."""

    def __init__(self, value: float):
        self.value = float(value)

    def __call__(self, model, data) -> float:
        return self.value


class Contacts:
    """Sum of the normal forces of all contacts between two bodies; give their geoms condim 1 (frictionless)."""

    def __init__(self, first: str, second: str):
        self.names = first, second

    def of(self, model, data) -> list[int]:
        pair = {model.body(name).id for name in self.names}
        geoms = data.contact.geom[: data.ncon]
        return [k for k, ids in enumerate(geoms) if {int(model.geom_bodyid[i]) for i in ids} == pair]

    def __call__(self, model, data) -> float:
        force, total = np.zeros(6), 0.0
        for k in self.of(model, data):
            mujoco.mj_contactForce(model, data, k, force)
            total += force[0]
        return total

    def point(self, model, data) -> np.ndarray | None:
        found = self.of(model, data)
        return data.contact.pos[found].mean(axis=0) if found else None


class Friction:
    """Friction in one joint, or between two bodies along one axis.

    Args:
        model: mujoco.MjModel.
        kind: "law" (the law with the identified parameters) or "network" (the trained network).
        joint: slide or hinge joint that slips; or
        bodies: two bodies that slip on each other at their contacts, the first against the second.
        axis: of the world, along which the bodies slip.
        normal: :class:`Reaction`, :class:`Preload` or :class:`Contacts`; for bodies their contacts by default.
        folder: of the exported files.

    ``force``, ``slip`` and ``normal`` hold those of the last step; ``torque`` what the driven joints needed.
    """

    def __init__(self, model, kind="law", *, joint=None, bodies=None, axis=(1.0, 0.0, 0.0), normal=None, folder=HERE):
        if (joint is None) == (bodies is None):
            raise ValueError("give either joint or bodies")
        if model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4:
            raise ValueError("integrator RK4 cannot be split into two halves: use Euler, implicitfast or implicit")
        if joint is not None and normal is None:
            raise ValueError("give the joint's normal force: Reaction(body), Preload(value) or Contacts(first, second)")
        self.description = json.loads((Path(folder) / "friction_model.json").read_text())
        if kind not in self.description["kinds"]:
            raise ValueError(f"kind {kind!r} is not exported; allowed: {', '.join(self.description['kinds'])}")
        self.model, self.joint, self.bodies, self.axis = model, joint, bodies, np.asarray(axis, float)
        self.contacts = Contacts(*bodies) if bodies else None
        self.normal_force = normal or self.contacts
        self.law = (Law if kind == "law" else Network)(self.description, model.opt.timestep)
        self.reset()

    def reset(self) -> None:
        """Forget the bristle state and the past."""
        self.law.reset()
        self.time, self.force, self.slip, self.normal = -math.inf, 0.0, 0.0, 0.0
        self.torque: dict[str, float] = {}

    def step(self, data, accelerations: dict | None = None) -> float:
        """One step of MuJoCo with the friction force in it; returns that force.

        Args:
            accelerations: joint -> acceleration that a drive gives it (computed torque): the torque that this takes is
                found together with the friction force. The frictionless acceleration, which some networks see, is then
                that under the same motion of these joints, as in training.
        """
        if data.time < self.time:
            self.reset()
        mujoco.mj_step1(self.model, data)
        self._solve(data, accelerations or {})
        mujoco.mj_step2(self.model, data)
        data.qfrc_applied[:] = self.base
        self.time = data.time
        return self.force

    def _direction(self, data) -> np.ndarray | None:
        """d slip velocity / d qvel; None where the bodies do not touch."""
        row = np.zeros(self.model.nv)
        if self.joint is not None:
            row[self.model.joint(self.joint).dofadr[0]] = 1.0
            return row
        point = self.contacts.point(self.model, data)
        if point is None:
            return None
        for sign, name in zip((1.0, -1.0), self.bodies, strict=True):
            jacobian = np.zeros((3, self.model.nv))
            mujoco.mj_jac(self.model, data, jacobian, None, point, self.model.body(name).id)
            row += sign * self.axis @ jacobian
        return row

    def _respond(self, data, applied: np.ndarray) -> tuple[np.ndarray, float]:
        """Accelerations and normal force under these applied forces."""
        data.qfrc_applied[:] = applied
        mujoco.mj_fwdActuation(self.model, data)
        mujoco.mj_fwdAcceleration(self.model, data)
        mujoco.mj_fwdConstraint(self.model, data)
        return data.qacc.copy(), self.normal_force(self.model, data)

    def _solve(self, data, accelerations: dict) -> None:
        self.base, h = data.qfrc_applied.copy(), self.model.opt.timestep
        direction = self._direction(data)
        if direction is None:
            self.law.reset()
            self.force = self.slip = self.normal = 0.0
            return
        dofs = [int(self.model.joint(name).dofadr[0]) for name in accelerations]
        pushes = [-direction, *np.eye(self.model.nv)[dofs]]
        qacc, normal = self._respond(data, self.base)
        answers = [self._respond(data, self.base + push) for push in pushes]
        A = np.array([answer - qacc for answer, _ in answers])  # accelerations by unit force
        n = np.array([answer - normal for _, answer in answers])
        wanted = np.array(list(accelerations.values())) - qacc[dofs]
        inverse = np.linalg.inv(A[1:, dofs]) if dofs else np.zeros((0, 0))
        torque, by_force = wanted @ inverse, -A[0, dofs] @ inverse  # torque = torque + by_force F
        slip, a = float(direction @ data.qvel), float(direction @ (qacc + torque @ A[1:]))
        a_by_force = float(direction @ (A[0] + by_force @ A[1:]))
        N, N_by_force = normal + float(torque @ n[1:]), float(n[0] + by_force @ n[1:])

        def state(F: float) -> dict:
            a_slip = a + a_by_force * F
            load = max(N + N_by_force * F, 0.0)
            return {"v_slip": slip + h * a_slip, "a_slip": a_slip, "normal_force": load, "a_frictionless": a}

        if N <= 0:
            self.law.reset()
            self.force, now = 0.0, state(0.0)
        else:
            scale = self.description["force_scale"]["value"]
            self.force = root(lambda F: F - self.law.force(state(F)), self.force, scale)
            now = state(self.force)
            self.law.keep(now)
        torque = torque + by_force * self.force
        self.slip, self.normal = now["v_slip"], now["normal_force"]
        self.torque = dict(zip(accelerations, torque.tolist(), strict=True))
        data.qfrc_applied[:] = self.base - direction * self.force
        data.qfrc_applied[dofs] += torque


def root(miss, guess: float, scale: float) -> float:
    """The zero of a function that rises, by the Illinois method in a bracket grown from the guess."""
    step, low = 1e-3 * scale, guess
    f_low = miss(low)
    if f_low == 0:
        return low
    high, f_high, sign = low, f_low, 1.0 if f_low < 0 else -1.0
    for _ in range(60):
        low, f_low = high, f_high
        high = high + sign * step
        f_high = miss(high)
        if f_high * sign >= 0:
            break
        step *= 3
    for _ in range(100):
        if abs(high - low) < 1e-9 * scale or f_high == f_low:
            break
        middle = high - f_high * (high - low) / (f_high - f_low)
        f = miss(middle)
        if abs(f) < 1e-9 * scale:
            return middle
        if f * f_high < 0:
            low, f_low = high, f_high
        else:
            f_low /= 2
        high, f_high = middle, f
    return high
