"""Hand the robot of an identification or diagnosis on to other simulators."""

from __future__ import annotations

import json
import logging
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import UserError
from ..physics.base import FrictionLaw
from ..physics.friction import CONTACT_LAWS
from ..physics.robot import Base
from ..report.robot import write_page
from ..robots.arm import Arm
from ..robots.handing_on import hand_on
from ..robots.identify import declare
from ..robots.motion import prepare
from ..robots.whole import LAG
from .build import Config
from .diagnose import split
from .manifest import RESULT, write_json
from .provenance import commit, versions
from .robot_bench import recorded, robot_file

log = logging.getLogger(__name__)
EXACT = 1e-6  # of the base parameters: a difference that no torque shows


def robot_of(run: str | Path) -> dict[str, Any] | None:
    """What a robot's run found; None where the folder is no such run."""
    path = Path(run) / RESULT
    if not path.is_file():
        return None
    result = json.loads(path.read_text(encoding="utf-8"))
    return result if "robot" in result and "model" in result else None


def export_robot(cfg: Config, result: dict[str, Any], forms: list[str]) -> dict[str, Any]:
    """Write the run's robot in every wanted form to ``<run>/export/<form>/``, with ``export.json`` beside them.

    What a form lacks is fitted and judged along the longest trial that the robot was identified on.

    Raises:
        UserError: an unknown form, an extra that is not installed, a recording or robot file that is gone.
    """
    config, model = result["config"], result["model"]
    robot, recording = recorded(config)
    base = Base.of(robot)
    laws: list[FrictionLaw] = [CONTACT_LAWS[name]() for name in model["friction"].values()]
    declared = declare(robot, base, laws, model["effects"])
    if missing := set(declared.values) - set(model["values"]):
        raise UserError("a run of another robot file or version", where="run", received=", ".join(sorted(missing)[:3]),
                        allowed=", ".join(list(model["values"])[:3]), fix="run it again")  # fmt: skip
    fitted = replace(declared, values=model["values"], free=tuple(model["free"]))
    arm = Arm.identified(fitted)
    longest = max(split(recording, config["data"])[0].trials, key=len)
    (trial,) = prepare(replace(recording, trials=(longest,)), robot, base, config["robot"]["cutoff_hz"])
    folder = Path(cfg["run"]) / "export"
    handed = hand_on(arm, robot_file(config), folder, (trial.t, trial.q, trial.v, trial.a), forms)
    notes = [f"left out of every form: {name}" for name in model["whole"] if name != LAG]
    if arm.misfit > EXACT:
        bodies, friction = arm.torques(trial.t, trial.q, trial.v, trial.a)
        off = bodies - arm.armature * trial.a - trial.Y @ fitted.beta
        shares = np.sqrt(np.mean(off**2, axis=0) / np.mean((bodies + friction) ** 2, axis=0))
        told = ", ".join(f"{100 * share:.2g} %" for share in shares)
        notes.append(f"which changes the joints' torques along the motion by {told} (rms)")
        notes.append("robot.inertia=prior or known estimates bodies nearer to the file's")
    table = handed.to_dict() | {"motion": trial.name, "versions": versions(), "commit": commit()}
    table |= {"notes": [*handed.notes, *notes]}
    write_json(folder / "export.json", table)
    if "headline" in result:
        figures = [Path(cfg["run"]) / name for name in result["figures"]]
        write_page(Path(cfg["run"]) / "report.html", result | {"handed_on": table}, figures)
    for line in (*(line for shown in handed.tables() for line in shown.text().splitlines()), *notes):
        log.info(line)
    log.info(f"{', '.join(forms)} in {folder}; along trial {trial.name}")
    return table
