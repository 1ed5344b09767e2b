"""A robot's configuration made into what a fit needs: its file, its recording checked, its declared model."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from omegaconf import OmegaConf

from ..data.public import fetch
from ..data.recording import Recording
from ..data.sets import load_public
from ..errors import UserError, choose
from ..physics import LAWS
from ..physics.robot import Base, Robot
from ..robots.balance import Model
from ..robots.check import inspect_robot
from ..robots.identify import declare, joint_effect, without_motors
from ..robots.motion import Prepared, prepare
from ..robots.recording import TORQUE_AT, joint_names, read_robot
from .build import Config, mapping
from .configs import CONF, Configs
from .diagnose import split
from .vet import GO_ON, in_words

log = logging.getLogger(__name__)
# Options of other systems that would change what is fitted: of a robot nothing reads them.
EVERYWHERE = {
    "noise": "leave it out: recordings bring their own",
    "smoothing": "leave it out: the smoother of a joint is found from its positions",
}
OTHERS = {
    "gains": "name the columns data.columns.current, and one factor for each joint robot.gains",
    "rate_hz": "leave it out: torques are thinned to what the low-pass leaves (robot.cutoff_hz)",
    "max_samples": "leave it out: as many are read as there are",
    "validation": "say which trials take no part: data.held_out",
    "training_trials": "say which trials take no part: data.held_out",
}
# Of a log: what data=ur10e holds is known.
_HELD = "leave it out: data=ur10e holds torques at all six joints, in SI units"
READING = {
    "robot": dict.fromkeys(("gains", "gear", "coupling"), _HELD),
    "data": dict.fromkeys(("columns", "units"), _HELD),
}
ITS_JOINTS = dict.fromkeys(("joints", "locked"), "leave it out: in data=ur10e all six joints move")


@dataclass(frozen=True)
class Bench:
    """A robot, its recording in parts, its declared model, and the parts ready for the balance."""

    robot: Robot
    base: Base
    fitted: Recording
    held_out: Recording
    model: Model
    trials: tuple[list[Prepared], list[Prepared]]


def recorded(cfg: Config) -> tuple[Robot, Recording]:
    """Robot and recording of a configuration.

    Raises:
        UserError: anything that the user can mend.
    """
    r, data = cfg["robot"], cfg["data"]
    choose(str(r["torque"]), TORQUE_AT, "robot.torque")
    public = data["name"] == "ur10e"
    refuse_others("data", data, OTHERS, defaults("check", cfg)["data"])
    if data.get("for_system") not in (None, "robot") or data["name"] not in ("csv", "ur10e"):
        raise UserError(
            "data of another system",
            where="data",
            received=f"{data['name']} with system=robot",
            allowed="csv, ur10e",
            fix="say data=csv data.path=...",
        )
    if public:
        for section, names in READING.items():
            refuse_others(section, cfg[section], names)
        if r["file"] == "ur10e":  # a file of the user's may have a gripper, too
            refuse_others("robot", r, ITS_JOINTS)
    robot = Robot.read(robot_file(cfg), r["joints"], mapping(r, "locked", "robot"), r["gravity"])
    if public:
        return robot, load_public("ur10e", **(data.get("options") or {}))
    recording = read_robot(
        data["path"],
        robot,
        columns=data.get("columns"),
        units=mapping(data, "units", "data") or None,
        trial_column=data.get("trial_column"),
        delimiter=data.get("delimiter"),
        decimal=data.get("decimal"),
        gains=r["gains"],
        gear=r["gear"],
        coupling=r["coupling"],
    )
    return robot, recording


def robot_file(cfg: Config) -> str | Path:
    """The robot's file: the user's, or that of the public recordings."""
    own = cfg["robot"]["file"]
    return fetch("ur10e", ["urdf"])["urdf"] if own == "ur10e" and cfg["data"]["name"] == "ur10e" else own


def defaults(command: str, cfg: Config) -> Config:
    """The configuration of a command with a robot and these data, without anything that a user has changed."""
    configs, data = Configs(CONF, command), cfg["data"]["name"]
    with configs.opened():
        made = configs.compose(["system=robot", *([f"data={data}"] if data in configs.options("data") else [])])
        return OmegaConf.to_container(made, resolve=True)  # type: ignore[return-value]


def refuse_others(section: str, options: Config, names: Mapping[str, str], usual: Config | None = None) -> None:
    """Raise :class:`UserError` for an option that nothing reads of a robot.

    Args:
        section: of the configuration; empty for its top.
        options: in it.
        names: of such options -> what to do instead.
        usual: the section as it is by itself, see :func:`defaults`; None: all of these options are null there.
    """
    for name, fix in names.items():
        value, before = options.get(name), (usual or {}).get(name)
        if value == before or not (value or before):
            continue
        received, allowed = value, before
        if isinstance(value, dict) and isinstance(before, dict) and value.get("name") != before.get("name"):
            received, allowed = value.get("name"), before.get("name")  # the choice of a group
        raise UserError("an option that a robot does not have", where=f"{section}.{name}".lstrip("."),
                        received=plainly(received), allowed=plainly(allowed), fix=fix)  # fmt: skip


def plainly(value: Any) -> str:
    """A value as it is written in an option."""
    return "null" if value is None else str(value)


def bench(cfg: Config) -> Bench:
    """Everything that a fit needs, the recording checked.

    Raises:
        UserError: anything that the user can mend; a finding by which no answer would have a sense.
    """
    robot, recording = recorded(cfg)
    motor = TORQUE_AT[cfg["robot"]["torque"]]
    for line in (*recording.notes, *(note for trial in recording.trials for note in trial.notes)):
        log.info(line)
    findings = inspect_robot(robot, recording, motor=motor)
    for finding in findings:
        log.warning(in_words(finding))
    refuse = choose(cfg["data"].get("check", "refuse"), {"refuse": True, "warn": False}, "data.check")
    if refuse and (grave := [f for f in findings if f.grave]):
        more = f" (and {len(grave) - 1} more)" if len(grave) > 1 else ""
        raise UserError(
            f"no answer from this recording has a sense{more}: {grave[0].what}",
            where=recording.source,
            fix="; ".join(filter(None, [grave[0].fix, GO_ON])),
        )
    fitted, held_out = split(recording, cfg["data"])
    base = Base.of(robot)
    model = _declared(cfg, robot, base, motor)
    cutoff = cfg["robot"]["cutoff_hz"]
    if cutoff is not None and (isinstance(cutoff, bool) or not isinstance(cutoff, int | float)):
        raise UserError("not a number", where="robot.cutoff_hz", received=repr(cutoff), allowed="Hz, or null")
    both = prepare(replace(recording, trials=(*fitted.trials, *held_out.trials)), robot, base, cutoff, fitted)
    parts = both[: len(fitted.trials)], both[len(fitted.trials) :]
    return Bench(robot, base, fitted, held_out, model, parts)


def _declared(cfg: Config, robot: Robot, base: Base, motor: bool) -> Model:
    """The declared model: a law for all joints or for each, effects at each or at a named one."""
    names, friction = joint_names(len(robot.joints)), cfg["friction"]
    own = mapping(friction, "contacts", "friction")
    for joint in own:
        choose(joint, dict.fromkeys(names), "friction")
    laws = [choose(own.get(name, friction["name"]), LAWS, "friction")() for name in names]
    table: dict[str, list[str]] = {name: [] for name in names}
    for item in (cfg.get("diagnose") or {}).get("declared") or []:
        kind, _, joint = str(item).partition("@")
        joint_effect(kind)
        for name in [joint] if joint else names:
            choose(name, table, "diagnose.declared").append(kind)
    fixed, start = (
        {n: v for n, v in mapping(friction, key, "friction").items() if v is not None} for key in ("fixed", "start")
    )
    model = declare(robot, base, laws, table, cfg["robot"]["inertia"], _flat(fixed), _flat(start))
    if motor:
        return model
    log.warning("robot.torque=link: torques behind the gear hold the friction of bearings alone, not of motor and gear")
    return without_motors(model)


def _flat(table: dict[str, Any]) -> dict[str, float]:
    """Values by full name: of joints' tables, too."""
    flat: dict[str, float] = {}
    for name, value in table.items():
        flat |= {f"{name}.{n}": float(v) for n, v in value.items()} if isinstance(value, dict) else {name: float(value)}
    return flat
