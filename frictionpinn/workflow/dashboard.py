"""What TensorBoard shows of a run at a glance: charts laid out, hyper-parameters, figures."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import lightning as L
import numpy as np

from .build import Config
from .manifest import MANIFEST, read_json

# Enough to tell the runs of a comparison apart; a sweep adds the options that it varies.
_CHOICES = (
    "system.name", "friction.name", "model.name", "data.name", "noise.name", "noise.level", "smoothing.name",
    "optimizer.name", "optimizer.lr", "optimizer.lr_physical", "model.network.width", "model.network.depth",
    "model.network.activation", "model.loss.weight", "trainer.max_epochs", "seed", "refine", "ensemble",
)  # fmt: skip


def layout(parameters: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, list]]:
    """Custom scalars: the losses together, the step sizes together, each parameter with its truth if that is known.

    Args:
        parameters: name -> ``unit`` and perhaps ``truth``.
    """
    charts: dict[str, dict[str, list]] = {
        "training": {
            "losses": ["Multiline", [r"^loss/"]],
            "step sizes": ["Multiline", [r"^learning_rate/"]],
        }
    }
    if parameters:
        charts["physical parameters and their truth"] = {
            f"{name} ({entry['unit'].replace('*', ' ')})" if entry["unit"] not in ("", "1") else name: [
                "Multiline",
                [rf"^parameter/{name}$", rf"^truth/{name}$"],
            ]
            for name, entry in parameters.items()
        }
    return charts


class Dashboard(L.Callback):
    """Lays out the charts when the training starts, and draws each truth as a line beside its estimate.

    A truth has as many points as its estimate: TensorBoard scales a chart without its outliers, and a line of two
    points among many would be one.

    Args:
        parameters: see :func:`layout`.
    """

    def __init__(self, parameters: Mapping[str, Mapping[str, Any]]):
        self.parameters = parameters

    def on_train_start(self, trainer, pl_module) -> None:
        for logger in trainer.loggers:
            logger.experiment.add_custom_scalars(layout(self.parameters))
        self._draw(trainer)

    def on_train_batch_end(self, trainer, pl_module, outputs, batch, batch_idx) -> None:
        last = trainer.global_step == int(trainer.estimated_stepping_batches)
        if trainer.global_step % trainer.log_every_n_steps == 0 or last:
            self._draw(trainer)

    def _draw(self, trainer) -> None:
        truth = {f"truth/{name}": entry["truth"] for name, entry in self.parameters.items() if "truth" in entry}
        for logger in trainer.loggers:
            logger.log_metrics(truth, step=trainer.global_step)


def show_figures(loggers, pictures: Mapping[str, np.ndarray], step: int) -> None:
    """Add figures, as pixels (height, width, 4), to the dashboard."""
    for logger in loggers:
        for name, pixels in pictures.items():
            logger.experiment.add_image(name, pixels, global_step=step, dataformats="HWC")


def show_hyper_parameters(loggers, cfg: Config, folder: Path, result: Mapping[str, Any], step: int) -> None:
    """Record the options of a run and what it reached, so that TensorBoard's HPARAMS compares runs.

    The session alone is written, without a list of what there is to compare: TensorBoard then collects that list over
    all runs that it shows, also of several sweeps.
    """
    from torch.utils.tensorboard.summary import hparams

    reached = {"final/force_error": result["force_error"]["model"]["rmse"]}
    reached["final/force_error_of_coulomb_viscous_fit"] = result["force_error"]["coulomb_viscous"]["rmse"]
    for name, entry in result["parameters"].items():
        if entry.get("truth"):
            reached[f"final/{name}_off"] = abs(entry["value"] / entry["truth"] - 1)
    _, start, end = hparams(hyper_parameters(cfg, folder), dict.fromkeys(reached, 0.0))
    for logger in loggers:
        logger.log_metrics(reached, step=step)
        for summary in (start, end):
            logger.experiment.file_writer.add_summary(summary)


def hyper_parameters(cfg: Config, folder: Path) -> dict[str, str | float | bool]:
    """Options that tell runs apart, by their full name; those that the run's sweep varies are among them."""
    chosen = {key: value for key in _CHOICES if (value := _select(cfg, key)) is not None}
    jobs = (read_json(folder.parent / MANIFEST) or {}).get("jobs", [])
    swept: dict[str, str] = next((job["swept"] for job in jobs if job["folder"] == folder.name), {})
    for key, told in swept.items():
        value = _select(cfg, key)
        if isinstance(value, dict) or value is None:  # a choice of a group is known by its name
            value = None if f"{key}.name" in chosen else told
        if value is not None:
            chosen[key] = value if isinstance(value, bool | int | float | str) else str(value)
    return chosen


def _select(cfg: Mapping[str, Any], key: str) -> Any:
    node: Any = cfg
    for part in key.split("."):
        if not isinstance(node, Mapping) or part not in node:
            return None
        node = node[part]
    return node
