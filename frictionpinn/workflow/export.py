"""Hand the model of a run on: ONNX, C, MuJoCo."""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import choose
from ..export.c_code import write_c
from ..export.mujoco_model import write_mujoco
from ..export.onnx_model import write_onnx
from ..export.portable import PortableModel
from ..export.portable_state import PortableState
from ..export.state_c import write_state_c
from ..export.state_onnx import write_state_onnx
from ..models import StateModel
from ..physics import System
from ..physics.base import at_contact, contact_of, plain_name
from .build import Config, at_one_rate, build_recording
from .load import check_recording, load_run, refined
from .manifest import write_json
from .provenance import commit, versions
from .robot_export import export_robot, robot_of
from .train import quiet

log = logging.getLogger(__name__)

Details = dict[str, Any]
EXPORTS: dict[str, Callable[[Path, Any, Any], Details]] = {  # model with windows, PortableModel
    "onnx": write_onnx,
    "c": lambda folder, _, portable: {"files": write_c(folder, portable)},
    "mujoco": lambda folder, _, portable: {"files": write_mujoco(folder, portable)},
}
STATE_EXPORTS: dict[str, Callable[[Path, Any, Any], Details]] = EXPORTS | {  # StateModel, PortableState
    "onnx": write_state_onnx,
    "c": lambda folder, _, portable: {"files": write_state_c(folder, portable)},
}


def export(cfg: Config) -> dict[str, Details]:
    """Write the run's model in every wanted form to ``<run>/export/<form>/``, with ``export.json`` beside it.

    Of several contacts each has a folder of its own, ``<run>/export/<form>/<contact>/``; of MuJoCo they share one.

    Args:
        cfg: resolved conf/evaluate.yaml: run, export (a form of ``EXPORTS`` or a list of them). Of a robot's
            identification or diagnosis its forms, see :mod:`.robot_export`.

    Returns:
        form (``hinge.c`` with several contacts) -> what stands in its ``export.json``.

    Raises:
        UserError: an unknown form, an extra that is not installed, a folder that is no run, a recording that has
            changed since the training, an export that differs from its model.
    """
    wanted = cfg["export"] if isinstance(cfg["export"], list) else [cfg["export"]]
    if robot := robot_of(cfg["run"]):
        return export_robot(cfg, robot, [str(name) for name in wanted])
    quiet()
    names = [str(name) for name in wanted if choose(str(name), EXPORTS, "export")]
    trained, system, model = load_run(cfg["run"])
    interval = sampling_interval(cfg["run"], trained, system)
    better, results = refined(cfg["run"]), dict[str, Details]()
    for contact in model.contacts:
        values = {plain_name(name): value for name, value in better.items() if contact_of(name) == contact}
        own = model.map_of(contact)
        remembers = isinstance(own, StateModel)
        portable = (PortableState if remembers else PortableModel).of(own, system.at(contact), interval, values)  # type: ignore[arg-type]
        for name in names:
            folder = Path(cfg["run"]) / "export" / name / ("" if name == "mujoco" else contact)
            folder.mkdir(parents=True, exist_ok=True)
            details = (STATE_EXPORTS if remembers else EXPORTS)[name](folder, own, portable)
            results[at_contact(contact, name)] = {
                "model": portable.name,
                "system": system.name,
                **({"contact": contact} if contact else {}),
                "interval": {"value": portable.interval, "unit": "s"},
                **details,
                "versions": versions(),
                "commit": commit(),
            }
            told_in = f"{contact}_export.json" if contact and name == "mujoco" else "export.json"
            write_json(folder / told_in, results[at_contact(contact, name)])
            log.info(told(at_contact(contact, name), folder, details))
    return results


def told(name: str, folder: Path, details: Details) -> str:
    """One line for the terminal."""
    text = f"{name}: {', '.join(details['files'])} in {folder}"
    if "check" in details:
        difference = details["check"]["largest_difference"]
        text += f"; differs from torch by at most {difference['value']:.2g} {difference['unit']}"
        text += f" ({100 * details['check']['relative']:.2g} % of the force)"
    return text


def sampling_interval(run: str | Path, trained: Config, system: System) -> float:
    """Time between the samples that a run was trained on, s.

    Raises:
        UserError: its recording has changed since.
    """
    data = trained["data"]
    if data["name"] == "simulated":
        return 1.0 / float(data["rate_hz"])
    recording = build_recording(data, system)
    check_recording(run, recording)
    trial = at_one_rate(recording).trials[0]
    return float(np.median(np.diff(trial.t)))
