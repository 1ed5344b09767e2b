"""Checkpoints that are written whole or not at all, loaded without executing code, and resumed exactly."""

from __future__ import annotations

import errno
import os
import shutil
import signal
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import lightning as L
import torch
from lightning.fabric.plugins.io.torch_io import TorchCheckpointIO
from lightning.pytorch.callbacks import Callback, EarlyStopping, ModelCheckpoint

from ..errors import Interrupted, UserError, nearest
from ..models import FrictionEnsemble, FrictionModel
from ..models.base import check_same_model
from .configs import called
from .manifest import whole


class WholeFiles(TorchCheckpointIO):
    """Writes a checkpoint beside its place and moves it there, so that a kill or a full disk leaves the last one.

    Lightning's own writer puts its temporary file into the system's folder for those, from where a move to another
    disk is a copy that can be cut short.
    """

    def save_checkpoint(self, checkpoint: dict[str, Any], path: Any, storage_options: Any = None) -> None:
        target = Path(path)
        target.parent.mkdir(parents=True, exist_ok=True)
        try:
            with whole(target) as temporary:
                torch.save(checkpoint, temporary)
        except RuntimeError as error:  # torch's zip writer at a full disk
            full = shutil.disk_usage(target.parent).free < 1 << 20
            number = errno.ENOSPC if full else errno.EIO
            raise OSError(number, os.strerror(number), str(target)) from error


class Checkpoints(ModelCheckpoint):
    """best.ckpt and last.ckpt, which Ctrl-C brings up to date, too.

    On resuming, the best one so far counts wherever its folder is now.

    Attributes:
        seconds_before: that a resumed training took before, s.
    """

    def __init__(self, **options: Any):
        super().__init__(**options)
        self.seconds_before, self._began, self._stop = 0.0, time.perf_counter(), False

    @contextmanager
    def stopped_by_user(self) -> Iterator[None]:
        """Within, Ctrl-C ends the training after the epoch, with a checkpoint; a second one ends it at once."""
        mine = threading.current_thread() is threading.main_thread()
        before = signal.signal(signal.SIGINT, self._on_interrupt) if mine else None
        try:
            yield
        finally:
            if mine:
                signal.signal(signal.SIGINT, before)

    def _on_interrupt(self, *_: Any) -> None:
        if self._stop:
            raise Interrupted(self._told("stopped at once"))
        self._stop = True

    def _told(self, what: str) -> str:
        last = Path(str(self.dirpath)) / "last.ckpt"
        resume = f"go on with: {called('train')} resume={os.path.relpath(last.parents[1])}"
        return f"{what}; {resume if last.is_file() else 'no checkpoint was written yet: start again'}"

    def on_train_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        super().on_train_start(trainer, pl_module)
        self._began = time.perf_counter()

    def on_train_epoch_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        super().on_train_epoch_end(trainer, pl_module)
        if self._stop:
            trainer.save_checkpoint(Path(str(self.dirpath)) / "last.ckpt")
            raise Interrupted(self._told(f"stopped after epoch {trainer.current_epoch + 1} of {trainer.max_epochs}"))

    def state_dict(self) -> dict[str, Any]:
        return super().state_dict() | {"seconds": self.seconds_before + time.perf_counter() - self._began}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        self.seconds_before = float(state_dict.get("seconds", 0.0))  # a checkpoint of an earlier version has none
        best = Path(str(self.dirpath)) / "best.ckpt"
        state = {**state_dict, "best_model_path": ""}
        if best.is_file():
            score = state_dict["best_model_score"]
            state |= {"dirpath": self.dirpath, "best_model_path": str(best), "kth_best_model_path": str(best)}
            state |= {"best_k_models": {str(best): score}, "last_model_path": str(best.with_name("last.ckpt"))}
        super().load_state_dict(state)


class EveryFew(Callback):
    """Early stopping that looks only at the epochs at which the monitored loss is logged."""

    def __init__(self, stopping: EarlyStopping, every: int):
        self.stopping, self.every = stopping, every

    def setup(self, trainer, pl_module, stage) -> None:
        self.stopping.setup(trainer, pl_module, stage)

    def on_train_start(self, trainer, pl_module) -> None:
        if self.stopping.wait_count >= self.stopping.patience:  # resumed after the stop, before the report
            trainer.should_stop = True

    def on_train_epoch_end(self, trainer, pl_module) -> None:
        if (trainer.current_epoch + 1) % self.every == 0:
            self.stopping._run_early_stopping_check(trainer)

    def state_dict(self) -> dict[str, Any]:
        return self.stopping.state_dict()

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        self.stopping.load_state_dict(state_dict)


def load_checkpoint(path: str | Path, where: str) -> Mapping[str, Any]:
    """Load a checkpoint without ever executing code in it; one line where that fails."""
    path = Path(path)
    if not path.is_file():
        present = sorted(str(item) for item in path.parent.glob("*.ckpt")) if path.parent.is_dir() else []
        raise UserError(
            "no such checkpoint",
            where=where,
            received=str(path),
            allowed=", ".join(present) or "a .ckpt file of an earlier run",
            fix=nearest(str(path), present) or "look in the run's folder, checkpoints/",
        )
    try:
        return torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:
        raise UserError(
            "unreadable checkpoint",
            where=where,
            received=str(path),
            allowed="a checkpoint written by train.py",
            fix=f"use another checkpoint of the run ({type(error).__name__})",
        ) from error


def check_resumable(checkpoint: Mapping[str, Any], model: FrictionModel, max_epochs: int, same_run: bool) -> None:
    """Raise :class:`UserError` for a checkpoint of another model, or one that has had all its epochs.

    A run that was stopped between its last epoch and its report (``same_run``) has the report left.
    """
    check_same_model(checkpoint, dict(model.hparams))
    done = int(checkpoint.get("epoch", -1)) + 1
    if done >= max_epochs and not same_run:
        raise UserError(
            "nothing left to train",
            where="trainer.max_epochs",
            received=max_epochs,
            allowed=f"more than {done}, the epochs of the checkpoint",
            fix="raise it, or start afresh without ckpt_path",
        )


def bring_best(folder: Path, ckpt_path: str) -> None:
    """Copy the best checkpoint of a run that goes on in another folder, since it may stay the best."""
    best, own = Path(ckpt_path).with_name("best.ckpt"), folder / "checkpoints"
    if best.is_file() and best.parent.resolve() != own.resolve():
        own.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(best, own / "best.ckpt")


def use_best(model: FrictionModel, trainer: L.Trainer) -> None:
    """Load the weights of the best checkpoint; of an ensemble, every member's own best, and keep those."""
    path = trainer.checkpoint_callback.best_model_path  # type: ignore[union-attr]
    if isinstance(model, FrictionEnsemble):
        model.restore_best()
        trainer.save_checkpoint(path, weights_only=True)
        return
    if path:
        model.load_state_dict(load_checkpoint(path, "checkpoint")["state_dict"])
