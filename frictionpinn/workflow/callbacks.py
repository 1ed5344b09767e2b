"""Callbacks of a training: scalars for TensorBoard, a stop at the first loss that is not a number."""

from __future__ import annotations

import logging
import math
import sys
import time
from pathlib import Path
from typing import Any

import lightning as L
import torch

from ..errors import UserError
from ..models import FrictionEnsemble, FrictionModel
from ..models.base import Batch
from ..progress import SHORT, in_words

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
    """Ends the training at the step where loss or gradient is not finite, before the weights are, in one line.

    Args:
        folder: of the run, to tell where the last good checkpoint is.
    """

    def __init__(self, folder: Path):
        self.folder = folder

    def on_before_optimizer_step(self, trainer, pl_module, optimizer) -> None:
        if isinstance(getattr(optimizer, "active", None), torch.optim.LBFGS):
            return  # its line search tries points and may take them back
        own = [p.grad for group in optimizer.param_groups for p in group["params"]]
        gradients, loss = [g.reshape(-1) for g in own if g is not None], pl_module.parts["loss"]
        # One sum and one look: a step of a small network takes a millisecond, a look at each gradient a tenth of that.
        if math.isfinite((torch.cat(gradients).sum() + loss).item()):
            return  # numbers that are finite may have a sum that is not
        if not math.isfinite(loss.item()) or not all(bool(g.isfinite().all()) for g in gradients):
            self._stop(trainer, pl_module, trainer.global_step + 1)

    def on_train_batch_end(self, trainer, pl_module, outputs, batch, batch_idx) -> None:
        if not math.isfinite(pl_module.parts["loss"].item()):
            self._stop(trainer, pl_module, trainer.global_step)

    def _stop(self, trainer, pl_module, step: int) -> None:
        last = self.folder / "checkpoints" / "last.ckpt"
        kept = f"the last good checkpoint is {last}" if last.is_file() else "no checkpoint had been written yet"
        what, where = culprit(pl_module, trainer.train_dataloader.batch)
        raise UserError(
            f"the {what} is not a finite number at step {step}", where=where, fix=f"lower optimizer.lr; {kept}"
        )


def culprit(pl_module: FrictionModel, batch: Batch) -> tuple[str, str]:
    """Whether loss or gradient is not finite, and in which term; of a gradient also with respect to what."""
    bad = [name for name, value in pl_module.parts.items() if name != "loss" and not bool(torch.isfinite(value))]
    if bad:
        return "loss", "term " + ", ".join(bad)
    if isinstance(pl_module, FrictionEnsemble):
        names = [name for name, p in pl_module.named_parameters() if p.grad is not None and not p.grad.isfinite().all()]
        return "gradient", "term loss with respect to " + ", ".join(names[:4])
    pl_module.zero_grad()
    named = [(name, p) for name, p in pl_module.named_parameters() if p.requires_grad]
    found = []
    for term in (name for name in pl_module.parts if name != "loss"):
        value = pl_module.losses(batch)[term]
        slopes = torch.autograd.grad(value, [p for _, p in named], allow_unused=True)
        where = [
            name for (name, _), g in zip(named, slopes, strict=True) if g is not None and not bool(g.isfinite().all())
        ]
        if where:
            found.append(f"{term} with respect to {', '.join(where[:4])}")
    return "gradient", "term " + (" and ".join(found) or "loss")


class Progress(L.Callback):
    """One bar for the whole training on a terminal; elsewhere (a log file) a line at every fifth of it."""

    def __init__(self, every: int = 10):
        self.every = max(int(every), 1)
        self.began, self.first = 0.0, 0
        self.bar: Any = None
        self.task: Any = None

    def on_train_start(self, trainer, pl_module) -> None:
        self.began, self.first = time.perf_counter(), trainer.current_epoch
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
            rest = (time.perf_counter() - self.began) / max(done - self.first, 1) * (total - done)
            left = f", about {in_words(rest)} left" if rest > SHORT else ""
            log.info("epoch %d of %d%s: loss %.4g", done, total, left, float(pl_module.parts["loss"]))

    def _stop(self) -> None:
        if self.bar is not None:
            self.bar.stop()
            self.bar = None

    def on_train_end(self, trainer, pl_module) -> None:
        self._stop()

    def on_exception(self, trainer, pl_module, exception) -> None:
        self._stop()
