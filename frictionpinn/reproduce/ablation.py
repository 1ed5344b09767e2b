"""What each choice buys: the presets conf/experiment/ablation_*.yaml, the online error on the held-out swing."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from hydra.core.override_parser.overrides_parser import OverridesParser
from omegaconf import OmegaConf

from ..evaluate.picture import save_png
from ..workflow.build import Config
from ..workflow.configs import CONF
from .draw import ablation_figure
from .runs import Run, by_seed, finish_all


def presets() -> dict[str, tuple[str, list[str]]]:
    """Name of an ablation -> the key that it sweeps and the values, as its preset says."""
    found = {}
    for path in sorted((CONF / "experiment").glob("ablation_*.yaml")):
        preset: Any = OmegaConf.to_container(OmegaConf.load(path))
        params = preset["hydra"]["sweeper"]["params"]
        ((key, values),) = params.items()
        override = OverridesParser.create().parse_override(f"{key}={values}")
        found[path.stem.removeprefix("ablation_")] = (key, list(override.sweep_string_iterator()))
    return found


def run(options: Config, root: Path, results: Path, jobs: int) -> dict[str, Any]:
    """Train every level of every ablation."""
    cfg = options["ablation"]
    keys, runs = [], []
    for name, (key, levels) in presets().items():
        model = cfg["models"].get(name, cfg["models"]["others"])
        for place, level in enumerate(levels):
            for seed in cfg["seeds"]:
                keys.append((name, level, seed))
                overrides = (f"model={model}", f"seed={seed}", f"{key}={level}", *cfg["train"])
                simulated = ((f"seeds=[{seed}]", *cfg["evaluate"]),) if name in cfg["simulated"] else ()
                runs.append(Run(root / "ablation" / f"{name}_{place}_{model}_{seed}", overrides, simulated))
    finished = dict(zip(keys, finish_all(runs, jobs), strict=True))
    table = {}
    for name, (key, levels) in presets().items():
        rows = {}
        for level in levels:
            trained = {seed: finished[name, level, seed][0] for seed in cfg["seeds"]}
            evaluated = {seed: finished[name, level, seed][1] for seed in cfg["seeds"]}
            mse = {seed: result["force_error"]["model"]["mse"] for seed, result in trained.items()}
            seconds = {seed: result["training"]["seconds"]["training"] for seed, result in trained.items()}
            rows[level] = {"online": by_seed(mse), "seconds": by_seed(seconds)}
            if name in cfg["simulated"]:
                rows[level]["in_simulation"] = by_seed({seed: _simulated(one) for seed, (one,) in evaluated.items()})
        table[name] = {"key": key, "model": cfg["models"].get(name, cfg["models"]["others"]), "levels": rows}
    found = {"unit": "N^2", "default": _defaults(table), "ablations": table}
    save_png(ablation_figure(found), results / "ablation.png")
    return found


def _simulated(evaluation: Config) -> float | None:
    """Mean error over the trajectories, the model inside the equation of motion; None where one failed."""
    errors = [methods["model"]["in_simulation"].get("force_mse", {}).get("value")
              for methods in evaluation["errors"].values()]  # fmt: skip
    return None if None in errors else sum(errors) / len(errors)


def _defaults(table: dict[str, Any]) -> dict[str, str]:
    """Name of an ablation -> the level that the configuration has by default."""
    from ..workflow.estimate import default_config

    found = {}
    for name, entry in table.items():
        config = default_config([f"model={entry['model']}"])
        value: Any = config
        for part in entry["key"].split("."):
            value = value[part]
        value = value["name"] if isinstance(value, dict) else value
        plain = str(value).replace(" ", "").replace("'", "")
        found[name] = next(
            (level for level in entry["levels"] if _same(level, plain)), "all" if value is None else plain
        )
    return found


def _same(level: str, value: str) -> bool:
    try:
        return float(level) == float(value)
    except ValueError:
        return level.replace(" ", "").lower() == value.lower()
