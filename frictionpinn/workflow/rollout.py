"""The step of a training that fits the friction in motion, and its checkpoint."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

import torch

from ..data.module import TrajectoryData
from ..errors import UserError
from ..evaluate.characteristics import mobility
from ..models import FrictionModel
from ..models.in_motion import InMotion
from ..physics import System
from .build import Config
from .checkpoints import load_checkpoint

log = logging.getLogger(__name__)
FILE = "in_motion.ckpt"


def check_rollout(cfg: Config, system: System) -> None:
    """Raise :class:`UserError` where no single network without a past is trained."""
    if cfg.get("rollout") and len(system.contacts) > 1:
        raise UserError("a friction at rest is fitted on a system with one contact", where="rollout", received="true",
                        allowed=f"false for system={system.name}", fix="leave rollout=false")  # fmt: skip
    if cfg.get("rollout") and (cfg["model"]["name"] not in ("bb1", "pe1") or int(cfg.get("ensemble", 1)) > 1):
        raise UserError(
            "only a single network without a past is fitted in motion",
            where="rollout",
            received=f"true with model={cfg['model']['name']} ensemble={cfg.get('ensemble', 1)}",
            allowed="model=bb1 or model=pe1, ensemble=1",
            fix="choose one of them, or leave rollout=false",
        )


def rollout(system: System, data: TrajectoryData, model: FrictionModel, folder: Path) -> dict[str, Any]:
    """Fit, and write ``checkpoints/in_motion.ckpt``; return what ``result.json`` holds of it."""
    from ..models.rollout import fit_in_motion  # compiles on a new installation: not before it is needed

    log.info("simulating the training trials with the network in the equation of motion")
    slope = 0.0 if system.massless else mobility(system)
    friction, told = fit_in_motion(model, system, data.select("train"), slope)
    torch.save(friction.checkpoint(), folder / "checkpoints" / FILE)
    return told


def load_in_motion(folder: str | Path, model: FrictionModel) -> InMotion | None:
    """The friction in motion of a run; None where it was not fitted."""
    path = Path(folder) / "checkpoints" / FILE
    return InMotion.restore(model, load_checkpoint(path, "run")) if path.is_file() else None
