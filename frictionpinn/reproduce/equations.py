"""What the published equations of motion cost: believed on data that obey Lagrange's, and believed and obeyed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ..data.noise import GaussianNoise
from ..physics import LAWS
from ..physics.mechanism import Mechanism
from ..workflow.build import Config, build_recording, build_system
from ..workflow.estimate import default_config, estimate
from .fidelity import KINDS
from .runs import Run, finish_all, training

CASES = {  # believed by the model, obeyed by the data
    "lagrange": ("lagrange", "lagrange"),
    "published, data obey lagrange": ("published", "lagrange"),
    "published throughout": ("published", "published"),
}


def run(options: Config, root: Path, results: Path, jobs: int) -> dict[str, Any]:
    """Train and evaluate every model under each pair of equations; identify the parameters under each too."""
    cfg = options["equations"]
    seed = int(cfg["seed"])
    keys = [(case, model) for case in CASES for model in cfg["models"]]
    finished = dict(zip(keys, finish_all([_run(cfg, root, *key, seed) for key in keys], jobs), strict=True))
    errors: dict[str, Any] = {}
    for (case, model), (_, evaluated) in finished.items():
        for trajectory, methods in evaluated[0]["errors"].items():
            for name in ("model", "force_balance"):
                row = {kind: methods[name].get(kind, {}).get("force_mse", {}).get("value") for kind in KINDS}
                key = model if name == "model" else name
                errors.setdefault(case, {}).setdefault(trajectory, {})[key] = row
    return {"unit": "N^2", "errors": errors, "identified": {case: identified(case, seed) for case in CASES}}


def _run(cfg: Config, root: Path, case: str, model: str, seed: int) -> Run:
    believed, obeyed = CASES[case]
    folder, equations = f"pob_{model}_{seed}", ()  # that of the fidelity
    if case != "lagrange":
        folder += f"_{believed}_{obeyed}"
        equations = (f"system.equations={believed}", f"data.equations={obeyed}")  # type: ignore[assignment]
    overrides = (*training(cfg, model, seed), *equations)
    return Run(root / folder, overrides, ((f"seeds=[{seed}]", *cfg["evaluate"]),))


def identified(case: str, seed: int, *options: str) -> dict[str, Any]:
    """Maximum-likelihood estimate, standard error and truth of every parameter; ``options`` of the command beside."""
    believed, obeyed = CASES[case]
    config = default_config([f"system.equations={believed}", f"data.equations={obeyed}", *options])
    system, table = build_system(config["system"]), config["data"]
    clean = build_recording(table, system)
    noisy = GaussianNoise(float(config["noise"]["level"]))(clean, seed)
    names = [name for name in clean.names if name not in {str(item) for item in table["held_out"]}]
    found = estimate("maximum_likelihood", Mechanism(system, LAWS["lugre"]()), noisy.select(names))
    parameters = found.to_dict()["parameters"]
    return {
        name: {key: entry[key] for key in ("value", "std", "unit")} | {"truth": table["truth"][name]}
        for name, entry in parameters.items()
    }
