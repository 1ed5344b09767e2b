"""Models on systems that they were not trained on: train system x test system x model, online and in simulation."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

from ..evaluate.picture import save_png
from ..workflow.build import Config
from .draw import transfer_figure
from .fidelity import KINDS
from .runs import Run, by_seed, finish_all, training


def run(options: Config, root: Path, results: Path, jobs: int) -> dict[str, Any]:
    """Train every model on every system, evaluate it on all of them."""
    cfg = options["transfer"]
    keys = list(itertools.product(cfg["systems"], cfg["models"], cfg["seeds"]))
    made = [_run(cfg, root, *key) for key in keys]
    finished = dict(zip(keys, finish_all(made, jobs), strict=True))
    matrix: dict[str, Any] = {}
    yardsticks: dict[str, Any] = {}
    for model, train, test, kind in itertools.product(cfg["models"], cfg["systems"], cfg["systems"], KINDS):
        values = {seed: _mean(_on(finished[train, model, seed][1], test), "model", kind) for seed in cfg["seeds"]}
        matrix.setdefault(model, {}).setdefault(train, {}).setdefault(test, {})[kind] = by_seed(values)
    for test, kind in itertools.product(cfg["systems"], KINDS):
        values = {
            seed: _mean(_on(finished[test, cfg["models"][0], seed][1], test), "coulomb_viscous", kind)
            for seed in cfg["seeds"]
        }
        yardsticks.setdefault(test, {})[kind] = by_seed(values)
    found = {"unit": "N^2", "matrix": matrix, "coulomb_viscous": yardsticks, "ratios": ratios(matrix, cfg["systems"])}
    found["trajectories"] = {
        test: list(_on(finished[cfg["systems"][0], cfg["models"][0], cfg["seeds"][0]][1], test)["errors"])
        for test in cfg["systems"]
    }
    save_png(transfer_figure(found), results / "transfer.png")
    return found


def _run(cfg: Config, root: Path, system: str, model: str, seed: int) -> Run:
    evaluations = tuple(
        (*(() if other == system else (f"system={other}",)), f"seeds=[{seed}]", *cfg["evaluate"])
        for other in cfg["systems"]
    )
    return Run(root / f"{system}_{model}_{seed}", (f"system={system}", *training(cfg, model, seed)), evaluations)


def _on(evaluations: list[Config], system: str) -> Config:
    return next(item for item in evaluations if item["system"] == system)


def _mean(evaluation: Config, method: str, kind: str) -> float | None:
    """Mean over the trajectories of one evaluation; None where a simulation failed."""
    errors = [table[method].get(kind, {}).get("force_mse", {}).get("value") for table in evaluation["errors"].values()]
    return None if any(error is None for error in errors) else sum(errors) / len(errors)


def ratios(matrix: dict[str, Any], systems: list[str]) -> dict[str, Any]:
    """Model -> "trained on > tested on" -> kind -> error over that of the model trained on the tested system."""
    table: dict[str, Any] = {}
    for model, (train, test), kind in itertools.product(matrix, itertools.permutations(systems, 2), KINDS):
        ours, theirs = (matrix[model][origin][test][kind]["value"] for origin in (train, test))
        table.setdefault(model, {}).setdefault(f"{train} > {test}", {})[kind] = (
            ours / theirs if ours and theirs else None
        )
    return table
