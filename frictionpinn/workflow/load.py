"""Load a finished training run: its configuration, its system and its model."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from ..data.recording import Recording
from ..errors import UserError, nearest
from ..models import MODELS, FrictionModel, rebuilt
from ..physics import System, extensions
from ..physics.mechanism import Mechanism
from .build import Config, build_system
from .checkpoints import load_checkpoint


def load_run(folder: str | Path, where: str = "run") -> tuple[Config, System, FrictionModel]:
    """Rebuild what a run trained, from its ``result.json`` and ``checkpoints/best.ckpt``.

    Args:
        folder: of the run.
        where: the option that names it, for error messages.

    Returns:
        the resolved configuration of the training, the system with its values, and the model with its best weights,
        ready to predict.

    Raises:
        UserError: no such folder, a file of a run that is missing or unreadable, a checkpoint of another model.
    """
    folder = Path(folder)
    cfg = _configuration(folder, where)
    extensions.load(cfg.get("extensions") or ())
    checkpoint = load_checkpoint(folder / "checkpoints" / "best.ckpt", where)
    options: dict[str, Any] = dict(checkpoint.get("hyper_parameters") or {})
    if options.get("name") not in MODELS or options["name"] != cfg["model"]["name"]:
        raise UserError(
            "checkpoint of another model than the run's",
            where=str(folder / "checkpoints" / "best.ckpt"),
            received=options.get("name"),
            allowed=cfg["model"]["name"],
            fix="give a folder that train.py wrote",
        )
    model = rebuilt(options)
    try:
        model.load_state_dict(checkpoint["state_dict"])
    except (KeyError, RuntimeError) as error:
        fix = "use a run of this version"
        raise UserError("weights that do not fit", where=str(folder / "checkpoints" / "best.ckpt"), fix=fix) from error
    return cfg, build_system(cfg["system"]), model.eval()


def check_recording(folder: str | Path, recording: Recording) -> None:
    """Raise :class:`UserError` where the files of a run are no longer those that it was trained on."""
    told = (json.loads((Path(folder) / "result.json").read_text(encoding="utf-8")).get("data") or {}).get("sha256")
    if told and told != recording.checksum:
        raise UserError("not the recording that the run was trained on", where=recording.source,
                        received=f"a file with sha256 {recording.checksum[:8]}...", allowed=f"{told[:8]}...",
                        fix="bring the earlier file back, or train again")  # fmt: skip


def refined(run: str | Path, complete: bool = True) -> dict[str, float]:
    """The law's parameters that the run refined; empty where it did not.

    Raises:
        UserError: with ``complete``, where one of them has no value.
    """
    path = Path(run) / "result.json"
    table = (json.loads(path.read_text(encoding="utf-8")).get("refined") or {}).get("parameters") or {}
    values = {name: entry.get("value") for name, entry in table.items()}
    missing = [name for name, value in values.items() if value is None]
    if missing and complete:
        raise UserError("a refined parameter has no value", where=str(path), received=", ".join(missing))
    return {name: float(value) for name, value in values.items() if value is not None}


def trained_parameters(folder: str | Path, mechanism: Mechanism, where: str = "start") -> dict[str, float]:
    """The parameters that a run of train.py found for this mechanism's law, SI units; refined ones where it refined.

    Raises:
        UserError: no such run; a run on another system; a black box, or a law with other parameters.
    """
    _, system, model = load_run(folder, where)
    if system.name != mechanism.system.name:
        raise UserError("run on another system", where=where, received=f"{folder}, {system.name}",
                        allowed=f"a run on {mechanism.system.name}", fix=f"say system={system.name}")  # fmt: skip
    values = model.physical() | refined(folder, complete=False)
    names = [par.name for par in mechanism.law.parameters if par.value is None]
    if not set(names) & set(values):
        raise UserError(
            "run without parameters of this law",
            where=where,
            received=f"{folder}, {model.hparams['name']}",
            allowed="a run of pe1 or pe2",
            fix="train one: python train.py model=pe2",
        )
    return {name: values[name] for name in names if name in values}


def _configuration(folder: Path, where: str) -> Config:
    if not folder.is_dir():
        parent = next((item for item in folder.parents if item.is_dir()), Path())
        present = sorted(str(item) for item in parent.iterdir() if item.is_dir() and not item.name.startswith("."))
        raise UserError(
            "no such folder",
            where=where,
            received=str(folder),
            allowed=", ".join(present[-8:]) or "the folder of a training run",
            fix=nearest(str(folder), present) or "give the folder that train.py names when it ends",
        )
    path = folder / "result.json"
    if not path.is_file():
        found = [item.parent for item in folder.glob("**/result.json")]
        inside = sorted(str(item) for item in found if not item.name.startswith("evaluation"))
        raise UserError(
            "not a finished training run: it has no result.json",
            where=where,
            received=str(folder),
            allowed=", ".join(inside[-8:]) or "a folder that train.py wrote",
            fix=f"did you mean '{inside[-1]}'?" if inside else "wait for the training's end, or train again",
        )
    try:
        result = json.loads(path.read_text(encoding="utf-8"))
        trained = "model" in result["config"]
        cfg = _checked(result) if trained else {}
    except (ValueError, KeyError, TypeError) as error:
        raise UserError("unreadable result of a run", where=str(path), fix=f"train again ({error})") from error
    if not trained:
        raise UserError("no training run: it holds no model", where=where, received=str(folder),
                        allowed="a folder that train.py wrote",
                        fix="what identify.py and diagnose.py write of a robot is handed on with export=")  # fmt: skip
    return cfg


def _checked(result: Any) -> Config:
    cfg = result["config"]
    for key in ("system", "model", "friction", "data", "noise", "smoothing", "seed"):
        cfg[key]
    return cfg
