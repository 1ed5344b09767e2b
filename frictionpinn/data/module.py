"""The DataModule of every recording, simulated or measured: split by trial, the whole training set as one batch."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import lightning as L
import numpy as np
import torch
from torch import Tensor

from ..errors import UserError, nearest
from .contact import ContactTrial
from .recording import Recording


class FullBatch:
    """A loader that gives the same batch, held on the device, a fixed number of times per epoch."""

    def __init__(self, batch: dict[str, Tensor], repeats: int = 1):
        self.batch, self.repeats = batch, repeats

    def __iter__(self) -> Iterator[dict[str, Tensor]]:
        return (self.batch for _ in range(self.repeats))

    def __len__(self) -> int:
        return self.repeats


def split_trials(
    names: Sequence[str],
    held_out: Sequence[Any] | None,
    validation: Sequence[Any] | None = None,
    training: int | None = None,
) -> dict[str, list[str]]:
    """Names of the trials to train on, to validate on and to hold out; never parts of one trial.

    ``held_out`` None holds out the last trial where there are several. ``training`` is how many of the others to train
    on, spread evenly over them; None: all.

    Raises:
        UserError: a name that no trial has, one trial in two splits, nothing left to train on, more trials than there
            are.
    """
    held = [names[-1]] if held_out is None and len(names) > 1 else _names(held_out)
    valid = _names(validation)
    for key, chosen in (("held_out", held), ("validation", valid)):
        for name in chosen:
            if name not in names:
                raise UserError(
                    "no such trial",
                    where=f"data.{key}",
                    received=name,
                    allowed=", ".join(names),
                    fix=nearest(name, names) or "use the names of the trials",
                )
    train = [name for name in names if name not in held and name not in valid]
    if set(held) & set(valid) or not train:
        raise UserError(
            "splits overlap or leave nothing to train on",
            where="data.held_out, data.validation",
            received=f"{held}, {valid}",
            allowed="disjoint trials, at least one left to train on",
            fix=f"the recording has the trials {', '.join(names)}",
        )
    return {"train": _spread(train, training), "validation": valid, "held_out": held}


def _spread(names: list[str], count: int | None) -> list[str]:
    """So many of the names, spread evenly: of five, one is the third, two the second and fourth."""
    if count is None:
        return names
    if isinstance(count, bool) or not isinstance(count, int) or not 1 <= count <= len(names):
        raise UserError(
            "impossible number of trials",
            where="data.training_trials",
            received=count,
            allowed=f"1 to {len(names)}, or null for all",
        )
    return [names[int((k + 0.5) * len(names) / count)] for k in range(count)]


def _names(chosen: Any) -> list[str]:
    """Names as text; one name alone counts as a list of one."""
    chosen = [chosen] if isinstance(chosen, str | int | float) else chosen or ()
    return [str(name) for name in chosen]


class TrajectoryData(L.LightningDataModule):
    """Trials of one mechanism, ready for a model.

    Args:
        recording: as measured (noise included), SI units.
        trials: the contact of each trial (see :func:`frictionpinn.data.contact.contact_trials`).
        splits: see :func:`split_trials`.
        steps_per_epoch: how often an epoch uses the full batch.
    """

    def __init__(
        self,
        recording: Recording,
        trials: Sequence[ContactTrial],
        splits: dict[str, list[str]],
        steps_per_epoch: int = 1,
    ):
        super().__init__()
        self.recording, self.splits, self.steps_per_epoch = recording, splits, steps_per_epoch
        if isinstance(steps_per_epoch, bool) or not isinstance(steps_per_epoch, int) or steps_per_epoch < 1:
            raise UserError(
                "impossible number of steps",
                where="data.steps_per_epoch",
                received=steps_per_epoch,
                allowed="at least 1, a whole number",
            )
        self.by_name = {trial.name: trial for trial in trials}
        self.batches: dict[str, dict[str, Tensor]] = {}

    def select(self, split: str) -> list[ContactTrial]:
        """Trials of a split: train, validation or held_out."""
        return [self.by_name[name] for name in self.splits[split]]

    def prepare_for(self, model) -> None:
        """Compute the model's batches once, and standardise its inputs by the training trials."""
        from ..models.base import tensors

        for split in ("train", "validation"):
            arrays = [tensors(trial, model.features, "offline") for trial in self.select(split)]
            if arrays:
                joined = {key: np.concatenate([item[key] for item in arrays]) for key in arrays[0]}
                self.batches[split] = {key: torch.from_numpy(values) for key, values in joined.items()}
        model.fit_scales(self.batches["train"])

    def _loader(self, split: str, repeats: int) -> FullBatch:
        device = self.trainer.strategy.root_device if self.trainer is not None else torch.device("cpu")
        batch = {key: value.to(device) for key, value in self.batches[split].items()}
        return FullBatch(batch, repeats)

    def train_batch(self, device: torch.device) -> dict[str, Tensor]:
        """The training samples as one batch."""
        return {key: value.to(device) for key, value in self.batches["train"].items()}

    def train_dataloader(self) -> FullBatch:
        return self._loader("train", self.steps_per_epoch)

    def val_dataloader(self) -> FullBatch | list:
        return self._loader("validation", 1) if "validation" in self.batches else []

    def transfer_batch_to_device(self, batch: Any, device: torch.device, dataloader_idx: int) -> Any:
        """The batch is on the device already."""
        return batch
