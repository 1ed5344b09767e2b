"""Callbacks of a training: scalars for TensorBoard, a stop at the first loss that is not a number."""

from __future__ import annotations

import logging
import sys
from typing import Any

import lightning as L
import torch

from ..errors import UserError

log = logging.getLogger(__name__)


class Scalars(L.Callback):
    """Writes losses, physical parameters and learning rates to the logger every ``every`` steps.

    Lightning's own ``log`` costs as much as a step of a small network, so values are read when they are written.
    """

    def __init__(self, every: int):
        self.every = max(int(every), 1)

    def on_train_batch_end(self, trainer, pl_module, outputs, batch, batch_idx) -> None:
        step = trainer.global_step
        if step % self.every and step != trainer.max_epochs * len(trainer.train_dataloader):
            return
        values = {f"loss/{name}": float(value) for name, value in pl_module.parts.items()}
        values |= {f"parameter/{name}": value for name, value in pl_module.physical().items()}
        optimizer = trainer.optimizers[0]
        for k, group in enumerate(getattr(optimizer, "active", optimizer).param_groups):
            values[f"learning_rate/{'network' if k == 0 else 'physical'}"] = float(group["lr"])
        for logger in trainer.loggers:
            logger.log_metrics(values, step=step)


class StopOnNaN(L.Callback):
    """Ends the training with one line where the loss is not a finite number, and says which term it was."""

    def __init__(self, every: int):
        self.every = max(int(every), 1)

    def on_train_batch_end(self, trainer, pl_module, outputs, batch, batch_idx) -> None:
        if trainer.global_step % self.every:
            return
        if not bool(torch.isfinite(pl_module.parts["loss"])):
            bad = [
                name for name, value in pl_module.parts.items() if not bool(torch.isfinite(value)) and name != "loss"
            ]
            raise UserError(
                f"the loss is not a finite number at step {trainer.global_step}",
                where="term " + ", ".join(bad),
                fix="lower optimizer.lr; the last good checkpoint is kept in the run's folder",
            )


class Progress(L.Callback):
    """One bar for the whole training on a terminal; elsewhere (a log file) a line at every fifth of it."""

    def __init__(self, every: int = 10):
        self.every = max(int(every), 1)
        self.bar: Any = None
        self.task: Any = None

    def on_train_start(self, trainer, pl_module) -> None:
        if not sys.stderr.isatty():
            return
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

        columns = (
            TextColumn("epoch"),
            MofNCompleteColumn(),
            BarColumn(),
            TimeRemainingColumn(),
            TextColumn("{task.description}"),
        )
        self.bar = Progress(*columns, console=Console(stderr=True))
        self.task = self.bar.add_task("", total=trainer.max_epochs, completed=trainer.current_epoch)
        self.bar.start()

    def on_train_epoch_end(self, trainer, pl_module) -> None:
        done, total = trainer.current_epoch + 1, trainer.max_epochs
        if self.bar is not None:
            if done % self.every == 0 or done == total:
                self.bar.update(self.task, completed=done, description=f"loss {float(pl_module.parts['loss']):.4g}")
        elif done % max(total // 5, 1) == 0:
            log.info("epoch %d of %d: loss %.4g", done, total, float(pl_module.parts["loss"]))

    def _stop(self) -> None:
        if self.bar is not None:
            self.bar.stop()
            self.bar = None

    def on_train_end(self, trainer, pl_module) -> None:
        self._stop()

    def on_exception(self, trainer, pl_module, exception) -> None:
        self._stop()
