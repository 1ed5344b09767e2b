"""One training: from a resolved configuration to checkpoints, TensorBoard, figures and ``result.json``."""

from __future__ import annotations

import contextlib
import ctypes
import logging
import os
import sys
import threading
import time
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import lightning as L
import torch
from lightning.pytorch.callbacks import Callback, EarlyStopping
from lightning.pytorch.loggers import TensorBoardLogger
from lightning.pytorch.utilities.exceptions import MisconfigurationException

from ..data.module import TrajectoryData
from ..errors import DISK, UserError, unwritable
from ..models import FrictionModel
from .build import Config, build_system, check_pairing, seed_of
from .callbacks import Progress, Scalars, StopOnNaN
from .checkpoints import Checkpoints, EveryFew, WholeFiles, bring_best, check_resumable, load_checkpoint, use_best
from .configs import called
from .dashboard import Dashboard
from .ensemble import MembersBest, prepare, size_of
from .experiment import check_memory
from .manifest import check_free, write_json
from .refine import check_refinable, refine
from .result import parameters, report, summarise
from .rollout import check_rollout, rollout
from .vet import vet

log = logging.getLogger(__name__)
_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3  # M_TRIM_THRESHOLD and M_MMAP_THRESHOLD of glibc's malloc.h


def train(cfg: Config, folder: Path) -> dict[str, Any]:
    """Train the model of ``cfg`` and write everything that a user needs of it to ``folder``.

    Args:
        cfg: resolved configuration: system, friction, model, data, noise, smoothing, optimizer, trainer (plain
            values), seed, ckpt_path.
        folder: of this run.

    Returns:
        What stands in ``result.json``.

    Raises:
        UserError: anything that the user can mend.
    """
    try:
        return _train(cfg, folder)
    except OSError as error:
        fix = f"free or allow it, then go on from the last checkpoint: resume={folder}"
        raise unwritable(error, folder, fix) from error


def _train(cfg: Config, folder: Path) -> dict[str, Any]:
    begin = time.perf_counter()
    quiet()
    keep_memory()
    check_free(folder, cfg.get("ckpt_path"))
    threads = cfg["trainer"].get("threads")
    if threads is not None and (isinstance(threads, bool) or not isinstance(threads, int) or threads < 1):
        raise UserError("impossible number of threads", where="trainer.threads", received=repr(threads),
                        allowed="a whole number from 1, or null: all cores")  # fmt: skip
    torch.set_num_threads(threads or torch.get_num_threads())
    L.seed_everything(seed_of(cfg), workers=False, verbose=False)
    check_pairing(cfg)
    size_of(cfg)
    check_refinable(cfg)
    if cfg["system"]["name"] == "robot":
        from .robot_networks import train_robot

        return train_robot(cfg, folder, begin)
    announce_compilation(cfg)
    system = build_system(cfg["system"])
    check_memory(cfg)
    check_rollout(cfg, system)
    data, model = prepare(cfg, system)
    vet(cfg, system, data.recording)
    trainer, told = trained(cfg, folder, data, model, parameters(cfg, system, model), begin)
    result = report(cfg, folder, system, data, model, told, trainer.loggers, trainer.global_step)
    if cfg.get("refine"):
        result["refined"] = refine(cfg, system, data, model)
    if cfg.get("rollout"):
        result["rollout"] = rollout(system, data, model, folder)
    write_json(folder / "result.json", result)
    log.info(summarise(result, folder))
    log.info(f"next: {called('evaluate')} run={os.path.relpath(folder)}")
    return result


def trained(
    cfg: Config, folder: Path, data: TrajectoryData, model: FrictionModel, told: Mapping[str, Any], begin: float
) -> tuple[L.Trainer, dict[str, Any]]:
    """Train a model on data, which is ready for it; the trainer, and epochs, device and seconds.

    Args:
        told: physical parameters, for the dashboard.
        begin: of the run, by ``time.perf_counter``.
    """
    step = None
    if cfg.get("ckpt_path"):
        checkpoint = load_checkpoint(cfg["ckpt_path"], "ckpt_path")
        check_resumable(checkpoint, model, int(cfg["trainer"]["max_epochs"]), check_free(folder, cfg["ckpt_path"]))
        step = int(checkpoint["global_step"])
        bring_best(folder, cfg["ckpt_path"])
    trainer = build_trainer(cfg, folder, bool(data.splits["validation"]), step, Dashboard(told))
    log.info(announce(cfg, data))
    start, writer = time.perf_counter(), trainer.checkpoint_callback
    assert isinstance(writer, Checkpoints)
    with writer.stopped_by_user():
        trainer.fit(model, datamodule=data, ckpt_path=cfg.get("ckpt_path"), weights_only=True)
    seconds = {"training": time.perf_counter() - start + writer.seconds_before}
    use_best(model, trainer)
    model.eval()
    seconds["total"] = time.perf_counter() - begin + writer.seconds_before
    return trainer, {"epochs": trainer.current_epoch, "device": str(trainer.strategy.root_device), "seconds": seconds}


def announce_compilation(cfg: Config) -> None:
    """Say why the very first simulation on a machine takes so long."""
    from .. import numerics

    cache = Path(numerics.__file__).parent / "__pycache__"
    if cfg["data"]["name"] == "simulated" and not any(cache.glob("integrator.*.nbi")):
        log.info("compiling the simulator, once on this machine: about 20 s")


def quiet() -> None:
    """Silence what concerns developers of Lightning, not users of a friction model."""
    for name in ("lightning.pytorch", "lightning.fabric"):
        logging.getLogger(name).setLevel(logging.ERROR)
    for text in (
        ".*does not have many workers.*",
        ".*val_dataloader.*",
        ".*lr_scheduler.step.*",
        ".*isinstance.treespec.*",
    ):
        warnings.filterwarnings("ignore", text)
    warnings.filterwarnings("ignore", module="lightning.*")
    warnings.filterwarnings("ignore", module="torch.optim.lr_scheduler")
    threading.excepthook = _hook


def _hook(told: threading.ExceptHookArgs) -> None:
    """TensorBoard's thread hands its error of the disk to the training, which ends with it in one line."""
    if not isinstance(told.exc_value, OSError) or told.exc_value.errno not in DISK:
        threading.__excepthook__(told)


def keep_memory() -> None:
    """Keep freed blocks for the next step: the C library of Linux gives those of some MB back to the system.

    Every step of a training needs the same blocks again, and to fault them in anew is a tenth to a third of its time.
    """
    if sys.platform == "linux":
        with contextlib.suppress(OSError, AttributeError):
            library = ctypes.CDLL("libc.so.6")
            library.mallopt(_MMAP_THRESHOLD, 2**25)  # the largest that it takes
            library.mallopt(_TRIM_THRESHOLD, 2**30)


def build_trainer(
    cfg: Config, folder: Path, validation: bool, purge_step: int | None = None, *further: Callback
) -> L.Trainer:
    """Lightning's trainer with checkpoints, scalars, early stopping and a progress bar.

    ``purge_step``: of a resumed run; what TensorBoard holds from there on is written anew.
    """
    options = cfg["trainer"]
    epochs = int(options["max_epochs"])
    if epochs < 1:
        raise UserError("nothing to train", where="trainer.max_epochs", received=epochs, allowed="at least 1")
    for key in ("checkpoint_every_n_epochs", "log_every_n_steps"):
        if int(options[key]) < 1:
            raise UserError("impossible interval", where=f"trainer.{key}", received=options[key], allowed="at least 1")
    every = min(int(options["checkpoint_every_n_epochs"]), epochs)
    monitor = "loss/validation" if validation else "loss/training"
    checkpoint = Checkpoints(
        dirpath=folder / "checkpoints",
        filename="best",
        monitor=monitor,
        save_last=True,
        every_n_epochs=every,
        enable_version_counter=False,
        save_on_train_epoch_end=True,
    )
    callbacks: list[Callback] = [
        checkpoint,
        Scalars(options["log_every_n_steps"]),
        StopOnNaN(folder),
        *further,
    ]
    stopping = options.get("early_stopping")
    patience = max(int(stopping["patience"]) // every, 1) if stopping else None
    if size_of(cfg) > 1:
        callbacks.append(MembersBest(every, patience, float(stopping["min_delta"]) if stopping else 0.0))
    elif stopping and patience:
        kind = EarlyStopping(
            monitor, float(stopping["min_delta"]), patience, strict=False, check_on_train_epoch_end=True
        )
        callbacks.append(EveryFew(kind, every))
    if options["progress_bar"]:
        callbacks.append(Progress())
    try:
        return L.Trainer(
            max_epochs=epochs,
            accelerator=accelerator_of(cfg),
            devices=1,  # one full batch: more devices would only repeat it
            logger=TensorBoardLogger(folder, name="", version="tensorboard", purge_step=purge_step),
            callbacks=callbacks,
            plugins=[WholeFiles()],
            log_every_n_steps=int(options["log_every_n_steps"]),
            check_val_every_n_epoch=every,
            num_sanity_val_steps=0,
            enable_progress_bar=False,
            enable_model_summary=False,
        )
    except (ValueError, RuntimeError, MisconfigurationException) as error:
        raise UserError(
            "the trainer refuses its options",
            where="trainer",
            received=f"accelerator={options['accelerator']}",
            allowed="cpu, auto, or gpu where the machine has one",
            fix=str(error).splitlines()[0],
        ) from error


def accelerator_of(cfg: Config) -> str:
    """What the trainer is told; "auto" of a network with a state is the CPU, where its recursion runs in any case: it
    takes a quarter longer where the rest of the step is on a GPU (benchmarks/accelerator.py)."""
    given, memory = cfg["trainer"]["accelerator"], cfg["model"].get("memory")
    return "cpu" if given == "auto" and memory == "state" else given


def announce(cfg: Config, data: TrajectoryData) -> str:
    """One line that says what is about to be trained on what."""
    counts = {split: sum(len(trial) for trial in data.select(split)) for split in data.splits}
    trials = len(data.splits["train"])
    held = ", ".join(data.splits["held_out"]) or "none: errors are those of the training trials"
    return (
        f"training {cfg['model']['name']} on {data.recording.source}: {counts['train']} samples of "
        f"{trials} trial{'s' if trials > 1 else ''}; held out: {held}"
    )
