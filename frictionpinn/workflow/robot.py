"""Commands for a robot (``system=robot``): check, identify and diagnose, from a configuration to files."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..data.findings import Finding
from ..data.public import fetch
from ..data.recording import Recording
from ..data.sets import load_public
from ..errors import UserError, choose
from ..identify.result import plain
from ..physics import LAWS
from ..physics.base import contact_of, plain_name
from ..physics.robot import INERTIAL, INERTIAL_UNITS, Base, Robot
from ..report.robot import draw, headline, in_text, rows, write_page
from ..robots.balance import Model, as_text
from ..robots.candidates import AT_JOINTS, ON_ROBOT
from ..robots.check import inspect_robot
from ..robots.diagnose import diagnose as run_diagnosis
from ..robots.identify import declare, joint_effect, relative_errors
from ..robots.identify import identify as run_identification
from ..robots.least_squares import Solution
from ..robots.motion import Prepared, prepare
from ..robots.recording import TORQUE_AT, joint_names, read_robot, robot_units
from ..robots.rounds import Settings
from ..show import readable_unit
from .build import Config, mapping
from .configs import called
from .diagnose import split
from .manifest import write_json
from .provenance import commit, versions
from .vet import GO_ON, in_words

log = logging.getLogger(__name__)
LINKED = ("load_friction", "load_direction")  # friction of gears: a torque behind the gear does not hold it


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
    if data.get("for_system") not in (None, "robot") or data["name"] not in ("csv", "ur10e"):
        raise UserError(
            "data of another system",
            where="data",
            received=f"{data['name']} with system=robot",
            allowed="csv, ur10e",
            fix="say data=csv data.path=...",
        )
    file = fetch("ur10e", ["urdf"])["urdf"] if public and r["file"] == "ur10e" else r["file"]
    robot = Robot.read(file, r["joints"], mapping(r, "locked", "robot"), r["gravity"])
    if public:
        return robot, load_public("ur10e", **(data.get("options") or {}))
    recording = read_robot(
        data["path"],
        robot,
        columns=data.get("columns"),
        units=mapping(data, "units", "data") or None,
        trial_column=data.get("trial_column"),
        gains=r["gains"],
        gear=r["gear"],
        coupling=r["coupling"],
    )
    return robot, recording


def check(cfg: Config) -> list[Finding]:
    """Print what a robot's recording is and what speaks against it.

    Raises:
        UserError: it cannot be read, or a finding is grave.
    """
    robot, recording = recorded(cfg)
    count, lengths = len(recording.trials), [float(t.t[-1] - t.t[0]) for t in recording.trials]
    print(
        f"{recording.source}: {len(recording)} samples in {count} trial{'s' if count > 1 else ''}, "
        f"{sum(lengths):.4g} s, {len(robot.joints)} joints of {robot.name}"
    )
    for line in (*recording.notes, *(note for trial in recording.trials for note in trial.notes)):
        print(line)
    findings = inspect_robot(robot, recording, motor=TORQUE_AT[cfg["robot"]["torque"]])
    for finding in findings:
        print(in_words(finding))
    if grave := [f for f in findings if f.grave]:
        raise UserError(
            f"{len(grave)} finding{'s' if len(grave) > 1 else ''} by which no answer would have a sense",
            where=recording.source,
            fix="mend what is told to be wrong",
        )
    print("nothing speaks against this recording" if not findings else "nothing grave speaks against this recording")
    print(f"next: {called('diagnose')} with the same options says what each joint's model lacks")
    return findings


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
    return replace(model, free=tuple(n for n in model.free if not n.startswith("armature.")))


def _flat(table: dict[str, Any]) -> dict[str, float]:
    """Values by full name: of joints' tables, too."""
    flat: dict[str, float] = {}
    for name, value in table.items():
        flat |= {f"{name}.{n}": float(v) for n, v in value.items()} if isinstance(value, dict) else {name: float(value)}
    return flat


def identify(cfg: Config, folder: Path) -> dict[str, Any]:
    """Identify the declared model; write ``result.json``, print the joints' parameters.

    Raises:
        UserError: anything that the user can mend.
    """
    b = bench(cfg)
    fitted, held_out = b.trials
    solution = run_identification(b.model, fitted)
    errors = relative_errors(solution.model, [*fitted, *held_out])
    result: dict[str, Any] = {
        "robot": _robot(b),
        "data": _data(b),
        "parameters": parameters(solution),
        "torque_error": {name: [float(x) for x in e] for name, e in errors.items()},
        "converged": solution.converged,
        "model": as_text(solution.model),
        "versions": versions(),
        "commit": commit(),
        "config": cfg,
    }
    folder.mkdir(parents=True, exist_ok=True)
    write_json(folder / "result.json", result)
    for name, p in result["parameters"].items():
        if not name.startswith("inertia."):
            told = "" if p["told"] else " (not told by these data)"
            log.info(
                f"  {name} = {p['value']:.4g} {readable_unit(p['unit'])} "
                f"[{p['ci95'][0]:.4g} to {p['ci95'][1]:.4g}]{told}"
            )
    for name, e in errors.items():
        log.info(
            f"relative torque error, {name}: {', '.join(f'{100 * x:.1f}' for x in e)}, mean {100 * e.mean():.1f} %"
        )
    log.info(f"result.json is in {folder}")
    log.info(f"next: {called('diagnose')} with the same options says what each joint lacks")
    return result


def diagnose(cfg: Config, folder: Path) -> dict[str, Any]:
    """Diagnose the declared model joint by joint; write result.json, figures and the page.

    Raises:
        UserError: anything that the user can mend.
    """
    options, b = cfg["diagnose"], bench(cfg)
    settings = _settings(cfg, options)
    fitted, held_out = b.trials
    log.info(
        f"diagnosing {b.robot.name} on {b.fitted.source}: fitted to {', '.join(b.fitted.names)}; held out: "
        f"{', '.join(b.held_out.names) or 'none'}; low-pass {fitted[0].cutoff_hz:.3g} Hz"
    )
    d = run_diagnosis(b.model, fitted, held_out, settings)
    told = parameters(d.fit)
    folder.mkdir(parents=True, exist_ok=True)
    result: dict[str, Any] = {
        "robot": _robot(b),
        "data": _data(b),
        "verdicts": dict(d.verdicts),
        "joints": rows(d),
        "effects": [
            {
                "name": a.term.name,
                "joint": None if a.term.joint is None else b.model.names[a.term.joint],
                "parameters": {n: told[n] for n in a.term.names(d.fit.model) if n in told},
                "share_of_friction": a.tried.size,
                "log10_p": plain(a.tried.scored.log_p),
                "cross_validated_gain": [plain(c.gain), plain(c.error)],
                "share": plain(c.share),
                "indistinguishable_from": list(a.alike),
            }
            for a in d.accepted
            if (c := a.tried.confirmed) is not None
        ],
        "unexplained": {
            j: {"depends_on": list(r.variables), "kind": r.kind, "log10_p": plain(r.log_p), "size": plain(r.size)}
            for j, r in d.rest.items()
        },
        "negligible": {
            j: {"depends_on": list(r.variables), "kind": r.kind, "size": plain(r.size)} for j, r in d.trifles.items()
        },
        "refused": [{"name": n, "why": w} for n, w in d.refused.items()],
        "torque_error": {
            n: {
                "before": [float(x) for x in e[0]],
                "after": [float(x) for x in e[1]],
                "held_out": n in b.held_out.names,
            }
            for n, e in d.errors.items()
        },
        "parameters": told,
        "declared": parameters(d.declared),
        "model": as_text(d.fit.model),
        "cutoff_hz": fitted[0].cutoff_hz,
        "seconds": round(d.seconds, 2),
        "versions": versions(),
        "commit": commit(),
        "config": cfg,
    }
    paths = draw(folder / "figures", d)
    result["headline"] = headline(d)
    result["figures"] = [str(p.relative_to(folder)) for p in paths]
    write_json(folder / "result.json", result)
    write_page(folder / "report.html", result, paths)
    for line in in_text(d):
        log.info(line)
    log.info(f"result.json, figures and the page report.html are in {folder}")
    return result


def _settings(cfg: Config, options: Config) -> Settings:
    effects: tuple[str, ...] = AT_JOINTS
    robot: tuple[str, ...] = ON_ROBOT
    if options["effects"] != "all":
        known = dict.fromkeys((*AT_JOINTS, *ON_ROBOT))
        names = [str(n).partition("@")[0] for n in options["effects"]]
        for name in names:
            choose(name, known, "diagnose.effects")
        effects, robot = (tuple(n for n in kinds if n in names) for kinds in (AT_JOINTS, ON_ROBOT))
    if not TORQUE_AT[cfg["robot"]["torque"]]:
        effects = tuple(n for n in effects if n not in LINKED)
    suspected = cfg["robot"]["payload"]
    if suspected is not None and not isinstance(suspected, list):
        raise UserError("not a list of trials", where="robot.payload", received=repr(suspected), allowed="[loaded]")
    return Settings(
        float(options["log10_p"]),
        float(options["worth"]),
        int(options["most"]),
        effects,
        robot,
        None if suspected is None else tuple(str(n) for n in suspected),
    )


def _robot(b: Bench) -> dict[str, Any]:
    return {
        "name": b.robot.name,
        "joints": dict(zip(b.model.names, b.robot.joints, strict=True)),
        "friction": [law.name for law in b.model.laws],
        "declared": {n: [e.name for e in effects] for n, effects in zip(b.model.names, b.model.effects, strict=True)},
    }


def _data(b: Bench) -> dict[str, Any]:
    return {
        "source": b.fitted.source,
        "sha256": b.fitted.checksum,
        "fitted": list(b.fitted.names),
        "held_out": list(b.held_out.names),
    }


def parameters(solution: Solution) -> dict[str, dict[str, Any]]:
    """Estimated parameters with units and 95 % intervals."""
    model, units = solution.model, robot_units(solution.model.robot)
    whole = {name: unit for w in model.whole for name, unit in w.parameters.items()}
    found = {}
    for name in model.free:
        joint, own = contact_of(name), plain_name(name)
        if name.startswith("inertia."):
            unit = dict(zip(INERTIAL, INERTIAL_UNITS, strict=True))[own]
        elif name.startswith("armature."):
            unit = "kg*m^2" if units[f"tau_{own.rpartition('_')[2]}"] == "N*m" else "kg"
        elif name in whole:
            unit = whole[name]
        else:
            mechanism = model.friction(model.names.index(joint)).mechanism
            unit = mechanism.system.force_unit if own in ("mu_c", "mu_s") else mechanism.units[own]
        found[name] = {
            "value": model.values[name],
            "unit": unit,
            "ci95": [plain(float(x)) for x in np.array(solution.interval(name))],
            "told": solution.told(name),
        }
    return found
