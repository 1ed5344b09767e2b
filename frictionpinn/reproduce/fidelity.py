"""In-simulation and online errors of the four models beside their yardsticks, and the friction characteristics."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

from ..evaluate.picture import save_png
from ..workflow.build import Config
from .draw import errors_figure
from .runs import Run, by_seed, finish_all, training

KINDS = ("online", "in_simulation")
ONCE = ("identify=false", "simulators=[]")  # yardsticks that are the same for every model, beside the first alone


def runs(options: Config, root: Path) -> dict[tuple[str, int], Run]:
    """One run for every model and seed; the seed is that of the training, its noise and the evaluation's noise."""
    cfg = options["fidelity"]
    return {
        (model, seed): Run(
            root / f"pob_{model}_{seed}",
            training(cfg, model, seed),
            ((f"seeds=[{seed}]", *(() if model == cfg["models"][0] else ONCE), *cfg["evaluate"]),),
        )
        for seed in cfg["seeds"]
        for model in cfg["models"]
    }


def run(options: Config, root: Path, results: Path, jobs: int) -> dict[str, Any]:
    """Train and evaluate; copy the figures that the document shows."""
    made = runs(options, root)
    finished = dict(zip(made, finish_all(made.values(), jobs), strict=True))
    evaluations = {key: evaluated[0] for key, (_, evaluated) in finished.items()}
    shown = options["fidelity"]["shown"]
    first = options["fidelity"]["seeds"][0]
    for model in shown:
        for figure in sorted((made[model, first].folder / "evaluation" / "figures").glob("trajectory_*.png")):
            shutil.copy(figure, results / f"{model}_{figure.name}")
    characteristics = panels(options, made, results)
    table = errors(evaluations)
    save_png(errors_figure(table), results / "errors.png")
    return {
        "errors": table,
        "trajectories": next(iter(evaluations.values()))["trajectories"],
        "parameters": parameters({key: trained for key, (trained, _) in finished.items()}),
        "characteristics": characteristics,
        "seconds_of_training": {
            f"{model}_{seed}": trained["training"]["seconds"]["training"]
            for (model, seed), (trained, _) in finished.items()
        },
    }


def errors(evaluations: dict[tuple[str, int], Config]) -> dict[str, Any]:
    """Trajectory -> method -> label, published figure and mean square errors by kind, over the seeds.

    Methods are the four models, and every yardstick that any evaluation has; a yardstick that depends on the model
    (its parameters in the law) is named after it.
    """
    table: dict[str, Any] = {}
    for (model, seed), result in evaluations.items():
        for trajectory, methods in result["errors"].items():
            for key, entry in methods.items():
                name = model if key == "model" else f"{key}_{model}" if model.upper() in entry["label"] else key
                row = table.setdefault(trajectory, {}).setdefault(name, {"label": entry["label"]})
                row["model"] = key == "model"
                for kind in KINDS:
                    part = entry.get(kind)
                    if part is None:
                        continue
                    error = part.get("force_mse", {})
                    cell = row.setdefault(kind, {"seeds": {}})
                    cell["seeds"].setdefault(seed, error.get("value"))
                    for extra in ("unit", "published"):
                        if extra in error:
                            cell[extra] = error[extra]
    for methods in table.values():
        for row in methods.values():
            for kind in KINDS:
                if kind in row:
                    row[kind] |= by_seed(row[kind].pop("seeds"))
    return table


def parameters(trained: dict[tuple[str, int], Config]) -> dict[str, Any]:
    """Model -> parameter -> median value over the seeds, unit and truth."""
    table: dict[str, Any] = {}
    for (model, seed), result in trained.items():
        for name, entry in result["parameters"].items():
            row = table.setdefault(model, {}).setdefault(name, {"seeds": {}, "unit": entry["unit"]})
            row["seeds"][seed] = entry["value"]
            row["truth"] = entry.get("truth")
    return {
        model: {
            name: {key: row[key] for key in ("unit", "truth")} | by_seed(row["seeds"]) for name, row in rows.items()
        }
        for model, rows in table.items()
    }


def panels(options: Config, made: dict[tuple[str, int], Run], results: Path) -> dict[str, Any]:
    """The paper's three panels: friction characteristics of PE1, BB1 and the truth."""
    from ..workflow.estimate import default_config
    from ..workflow.evaluate import draw_characteristics

    first = options["fidelity"]["seeds"][0]
    overrides = [f"run={made['pe1', first].folder}", f"beside=[{made['bb1', first].folder}]"]
    return draw_characteristics(default_config(overrides, "evaluate"), results / "characteristics.png")
