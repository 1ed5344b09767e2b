"""The commands that sweep (``-m``): what runs a job, what a line says of it, and what sums up all of them."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..errors import UserError
from ..show import unit_of_error
from . import fleet, summary
from .manifest import Job

Config = dict[str, Any]
Result = Mapping[str, Any]


@dataclass(frozen=True)
class Kind:
    """A command whose jobs a sweep runs.

    Attributes:
        run: a job, in the process of its own that this takes.
        line: of a job's result.
        score: of a job's result: the error on held-out trials.
        threads: that a configuration asks for, None for none.
        threads_key: where it does.
        summarise: all jobs of a sweep's folder, which is the last argument as people are told it.
    """

    run: Callable[[Config, Path], Any]
    line: Callable[[Result], str]
    score: Callable[[Result], float]
    threads_key: str
    summarise: Callable[[Path, Sequence[Job], str], Any]

    def threads(self, cfg: Mapping[str, Any]) -> int | None:
        """Threads that a configuration asks for, None for none."""
        found: Any = cfg
        for key in self.threads_key.split("."):
            found = (found or {}).get(key)
        return found


def _train(cfg: Config, folder: Path) -> None:
    """Train, from the last checkpoint where there is one."""
    from .checkpoints import load_checkpoint
    from .train import train

    last = folder / "checkpoints" / "last.ckpt"
    if last.is_file():
        try:
            load_checkpoint(last, "checkpoint")
            cfg = {**cfg, "ckpt_path": str(last)}
        except UserError as error:
            logging.warning("%s: starting afresh", error)
            last.rename(last.with_suffix(".unreadable"))
    train(cfg, folder)


def _force_error(result: Result) -> str:
    error = result["force_error"]
    return f"force error {error['model']['rmse']:.4g} {unit_of_error(error['unit']['rmse'])} rms"


def _diagnose(cfg: Config, folder: Path) -> None:
    from .diagnose import diagnose

    diagnose(cfg, folder)


KINDS: dict[str, Kind] = {
    "train": Kind(
        _train,
        _force_error,
        lambda result: float(result["force_error"]["model"]["rmse"]),
        "trainer.threads",
        summary.summarise_sweep,
    ),
    "diagnose": Kind(_diagnose, fleet.line, lambda result: fleet.errors(result)[1], "threads", fleet.summarise),
}
