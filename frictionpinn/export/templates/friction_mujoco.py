"""Friction of an exported model in a MuJoCo simulation. Needs numpy and mujoco alone.

    friction = Friction(model, "law", joint="x", normal=Reaction("box"))
    while data.time < 2.0:
        friction.step(data)  # instead of mujoco.mj_step(model, data)

With several contacts, each in its own joint or between its own bodies:

    frictions = [Friction(model, "law", contact="rail", joint="x", normal=Reaction("cart")),
                 Friction(model, "law", contact="bearing", joint="theta", normal=Preload(1.0))]
    step(frictions, data)

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
from friction_model import Bristles, Law, Network

HERE = Path(__file__).resolve().parent
SWEEPS, SETTLED = 50, 1e-6  # over the forces of several contacts, and change of a force, by its scale, that ends them


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
        contact: whose friction it is, where several were exported.

    ``force``, ``slip`` and ``normal`` hold those of the last step; ``torque`` what the driven joints needed.
    """

    def __init__(
        self, model, kind="law", *, joint=None, bodies=None, axis=(1.0, 0.0, 0.0), normal=None, folder=HERE, contact=""
    ):
        if (joint is None) == (bodies is None):
            raise ValueError("give either joint or bodies")
        if model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4:
            raise ValueError("integrator RK4 cannot be split into two halves: use Euler, implicitfast or implicit")
        if joint is not None and normal is None:
            raise ValueError("give the joint's normal force: Reaction(body), Preload(value) or Contacts(first, second)")
        name = f"{contact}_friction_model.json".lstrip("_")
        if not (Path(folder) / name).is_file():
            raise ValueError(f"no such contact was exported: {contact!r} (no file {name} in {folder})")
        self.description = json.loads((Path(folder) / name).read_text())
        if kind not in self.description["kinds"]:
            raise ValueError(f"kind {kind!r} is not exported; allowed: {', '.join(self.description['kinds'])}")
        self.model, self.joint, self.bodies, self.axis = model, joint, bodies, np.asarray(axis, float)
        self.contacts = Contacts(*bodies) if bodies else None
        self.normal_force = normal or self.contacts
        network = Bristles if "tables" in self.description else Network
        self.law = (Law if kind == "law" else network)(self.description, model.opt.timestep)
        self.reset()

    def reset(self) -> None:
        """Forget the bristle state and the past."""
        self.law.reset()
        self.time, self.force, self.slip, self.normal = -math.inf, 0.0, 0.0, 0.0
        self.now: dict | None = None
        self.direction: np.ndarray | None = None
        self.torque: dict[str, float] = {}

    def step(self, data, accelerations: dict | None = None) -> float:
        """One step of MuJoCo with the friction force in it; returns that force.

        Args:
            accelerations: joint -> acceleration that a drive gives it (computed torque): the torque that this takes is
                found together with the friction force. The frictionless acceleration, which some networks see, is then
                that under the same motion of these joints, as in training.
        """
        return step([self], data, accelerations)[0]

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

    def solve(self, data, accelerations: dict) -> None:
        """Find the force under what is applied now; ``now`` is the contact that it leads to, None where it is open."""
        base, h = data.qfrc_applied.copy(), self.model.opt.timestep
        self.now, self.torque = None, {}
        self.direction = direction = self._direction(data)
        if direction is None:
            self.force = self.slip = self.normal = 0.0
            return
        dofs = [int(self.model.joint(name).dofadr[0]) for name in accelerations]
        pushes = [-direction, *np.eye(self.model.nv)[dofs]]
        qacc, normal = self._respond(data, base)
        answers = [self._respond(data, base + push) for push in pushes]
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
            self.force, now = 0.0, state(0.0)
        else:
            scale = self.description["force_scale"]["value"]
            self.force = root(lambda F: F - self.law.force(state(F)), self.force, scale)
            self.now = now = state(self.force)
        torque = torque + by_force * self.force
        self.slip, self.normal = now["v_slip"], now["normal_force"]
        self.torque = dict(zip(accelerations, torque.tolist(), strict=True))

    def keep(self, time: float) -> None:
        """Go on to the next step; an open contact forgets its bristle."""
        self.time = time
        if self.now is None:
            self.law.reset()
        else:
            self.law.keep(self.now)

    def applied(self) -> np.ndarray:
        """Generalised force of the friction, shape (nv,)."""
        return np.zeros(self.model.nv) if self.direction is None else -self.direction * self.force


def step(frictions, data, accelerations: dict | None = None) -> list[float]:
    """One step of MuJoCo with the friction forces of several contacts in it, found together; returns them.

    Each force in turn is solved for under the others, until none changes by more than a millionth of its scale.

    Args:
        frictions: one :class:`Friction` for each contact.
        accelerations: as in :meth:`Friction.step`.
    """
    model, accelerations = frictions[0].model, accelerations or {}
    for friction in frictions:
        if data.time < friction.time:
            friction.reset()
    mujoco.mj_step1(model, data)
    base = data.qfrc_applied.copy()
    for friction in frictions:
        friction.direction = friction._direction(data)
    for _ in range(SWEEPS):
        settled = True
        for friction in frictions:
            before, others = friction.force, [other.applied() for other in frictions if other is not friction]
            data.qfrc_applied[:] = sum(others, start=base)
            friction.solve(data, accelerations)
            settled &= abs(friction.force - before) <= SETTLED * friction.description["force_scale"]["value"]
        if settled or len(frictions) == 1:
            break
    data.qfrc_applied[:] = sum((friction.applied() for friction in frictions), start=base)
    for name, torque in frictions[-1].torque.items():
        data.qfrc_applied[int(model.joint(name).dofadr[0])] += torque
    mujoco.mj_step2(model, data)
    data.qfrc_applied[:] = base
    for friction in frictions:
        friction.keep(data.time)
    return [friction.force for friction in frictions]


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
