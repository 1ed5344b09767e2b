"""The DataModule of every recording, simulated or measured: split by trial, the whole training set as one batch."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import lightning as L
import numpy as np
import torch
from torch import Tensor

from ..errors import UserError
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


class TrajectoryData(L.LightningDataModule):
    """Trials of one mechanism, ready for a model.

    Args:
        recording: as measured (noise included), SI units.
        trials: the contact of each trial (see :func:`frictionpinn.data.contact.contact_trials`).
        splits: see :func:`frictionpinn.data.split.split_trials`.
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
        for split in ("train", "validation"):
            arrays = [model.arrays(trial, "offline") for trial in self.select(split)]
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
