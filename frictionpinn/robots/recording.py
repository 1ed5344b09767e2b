"""A robot's log as a recording: ``q_1, v_1, tau_1`` and so on, SI units, joints numbered as in the robot.

Public: :func:`read_robot`, :func:`robot_units` (the signals a recording may hold), :func:`torques` and
:func:`joint_names`. Repeated and late rows, gaps and angles that wrap are mended as in every log
(:mod:`frictionpinn.data.read`), unequal steps are kept.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..data.check import check_sizes
from ..data.read import Paths, find_files, read_recording
from ..data.recording import Recording
from ..data.tables import columns_of
from ..data.units import like
from ..errors import UserError, choose, nearest
from ..physics.robot import Robot

KINDS = {
    "q": "positions",
    "v": "velocities",
    "tau": "torques",
    "current": "motor currents",
    "temperature": "temperatures, or another quantity that friction may depend on",
}
TORQUE_AT = {"motor": True, "link": False}  # whether a torque holds the friction of gear and bearings


def joint_names(count: int) -> tuple[str, ...]:
    """Names of joints in results: joint_1 and so on."""
    return tuple(f"joint_{k + 1}" for k in range(count))


def robot_units(robot: Robot) -> dict[str, str]:
    """Signal -> SI unit, of everything that a recording of the robot may hold."""
    units: dict[str, str] = {}
    for k, turns in enumerate(robot.turns, 1):
        length, force = ("rad", "N*m") if turns else ("m", "N")
        units |= {f"q_{k}": length, f"v_{k}": f"{length}/s", f"tau_{k}": force, f"current_{k}": "A"}
        units[f"temperature_{k}"] = ""
    return units


def read_robot(
    paths: Paths,
    robot: Robot,
    *,
    columns: Mapping[str, Any] | None = None,
    units: Mapping[str, str] | None = None,
    trial_column: str | None = None,
    delimiter: str | None = None,
    decimal: str | None = None,
    gains: Sequence[float] | None = None,
    gear: Sequence[float] | None = None,
    coupling: Sequence[Sequence[float]] | None = None,
) -> Recording:
    """Read logs of a robot.

    Args:
        paths: files, see :func:`frictionpinn.data.read.read_recording`.
        robot: that they are of.
        columns: ``t``, and for each kind of signal (q, v, tau or current, temperature) a list of columns by joint or a
            pattern with a star for the joint's number, ``actual_q_*``. None: columns named q_1, v_1, tau_1.
        units: kind or signal -> unit of its columns, of a signal rather than of its kind; that of a kind is of the
            joints whose dimension it has, deg of those that turn; ``default`` covers the others. None: SI.
        trial_column: column that names the trials; None: each file is one.
        delimiter, decimal: of text files; found from the file if None.
        gains, gear, coupling: see :func:`torques`.

    Raises:
        UserError: as ``read_recording``; no positions, no torques, or not as many columns as joints; a value that no
            mechanism has.
    """
    wanted, files = robot_units(robot), find_files(paths)
    present = columns_of(files[0], delimiter)
    table = _columns(columns, present, robot.joints, str(files[0]))
    if trial_column not in (None, "trial", *present):
        raise UserError(
            "unknown column",
            where="data.trial_column",
            received=repr(trial_column),
            allowed=f"{', '.join(present)}, or null",
            fix=nearest(trial_column, present),
        )
    given: dict[str, str] = {}
    for name, unit in sorted((units or {"default": "SI"}).items(), key=lambda item: item[0] not in KINDS):
        own = [f"{name}_{k + 1}" for k in range(len(robot.joints))] if name in KINDS else [name]
        own = [n for n in own if n in wanted and like(unit, wanted[n])] or own  # of joints that turn, or that slide
        given |= {n: unit for n in own if n in table or n in ("t", "default") or n not in wanted}
    recording = read_recording(
        paths,
        columns=table,
        units=given,
        signal_units=wanted,
        trial_column=trial_column if trial_column in present else None,
        required=(),
        delimiter=delimiter,
        decimal=decimal,
    )
    used = ", ".join(f"{n} from {c}" for n, c in table.items() if n != c) or ", ".join(table)
    recording = torques(replace(recording, notes=(f"columns used: {used}",)), robot, gains, gear, coupling)
    check_sizes(recording)
    return recording


def torques(
    recording: Recording,
    robot: Robot,
    gains: Sequence[float] | None = None,
    gear: Sequence[float] | None = None,
    coupling: Sequence[Sequence[float]] | None = None,
) -> Recording:
    """The recording with the torques at the joints, tau = C (gear gain current), where it has currents instead.

    Args:
        gains: N m/A of each motor, at its shaft, or at the joint where no ``gear`` is given.
        gear: ratio of each gear, turns of the motor by turn of the joint, with its sign.
        coupling: C, shape (joints, motors), where motors act on several joints; None: each on its own.

    Raises:
        UserError: neither torques nor currents, no gains for currents, numbers that are not one for each joint.
    """
    n = len(robot.joints)
    have = set.intersection(*(set(trial.signals) for trial in recording.trials))
    lists = {"robot.gains": gains, "robot.gear": gear}
    for where, values in lists.items():
        if values is not None and (np.shape(values) != (n,) or not np.all(np.asarray(values, float) != 0)):
            raise UserError(
                "not one number for each joint",
                where=where,
                received=list(values),
                allowed=f"{n} numbers that are not 0",
            )
    C = np.eye(n) if coupling is None else np.asarray(coupling, float)
    if C.shape != (n, n) or np.linalg.matrix_rank(C) < n:
        raise UserError(
            "impossible coupling",
            where="robot.coupling",
            received=np.array2string(C, threshold=9),
            allowed=f"a {n} x {n} matrix that can be inverted, joints by motors",
        )
    if all(f"tau_{k + 1}" in have for k in range(n)):
        if gains is not None or gear is not None:
            raise UserError(
                "gains for torques that were recorded",
                where="robot.gains",
                received="columns of tau",
                allowed="columns of current with gains, or of tau without",
                fix="name data.columns.current, or leave robot.gains and robot.gear out",
            )
        source, scale = "tau", np.ones(n)
    elif all(f"current_{k + 1}" in have for k in range(n)):
        if gains is None:
            raise UserError(
                "currents without gains",
                where="robot.gains",
                received="nothing",
                allowed=f"{n} numbers, N m/A",
                fix="add 'robot.gains=[...]' and, where they are those of the motors' shafts, robot.gear",
            )
        source, scale = "current", np.asarray(gains, float) * (1.0 if gear is None else np.asarray(gear, float))
    else:
        names = ", ".join(sorted({n.rpartition("_")[0] for n in have})) or "none"
        raise UserError(
            "no torques in the recording",
            where="data.columns",
            received=names,
            allowed="tau, or current with robot.gains, for every joint",
            fix="name them: data.columns={..., tau: [...]} or {..., current: [...]}",
        )
    trials = []
    for trial in recording.trials:
        motors = np.stack([trial.signals[f"{source}_{k + 1}"] for k in range(n)], axis=1) * scale
        own = {f"tau_{k + 1}": values for k, values in enumerate((motors @ C.T).T)}
        rest = {name: y for name, y in trial.signals.items() if not name.startswith("current_")}
        trials.append(replace(trial, signals=rest | own))
    units = robot_units(robot)
    return replace(recording, trials=tuple(trials), units={name: units[name] for name in trials[0].signals})


def _columns(
    given: Mapping[str, Any] | None, present: Sequence[str], names: Sequence[str], where: str
) -> dict[str, str]:
    """Signal -> column, of joints of these names."""
    count = len(names)
    if given is None and present[:1] == ["c1"]:
        raise UserError(
            "no header row",
            where=where,
            received=f"numbers in {len(present)} columns",
            allowed="a first row that names the columns, or their places: c1 is the first",
            fix="say 'data.columns={t: c1, q: [c2, ...], tau: [...]}'",
        )
    asked = dict(given) if given is not None else {kind: f"{kind}_*" for kind in KINDS if f"{kind}_1" in present}
    table = {"t": str(asked.pop("t", "t"))}
    if table["t"] not in present and not re.match(r".+\[", table["t"]):
        raise UserError(
            "no time",
            where="data.columns.t",
            received=repr(table["t"]),
            allowed=", ".join(present),
            fix=nearest(table["t"], present) or "name its column: data.columns.t=...",
        )
    for kind, columns in asked.items():
        if re.fullmatch(rf"({'|'.join(KINDS)})_\d+", kind):
            table[kind] = str(columns)
            continue
        choose(kind, KINDS, "data.columns")
        if isinstance(columns, str) and "*" not in columns:
            columns = [columns]
        elif isinstance(columns, str):
            first = 0 if columns.replace("*", "0") in present else 1
            pattern, columns = columns, [columns.replace("*", str(first + k)) for k in range(count)]
            if (more := pattern.replace("*", str(first + count))) in present:
                raise UserError(
                    "more columns than joints",
                    where=f"data.columns.{kind}",
                    received=f"{columns[0]} to {more} at least",
                    allowed=f"{count} columns: {', '.join(names)}",
                    fix=f"name them in the order of the joints: data.columns={{t: {table['t']}, {kind}: [...], ...}}",
                )
        if not isinstance(columns, list | tuple) or len(columns) != count:
            raise UserError(
                "not one column for each joint",
                where=f"data.columns.{kind}",
                received=columns,
                allowed=f"{count} columns, or a pattern such as {kind}_*",
                fix="lock joints that were not recorded: robot.locked={finger: 0}",
            )
        table |= {f"{kind}_{k + 1}": str(column) for k, column in enumerate(columns)}
    if missing := [f"q_{k + 1}" for k in range(count) if f"q_{k + 1}" not in table]:
        raise UserError(
            "no positions in the recording",
            where="data.columns",
            received=f"without {missing[0]}",
            allowed="q for every joint",
            fix="name them: data.columns={..., q: [...]}",
        )
    lacking = [name for k in range(count) if (name := f"temperature_{k + 1}") not in table]
    if 0 < len(lacking) < count:
        raise UserError(
            "temperatures of some joints alone",
            where="data.columns",
            received=f"without {lacking[0]}",
            allowed="one column for each joint, or none",
            fix="name the nearest one there is more than once: data.columns={..., temperature: [...]}",
        )
    return table
