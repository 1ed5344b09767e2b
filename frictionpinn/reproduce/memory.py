"""What a state buys a network, and what training through the motion buys: the same seeds with windows of the past, with
a state trained through the force balance, and with a state trained through the motion."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ..workflow.build import Config
from .fidelity import errors
from .runs import Run, by_seed, finish_all, training

VARIANTS = {  # overrides of conf/train.yaml
    "windows": (),
    "balance": ("experiment=memory", "model.loss.through=balance"),
    "motion": ("experiment=memory",),
}
MOVED = ("bb2", "pe2")  # they see the frictionless acceleration, without which no motion can be simulated


def runs(options: Config, root: Path) -> dict[tuple[str, int], Run]:
    """One run for every model, variant (``pe2_motion``) and seed."""
    cfg = options["memory"]
    return {
        (f"{model}_{variant}", seed): Run(
            root / "memory" / f"{model}_{variant}_{seed}",
            (*training(cfg if variant == "windows" else cfg | {"rollout": []}, model, seed), *more),
            ((f"seeds=[{seed}]", *cfg["evaluate"]),),
        )
        for model in cfg["models"]
        for variant, more in VARIANTS.items()
        if variant != "motion" or model in MOVED
        for seed in cfg["seeds"]
    }


def run(options: Config, root: Path, results: Path, jobs: int) -> dict[str, Any]:
    """Train and evaluate every variant."""
    made = runs(options, root)
    finished = dict(zip(made, finish_all(made.values(), jobs), strict=True))
    table = errors({key: evaluated[0] for key, (_, evaluated) in finished.items()})
    seconds: dict[str, dict[int, float | None]] = {}
    for (name, seed), (trained, _) in finished.items():
        seconds.setdefault(name, {})[seed] = trained["training"]["seconds"]["training"]
    return {
        "errors": {trajectory: {name: methods[name] for name in seconds} for trajectory, methods in table.items()},
        "seconds_of_training": {name: by_seed(values) for name, values in seconds.items()},
    }
