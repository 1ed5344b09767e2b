"""The friction that rigid-body simulators bring along, fitted to the training trials as well as it allows.

The pendulum on a box stands on a plane in MuJoCo (its friction cone) and in PyBullet (its Coulomb friction). The
swing is prescribed: in MuJoCo by an armature on the hinge so large that the torque decides its acceleration alone, in
PyBullet by the force with which the prescribed link acts on the box, to which it is equal.
"""

from __future__ import annotations

import importlib.util
import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from scipy.optimize import minimize

from ..data.contact import ContactTrial
from ..errors import choose
from ..numerics.paths import InputPath
from ..numerics.simulation import ContactLost, Simulation, SimulationFailed, Steps
from ..numerics.torch_functions import contact_signals
from ..physics import LAWS, System
from ..physics.mechanism import Mechanism
from ..progress import Steps as Progress
from .mjcf import pob_mjcf
from .yardsticks import Candidate

log = logging.getLogger(__name__)

# Steps, s, at most; whole fractions of the sample interval. MuJoCo lifts a sliding box a little, in proportion to its
# velocity and the friction's stiffness; at 0.5 ms the contact then chatters and the force is off by more than 10 times.
MUJOCO_STEP, BULLET_STEP = 1.25e-4, 5e-4
ARMATURE = 1e4  # kg m^2 on the hinge: the box then changes its acceleration by less than 1e-5 of itself
EVALUATIONS = 30  # of the fit's cost
HEIGHT = 0.05  # m, half the height of the box
LIFTED = 1e-3  # m above or below the plane: the box no longer stands on it


@dataclass(frozen=True)
class Option:
    """A parameter of a simulator's friction: start value and bounds; fitted in its logarithm."""

    start: float
    low: float
    high: float


MUJOCO = {
    "friction": Option(0.3, 0.01, 3.0),  # of the cone
    "solreffriction": Option(0.015, 1e-3, 0.5),  # time constant with which it brings slip to rest, s
    "solref": Option(1e-3, 2.5 * MUJOCO_STEP, 0.05),  # time constant of the normal direction, s
    "compliance": Option(0.5, 1e-4, 0.9),  # 1 - solimp: how much the constraints give
    "damping": Option(0.1, 1e-4, 10.0),  # of the box's joint, N s/m: viscous friction
}
BULLET = {
    "lateralFriction": Option(0.3, 0.01, 3.0),
    "linearDamping": Option(0.1, 1e-4, 10.0),  # 1/s
}
Run = Callable[[InputPath, Mapping[str, float], Mapping[str, float]], Simulation]


def simulators(names: Sequence[str], system: System, train: Sequence[ContactTrial]) -> dict[str, Candidate]:
    """Candidates by the simulator's name; none for a system that is not built in them or one not installed."""
    found: dict[str, Candidate] = {}
    for name in names:
        package, label, table, run = choose(name, SIMULATORS, "simulators")
        if system.name != "pob":
            continue
        if importlib.util.find_spec(package) is None:
            log.warning(f"{label} is not installed and left out: pip install -c constraints.txt {package}")
            continue
        log.info(f"fitting {label}'s own friction to the training trials")
        own = partial(run, system)
        fitted = fit(own, table, system, train)
        told = ", ".join(f"{key} {value:.3g}" for key, value in fitted.items())
        log.info(f"{label}: {told}")
        found[name] = Candidate(f"{label}'s own friction, fitted", simulate=partial(own, p=fitted))
    return found


def fit(run: Run, table: Mapping[str, Option], system: System, train: Sequence[ContactTrial]) -> dict[str, float]:
    """Parameters of least square force error over the training trials, by Nelder and Mead's search in logarithms."""
    mechanism = Mechanism(system, LAWS["coulomb"]())
    paths = [InputPath.from_signals(mechanism, trial.t, trial.smoothed) for trial in train]
    low, high, start = (np.log([getattr(o, key) for o in table.values()]) for key in ("low", "high", "start"))

    def values(u: np.ndarray) -> dict[str, float]:
        return dict(zip(table, np.exp(np.clip(u, low, high)).tolist(), strict=True))

    steps = Progress(EVALUATIONS, "simulations of the training trials")

    def cost(u: np.ndarray) -> float:
        steps.step()
        errors = []
        for trial, path in zip(train, paths, strict=True):
            y0 = {name: float(trial.smoothed[name][0]) for c in mechanism.free for name in c.signals[:2]}
            try:
                errors.append(np.mean((run(path, y0, values(u)).F - trial.offline["friction_force"]) ** 2))
            except (ContactLost, SimulationFailed):
                return 1e6
        return float(np.mean(errors)) + 10.0 * float(np.sum(np.maximum(low - u, 0) + np.maximum(u - high, 0)))

    simplex = np.vstack([start, *(start + 0.7 * row for row in np.eye(len(start)))])
    options = {"maxfev": EVALUATIONS, "initial_simplex": simplex, "xatol": 1e-3, "fatol": 1e-6}
    return values(minimize(cost, start, method="Nelder-Mead", options=options).x)


def _result(system: System, path: InputPath, q: np.ndarray, v: np.ndarray, F: np.ndarray) -> Simulation:
    """Everything at the samples; the accelerations follow from the friction force."""
    mechanism, zero = Mechanism(system, LAWS["coulomb"]()), np.zeros(len(path.t))
    signals = dict(path.signals) | {"x": q, "v": v, "a": zero}
    free = contact_signals(system, signals)
    mass = _mass(system)
    signals["a"] = free["a_frictionless"] - F / mass
    assert [c.name for c in mechanism.free] == ["x"]
    no_steps = Steps(np.empty(0, np.int64), np.empty((0, 2)), np.empty((0, 0, 0)))
    columns = q[:, None], v[:, None], signals["a"][:, None]
    return Simulation(path.t, *columns, zero, zero, v, free["normal_force"], F, signals, no_steps)


def _mass(system: System) -> float:
    return float(system.values["m_b"] or 0.0) + float(system.values["m_L"] or 0.0)


def _substeps(path: InputPath, longest: float) -> tuple[int, float]:
    interval = (path.t[-1] - path.t[0]) / (len(path.t) - 1)
    count = int(np.ceil(interval / longest - 1e-9))
    return count, interval / count


def run_mujoco(system: System, path: InputPath, y0: Mapping[str, float], p: Mapping[str, float]) -> Simulation:
    """The pendulum on a box in MuJoCo, on a plane with its friction cone, the swing prescribed.

    The force is the mean over the steps of an interval around a sample.
    """
    import mujoco
    from mujoco import rollout

    substeps, h = _substeps(path, MUJOCO_STEP)
    values = {name: float(value or 0.0) for name, value in system.values.items()}
    text = pob_mjcf(
        values, timestep=h, support="plane", friction=float(p["friction"]), creep=float(p["solreffriction"])
    )
    model: Any = mujoco.MjModel.from_xml_string(text)
    data: Any = mujoco.MjData(model)
    x, z, theta = (model.joint(name).qposadr[0] for name in ("x", "z", "theta"))
    model.dof_armature[theta], model.dof_damping[x] = ARMATURE, p["damping"]
    model.opt.tolerance = 1e-8 / ARMATURE  # MuJoCo takes its tolerance relative to the mean inertia
    model.pair_solref[:, 0], model.pair_solimp[:, :2] = max(p["solref"], 2 * h), 1.0 - p["compliance"]
    place, half = path.names.index("theta"), substeps // 2
    count = (len(path.t) - 1) * substeps + half
    theta_at = np.array([path(path.t[0] + h * k)[place] for k in range(count + 2)])
    rates = np.append(path(path.t[0])[place + 1], np.diff(theta_at) / h)
    data.qpos[x], data.qvel[x] = y0.get("x", 0.0), y0.get("v", 0.0)
    data.qpos[theta], data.qvel[theta] = theta_at[0], rates[0]
    torque = ARMATURE * np.diff(rates)[:, None] / h  # MuJoCo's Euler steps then meet the swing exactly
    first = np.concatenate([[0.0], data.qpos, data.qvel])
    states, _ = rollout.rollout(model, data, initial_state=first, control=torque[:count], skip_checks=False)
    states = np.vstack([first, states[0]])
    if not (np.abs(states[:, 1 + z]) < LIFTED).all():
        raise ContactLost(path.t[0] + h * int(np.argmax(~(np.abs(states[:, 1 + z]) < LIFTED))))
    q, v = states[:, 1 + x], states[:, 1 + len(data.qpos) + x]
    every = np.arange(len(path.t)) * substeps
    return _result(system, path, q[every], v[every], _mean_force(system, path, v, every, half, h))


def _mean_force(system: System, path: InputPath, v: np.ndarray, every: np.ndarray, half: int, h: float) -> np.ndarray:
    """Friction force about each sample, from the momentum that half an interval to either side has gained or lost."""
    before, after = np.maximum(every - half, 0), every + half
    acceleration = (v[after] - v[before]) / (h * (after - before))
    signals = dict(path.signals) | {"x": v[every] * 0.0, "v": v[every], "a": acceleration}
    return contact_signals(system, signals)["friction_force"]


def run_bullet(system: System, path: InputPath, y0: Mapping[str, float], p: Mapping[str, float]) -> Simulation:
    """A box on a plane in PyBullet, with the mass of box and link and the force of the prescribed link."""
    import pybullet

    substeps, h = _substeps(path, BULLET_STEP)
    mass = _mass(system)
    client = pybullet.connect(pybullet.DIRECT)
    try:
        pybullet.setGravity(0, 0, 0, physicsClientId=client)
        pybullet.setPhysicsEngineParameter(
            fixedTimeStep=h, numSolverIterations=200, solverResidualThreshold=0, physicsClientId=client
        )
        plane = pybullet.createCollisionShape(pybullet.GEOM_PLANE, physicsClientId=client)
        shape = pybullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=[0.1, 0.1, HEIGHT], physicsClientId=client)
        ground = pybullet.createMultiBody(0, plane, physicsClientId=client)
        box = pybullet.createMultiBody(mass, shape, basePosition=[y0.get("x", 0.0), 0, HEIGHT], physicsClientId=client)
        for body in (ground, box):
            pybullet.changeDynamics(body, -1, lateralFriction=1.0, restitution=0.0, physicsClientId=client)
        pybullet.changeDynamics(
            box, -1, lateralFriction=p["lateralFriction"], linearDamping=p["linearDamping"], angularDamping=0,
            localInertiaDiagonal=[0, 0, 0], physicsClientId=client,
        )  # fmt: skip
        pybullet.resetBaseVelocity(box, [y0.get("v", 0.0), 0, 0], physicsClientId=client)
        return _march_bullet(pybullet, client, box, system, path, mass, substeps, h)
    finally:
        pybullet.disconnect(client)


def _march_bullet(bullet, client, box, system, path, mass, substeps, h) -> Simulation:
    times = path.t[0] + h * np.arange((len(path.t) - 1) * substeps + 1)
    samples = np.array([path(time) for time in times]).T
    signals = dict(zip(path.names, samples, strict=True)) | {name: np.zeros(len(times)) for name in ("x", "v", "a")}
    free = contact_signals(system, signals)
    q, v, F = (np.empty(len(path.t)) for _ in range(3))
    for k in range(len(times)):
        place, _ = bullet.getBasePositionAndOrientation(box, physicsClientId=client)
        (before, _, _), _ = bullet.getBaseVelocity(box, physicsClientId=client)
        pushed, load = mass * free["a_frictionless"][k], free["normal_force"][k]
        bullet.applyExternalForce(box, -1, [pushed, 0, -load], place, bullet.WORLD_FRAME, physicsClientId=client)
        bullet.stepSimulation(physicsClientId=client)
        (after, _, _), _ = bullet.getBaseVelocity(box, physicsClientId=client)
        if k % substeps == 0:
            q[k // substeps], v[k // substeps] = place[0], before
            F[k // substeps] = pushed - mass * (after - before) / h
    return _result(system, path, q, v, F)


SIMULATORS = {
    "mujoco": ("mujoco", "MuJoCo", MUJOCO, run_mujoco),
    "pybullet": ("pybullet", "PyBullet", BULLET, run_bullet),
}
