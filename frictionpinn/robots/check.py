"""What speaks against a robot's recording before any fit: one line each, with what to do.

Every channel by itself, and velocities against positions, as of any system (:mod:`frictionpinn.data`); then torques
against the motion (:mod:`.check_balance`); and the motion itself tells which parameters it cannot.

Public: :func:`inspect_robot`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..data.channels import channel_findings, one_way
from ..data.check import check_trial
from ..data.consistency import derivative_findings
from ..data.filters import sampled
from ..data.findings import NO_SLIP, Finding, listed, named_factor
from ..data.recording import Recording
from ..errors import UserError
from ..physics.robot import Base, Robot
from ..physics.robot_joint import RobotJoint
from ..physics.system import Coordinate, Input
from .check_balance import balance_findings, regress, torque_columns
from .motion import Prepared, prepare, rate_of
from .recording import robot_units

LIMIT = 3.0  # times a limit of the file: makers allow overload for moments, and users write limits of their own
MOVES = 0.02  # rad or m between the ends of its motion, less of which is a joint that stands still: 1 degree
MOST = (0.01, 0.99)  # quantiles of a position that are the ends of its motion: a spike is none
UNTOLD = 1e-4  # of the largest singular value of scaled columns: a parameter there is known a hundred times worse
USUAL_LOAD = 0.05  # friction by transmitted torque in gears
SEEN = 0.01  # of the friction: a change below is none
LONGEST_S = 120.0  # of a trial that is looked at: more tells the same


def inspect_robot(robot: Robot, recording: Recording, motor: bool = True) -> list[Finding]:
    """What speaks against a recording of a robot, the grave findings first.

    Args:
        robot, recording: see :func:`.recording.read_robot`.
        motor: torques are the motors', with the friction of gear and bearings.
    """
    for trial in recording.trials:
        try:
            check_trial(trial, recording.source or "recording")
        except UserError as error:
            return [Finding(str(error), grave=True)]
    findings = [f for k in range(len(robot.joints)) for f in _of_joint(robot, recording, k)]
    findings += _alike(robot, recording)
    findings += _standing(robot, recording)
    if not any(f.grave for f in findings):
        part = _shortened(recording)
        try:
            trials = prepare(part, robot, Base.of(robot))
        except UserError as error:
            if len(part) < len(recording):  # as long as is looked at, and still too short
                fix = "if t is in ms say data.units={t: ms, default: SI}; else leave out where the robot rests"
                slow = Finding(f"within {LONGEST_S:g} s hardly anything moves", fix, grave=True)
                return [*findings, slow]
            return [*findings, Finding(str(error), grave=True)]
        findings += _limits(robot, trials)
        if not any(f.grave for f in findings):
            findings += balance_findings(robot, trials, motor)
            if not any(f.grave for f in findings):
                findings += _told(robot, trials)
    return sorted(findings, key=lambda f: not f.grave)


def _shortened(recording: Recording) -> Recording:
    trials = [t.part(slice(0, max(int(LONGEST_S * rate_of(t)), 2)), t.name) for t in recording.trials]
    return replace(recording, trials=tuple(trials))


def _of_joint(robot: Robot, recording: Recording, k: int) -> list[Finding]:
    """Single channels of a joint, and its velocity against its position."""
    told = robot_units(robot)
    length, force = told[f"q_{k + 1}"], told[f"tau_{k + 1}"]
    kind = type(
        "OneJoint",
        (RobotJoint,),
        {
            "coordinates": (
                Coordinate("q", (f"q_{k + 1}", f"v_{k + 1}", f"a_{k + 1}"), (length, f"{length}/s", f"{length}/s^2")),
            ),
            "inputs": (Input(f"tau_{k + 1}", force, "torque or force of the motor"),),
            "applied": lambda self, s, p: {"q": getattr(s, f"tau_{k + 1}_in", 0) or 0},
        },
    )
    system = kind(bool(robot.turns[k]))
    tau = np.concatenate([t.signals[f"tau_{k + 1}"] for t in recording.trials])
    if np.ptp(tau) == 0:  # of another system's input that may be right
        return [Finding(f"tau_{k + 1} is {tau[0]:g} throughout", "check its column", grave=True)]
    trials, sigmas = sampled(recording, [f"{n}_{k + 1}" for n in ("q", "v", "tau")])
    if not trials:
        return []
    found = channel_findings(system, recording, trials)
    if not any(f.grave for f in found):
        found = [*found, *derivative_findings(system, trials, sigmas)]
    return found


def _alike(robot: Robot, recording: Recording) -> list[Finding]:
    """Two channels that hold the same."""
    findings, count = [], len(robot.joints)
    for kind in ("q", "tau"):
        values = [np.concatenate([t.signals[f"{kind}_{k + 1}"] for t in recording.trials]) for k in range(count)]
        for i in range(count):
            for j in range(i + 1, count):
                if np.ptp(values[i]) > 0 and np.array_equal(values[i], values[j]):
                    findings.append(
                        Finding(f"{kind}_{i + 1} and {kind}_{j + 1} are the same", "check their columns", grave=True)
                    )
    return findings


def _standing(robot: Robot, recording: Recording) -> list[Finding]:
    """Joints that do not move, or one way only."""
    names = [f"q_{k + 1}" for k in range(len(robot.joints))]
    speeds = [np.concatenate([np.gradient(t.signals[n], t.t) for t in recording.trials]) for n in names]
    ends = [[np.quantile(t.signals[n], MOST) for t in recording.trials] for n in names]
    still = [f"joint_{k + 1}" for k, own in enumerate(ends) if max(high - low for low, high in own) < MOVES]
    findings = []
    if len(still) == len(speeds):
        return [Finding(f"{NO_SLIP}: no joint moves", "check the columns of q", grave=True)]
    if still:
        findings.append(
            Finding(
                f"{listed(still)} hardly move{'s' if len(still) == 1 else ''}: friction there is not told",
                "move every joint, or lock it: robot.locked",
            )
        )
    for k, v in enumerate(speeds):
        if f"joint_{k + 1}" not in still and one_way(v):
            findings.append(
                Finding(
                    f"joint_{k + 1} moves one way only: its friction and a constant torque are one",
                    "record both directions",
                )
            )
    return findings


def _limits(robot: Robot, trials: Sequence[Prepared]) -> list[Finding]:
    """Torques and velocities far beyond what the file allows."""
    findings = []
    for key, values, name, kind, others, more in (
        ("velocity", [t.v for t in trials], "the rate of q", "q", ("deg", "mm"), "divide by a motor's gear ratio"),
        ("effort", [t.tau for t in trials], "tau", "tau", ("N*mm", "mN"), "name columns of current with robot.gains"),
    ):
        largest = np.quantile(np.abs(np.concatenate(values)), 0.99, axis=0)
        for k, (value, limit) in enumerate(zip(largest, robot.limits[key], strict=True)):
            if value > LIMIT * limit:
                unit = others[0] if robot.turns[k] else others[1]
                findings.append(
                    Finding(
                        f"{name}_{k + 1} reaches {value:.3g} where the robot file allows {limit:.3g}, "
                        f"a factor of {named_factor(value / limit)}",
                        f"if it is in {unit} say data.units={{{kind}: {unit}, default: SI}}, or {more}",
                        grave=True,
                    )
                )
    return findings


def _told(robot: Robot, trials: Sequence[Prepared]) -> list[Finding]:
    """What this motion cannot tell: inertial parameters, and a friction that depends on the load."""
    findings: list[Finding] = []
    W = np.concatenate([t.Y_filtered.reshape(-1, t.Y_filtered.shape[2]) for t in trials])
    base = Base.of(robot)
    scale = np.maximum(np.linalg.norm(W, axis=0), 1e-300)
    _, s, V = np.linalg.svd(W / scale, full_matrices=False)
    weak = np.flatnonzero(s < UNTOLD * s[0])
    if len(weak):
        names = {base.names[int(np.argmax(np.abs(V[k])))] for k in weak}
        joints = sorted({n.rpartition(".")[0] for n in names})
        findings.append(
            Finding(
                f"this motion does not tell {len(weak)} of {len(base.names)} inertial parameters ({listed(joints)})",
                "held-out motions may show it; move faster and all joints together",
            )
        )
    loads = [
        np.concatenate([np.abs((t.full @ robot.inertial)[:, k]) for t in trials]) for k in range(len(robot.joints))
    ]
    columns, tau = torque_columns(robot, trials), np.concatenate([t.tau for t in trials])
    blind = []
    for k, load in enumerate(loads):
        f = regress(columns[k], tau[:, k], 1.0)
        friction = float(np.sqrt(np.mean((columns[k][:, 3:5] @ f.c[3:5]) ** 2)))
        if USUAL_LOAD * float(np.std(load)) < SEEN * friction:
            blind.append(f"joint_{k + 1}")
    if blind:
        findings.append(
            Finding(
                f"this recording cannot show load dependence in {listed(blind)}: the transmitted torque hardly varies",
                "move with the arm stretched and folded, or with a payload",
            )
        )
    return findings
