"""Runs that differ by their seed alone, trained as one program and left as if each had been trained by itself."""

from __future__ import annotations

import shutil
import time
from collections.abc import Sequence
from pathlib import Path

import torch

from ..models import FrictionEnsemble, FrictionModel
from ..models.ensemble import ALONE
from .build import Config, build_system
from .experiment import build_data, remembers
from .load import load_run
from .manifest import write_json
from .result import report
from .rollout import rollout
from .train import train


def as_one(cfg: Config) -> bool:
    """Whether :func:`train_seeds` takes a configuration: its steps do not depend on the loss of one training, and it
    has no state, for which noise moves where a trial is cut."""
    return cfg["optimizer"]["name"] not in ALONE and not remembers(cfg["model"])


def train_seeds(cfg: Config, folders: Sequence[Path]) -> None:
    """Train ``seed``, ``seed + 1``, ... of a configuration together; a folder for each, as :func:`.train` writes it.

    Every run has the noise, the start weights and the steps of its own seed. Its ``seconds`` are its share.

    Args:
        cfg: of the first seed, without an ensemble; one that trains :func:`as_one`.
        folders: of the seeds in order; what they hold is removed.

    Raises:
        UserError: anything that the user can mend.
    """
    whole = folders[0].with_name(f"{folders[0].name}_and_{len(folders) - 1}_more")
    shutil.rmtree(whole, ignore_errors=True)
    whole.mkdir(parents=True)
    told = train(cfg | {"ensemble": len(folders), "ensemble_over": "noise", "rollout": False}, whole)["training"]
    trained = load_run(whole)[2]
    if not isinstance(trained, FrictionEnsemble):
        raise TypeError("an ensemble was trained")
    share = {name: value / len(folders) for name, value in told["seconds"].items()}
    for k, (model, folder) in enumerate(zip(trained.members(), folders, strict=True)):
        shutil.rmtree(folder, ignore_errors=True)
        _leave(cfg | {"seed": cfg["seed"] + k}, folder, model, told | {"seconds": share, "together": len(folders)})
    shutil.rmtree(whole)


def _leave(cfg: Config, folder: Path, model: FrictionModel, training: Config) -> None:
    """Checkpoint, figures, friction in motion and result of one run."""
    begin = time.perf_counter()
    system = build_system(cfg["system"])
    data = build_data(cfg, system)
    data.prepare_for(model)
    (folder / "checkpoints").mkdir(parents=True)
    checkpoint = {"hyper_parameters": dict(model.hparams), "state_dict": model.state_dict()}
    torch.save(checkpoint, folder / "checkpoints" / "best.ckpt")
    seconds = training["seconds"] | {"total": training["seconds"]["total"] + time.perf_counter() - begin}
    result = report(cfg, folder, system, data, model, training | {"seconds": seconds})
    if cfg.get("rollout"):
        result["rollout"] = rollout(system, data, model, folder)
    write_json(folder / "result.json", result)
