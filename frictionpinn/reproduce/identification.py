"""The paper's table of identified parameters, with its bounds and tie, and with bounds of a decade and none."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

from ..evaluate.estimators import error_against_time
from ..evaluate.picture import save_png
from ..evaluate.published import published
from ..workflow.build import Config
from ..workflow.estimate import default_config
from ..workflow.identify import compare
from ..workflow.manifest import write_json
from .runs import each, finished

PROTOCOLS = {
    "near": ("bounds=near", "friction=lugre_tied"),
    "decade": ("bounds=decade", "friction=lugre"),
}
TITLES = {
    "near": "bounds ±20 % around the truth, σ1 = √σ0",
    "decade": "bounds of a decade, σ1 free",
}


def run(options: Config, root: Path, results: Path, jobs: int) -> dict[str, Any]:
    """Every estimator under both protocols; the figure of error against time."""
    cfg = options["identification"]
    tasks = [(name, seed) for name in PROTOCOLS for seed in cfg["seeds"]]
    found = dict(zip(tasks, each(partial(_finish, cfg, root / "identification"), tasks, jobs), strict=True))
    joined = {}
    for name in PROTOCOLS:
        parts = [found[name, seed] for seed in cfg["seeds"]]
        methods = {method: [part["methods"][method][0] for part in parts] for method in cfg["methods"]}
        joined[name] = parts[0] | {"seeds": cfg["seeds"], "methods": methods}
    shown = {TITLES[name]: result for name, result in joined.items()}
    save_png(error_against_time(shown), results / "identification.png")
    return {"protocols": joined, "published": published()["identification"]}


def _finish(cfg: Config, folder: Path, task: tuple[str, int]) -> Config:
    """Every estimator under one protocol with one seed; read from its file where that was done before."""
    name, seed = task
    config = default_config(list(PROTOCOLS[name]), "identify")
    config |= {key: cfg[key] for key in ("methods", "epochs", "simulations")} | {"seeds": [seed], "jobs": 1}
    path = folder / f"{name}_{seed}.json"
    result = finished(path, config)
    if result is None:
        result = compare(config)
        folder.mkdir(parents=True, exist_ok=True)
        write_json(path, result | {"config": config})
    return {key: value for key, value in result.items() if key != "config"}
