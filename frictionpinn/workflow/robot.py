"""Commands for a robot (``system=robot``): check, identify and diagnose, from a configuration to files."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..data.findings import Finding
from ..errors import UserError, choose, nearest
from ..physics.base import contact_of, plain_name
from ..physics.robot import INERTIAL, INERTIAL_UNITS
from ..report.robot import draw, headline, in_text, not_converged, rows, write_page
from ..robots.balance import as_text
from ..robots.candidates import AT_JOINTS, ON_ROBOT
from ..robots.check import inspect_robot
from ..robots.diagnose import diagnose as run_diagnosis
from ..robots.identify import identify as run_identification
from ..robots.identify import relative_errors
from ..robots.least_squares import Solution
from ..robots.recording import TORQUE_AT, robot_units
from ..robots.rounds import Settings
from ..robots.whole import carries
from ..show import plain, readable_unit
from .build import Config, mapping
from .configs import called
from .manifest import write_json
from .provenance import commit, versions
from .robot_bench import EVERYWHERE, Bench, bench, defaults, recorded, refuse_others
from .vet import in_words

log = logging.getLogger(__name__)
# Of other systems: a robot's motion is taken as measured, its parameters' scales are found from the recording.
SEARCHES = {
    "methods": "leave it out: a robot has one estimator, least squares of its balance",
    "seeds": "leave it out: nothing is drawn at random",
    "start": "give friction.start",
    "epochs": "leave it out: no network is trained",
    "simulations": "leave it out: nothing is simulated",
    "jobs": "leave it out: there is one fit",
    "bounds": "leave it out: there are none; hold a parameter with friction.fixed",
}
FITS = {
    "inputs": "leave it out: the motion is smoothed beforehand",
    "initial": "leave it out: nothing is simulated",
    "loss": "leave it out: the fit is least squares",
    "samples": "leave it out: all samples are looked at",
    "free": "hold parameters with friction.fixed, bodies with robot.inertia=known",
    "fallback": "leave it out: what is left is told as a function of one variable",
    "signals": "leave it out: torques are compared",
    "windows": "leave it out: nothing is simulated",
}
LAW = {
    "bounds": "give friction.start, or hold a parameter: friction.fixed.joint_2.mu_s=6",
    "tie_sigma1": "leave it out",
}
LINKED = ("load_friction", "load_direction")  # friction of gears: a torque behind the gear does not hold it


def check(cfg: Config) -> list[Finding]:
    """Print what a robot's recording is and what speaks against it.

    Raises:
        UserError: it cannot be read, or a finding is grave.
    """
    usual = defaults("check", cfg)
    refuse_others("", cfg, EVERYWHERE | {"free": "leave it out: robot.inertia=free estimates the bodies"}, usual)
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


def identify(cfg: Config, folder: Path) -> dict[str, Any]:
    """Identify the declared model; write ``result.json``, print the joints' parameters.

    Raises:
        UserError: anything that the user can mend.
    """
    refuse_others("", cfg, SEARCHES | EVERYWHERE, defaults("identify", cfg))
    _refuse(cfg)
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
    if said := not_converged(solution):
        log.warning(said)
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
    options, usual = cfg["diagnose"], defaults("diagnose", cfg)
    refuse_others("", cfg, EVERYWHERE, usual)
    refuse_others("diagnose", options, FITS, usual["diagnose"])
    _refuse(cfg)
    b = bench(cfg)
    settings = _settings(cfg, options, b.fitted.names)
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


def _refuse(cfg: Config) -> None:
    """Raise :class:`UserError` for what other systems' laws have."""
    friction = cfg["friction"]
    bounds = {name: x for name, x in mapping(friction, "bounds", "friction").items() if x is not None}
    refuse_others("friction", {**friction, "bounds": bounds}, LAW)


def _settings(cfg: Config, options: Config, trials: Sequence[str]) -> Settings:
    effects: tuple[str, ...] = AT_JOINTS
    robot: tuple[str, ...] = ON_ROBOT
    if options["effects"] != "all":
        known = dict.fromkeys((*AT_JOINTS, *ON_ROBOT))
        names = [str(n) for n in options["effects"]]
        for name in names:
            choose(name, known, "diagnose.effects", "name effects alone: each is tried in every joint")
        effects, robot = (tuple(n for n in kinds if n in names) for kinds in (AT_JOINTS, ON_ROBOT))
    if not TORQUE_AT[cfg["robot"]["torque"]]:
        effects = tuple(n for n in effects if n not in LINKED)
    suspected = cfg["robot"]["payload"]
    if suspected is not None and not isinstance(suspected, list):
        raise UserError("not a list of trials", where="robot.payload", received=repr(suspected), allowed="[loaded]")
    for name in suspected or ():
        if not any(carries(str(name), trial) for trial in trials):
            raise UserError("no such trial among those that are fitted", where="robot.payload", received=repr(name),
                            allowed=", ".join(trials), fix=nearest(name, trials) or "use their names")  # fmt: skip
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
