"""Training of an ensemble: its members, their best weights, the uncertainty that their spread gives."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import lightning as L
import numpy as np
import torch

from ..data.contact import ContactTrial
from ..data.module import TrajectoryData
from ..errors import UserError, choose
from ..evaluate.force import reference_force
from ..models import FrictionEnsemble, FrictionModel, ensemble_of
from ..numerics.whiteness import NORMAL_95
from ..physics import System
from .build import Config, seed_of
from .experiment import build_data, build_model

COVERAGE = 0.95  # of the interval


def size_of(cfg: Config) -> int:
    """Number of members, checked; 1 is no ensemble."""
    size = cfg.get("ensemble", 1)
    if isinstance(size, bool) or not isinstance(size, int) or size < 1:
        raise UserError("impossible ensemble", where="ensemble", received=repr(size), allowed="a whole number from 1")
    over = choose(cfg.get("ensemble_over", "seed"), {"seed": "seed", "noise": "noise"}, "ensemble_over")
    if size == 1 and over != "seed":
        raise UserError("an option that nothing reads", where="ensemble_over", received=over,
                        allowed="with ensemble from 2", fix="say ensemble=8, or leave it out")  # fmt: skip
    return size


def prepare(cfg: Config, system: System) -> tuple[TrajectoryData, FrictionModel]:
    """Data and model of the configuration; for an ensemble every member as its own run would have it.

    Member k starts from the weights of seed + k. Over noise it has the data of that seed too: it is then the run with
    seed=seed+k.
    """
    size, seed = size_of(cfg), seed_of(cfg)
    data = build_data(cfg, system)
    members: list[FrictionModel] = []
    batches: list[dict[str, dict[str, torch.Tensor]]] = []
    for k in range(size):
        own = data
        if k and cfg.get("ensemble_over") == "noise":
            own = build_data({**cfg, "seed": seed + k}, system)
        L.seed_everything(seed + k, workers=False, verbose=False)
        members.append(build_model(cfg, system, own))
        if size > 1 and members[-1].contacts != ("",):
            raise UserError("an ensemble is of one contact", where="ensemble", received=size, allowed="1 on a system "
                            "with several contacts", fix="train it with seed=0, seed=1, ... (-m)")  # fmt: skip
        own.prepare_for(members[-1])
        batches.append(own.batches)
    if size == 1:
        return data, members[0]
    if cfg.get("ensemble_over") == "noise":
        data.batches = {
            split: {key: torch.stack([item[split][key] for item in batches]) for key in table}
            for split, table in batches[0].items()
        }
    return data, ensemble_of(members)


class MembersBest(L.Callback):
    """Keeps every member's best weights as a checkpoint of its own run would, and stops when all have stopped."""

    def __init__(self, every: int, patience: int | None, min_delta: float):
        self.every, self.patience, self.min_delta = every, patience, min_delta

    def on_train_start(self, trainer, pl_module) -> None:
        if self.patience is not None and bool((pl_module.waited >= self.patience).all()):
            trainer.should_stop = True  # resumed after the stop, before the report

    def on_train_epoch_end(self, trainer, pl_module) -> None:
        if (trainer.current_epoch + 1) % self.every:
            return
        losses = getattr(pl_module, "validation_losses", pl_module.member_parts["loss"])
        if not pl_module.keep_best(losses, self.patience, self.min_delta):
            trainer.should_stop = True


def uncertainty(
    model: FrictionEnsemble, train: Sequence[ContactTrial], scored: Sequence[ContactTrial]
) -> dict[str, Any]:
    """How wide the members' spread is, and how often the force lies within the interval that it gives.

    The spread shows what the networks' starts (or the noise) leave open, not what all members get wrong alike. So the
    interval is mean -+ 1.96 sqrt(force_std^2 + common^2), and the common error is such that the interval holds 95 % of
    the force that the equation of motion implies on the training trials. Held-out trials only score it.
    """
    fitted = _misses(model, [(trial, trial.offline["friction_force"]) for trial in train])
    excess = (fitted[0] / NORMAL_95) ** 2 - fitted[1] ** 2
    common = float(np.sqrt(max(np.quantile(excess, COVERAGE), 0.0)))
    miss, spread = _misses(model, [(trial, reference_force(trial)[0]) for trial in scored])
    return {
        "members": model.size,
        "interval": "mean -+ 1.96 sqrt(force_std^2 + common^2), common from the training trials",
        "common": common,
        "force_std_rms": float(np.sqrt(np.mean(spread**2))),
        "coverage": {
            "wanted": COVERAGE,
            "interval": float(np.mean(miss <= NORMAL_95 * np.hypot(spread, common))),
            "spread_alone": float(np.mean(miss <= NORMAL_95 * spread)),
        },
    }


def _misses(model: FrictionEnsemble, pairs: Sequence[tuple[ContactTrial, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """Distances of the mean from the reference, and the spreads, over all samples."""
    found = [(model.predict_trial(trial), reference) for trial, reference in pairs]
    miss = np.concatenate([np.abs(prediction["force"] - reference) for prediction, reference in found])
    return miss, np.concatenate([prediction["force_std"] for prediction, _ in found])


def member_spread(model: FrictionModel) -> dict[str, float]:
    """Standard deviation over the members of every physical parameter; empty without an ensemble."""
    if not isinstance(model, FrictionEnsemble):
        return {}
    return {name: float(np.std(values, ddof=1)) for name, values in model.physical_of_members().items()}


def band(prediction: dict[str, np.ndarray], told: dict[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper end of the force's interval."""
    half = NORMAL_95 * np.hypot(prediction["force_std"], told["common"])
    return prediction["force"] - half, prediction["force"] + half
