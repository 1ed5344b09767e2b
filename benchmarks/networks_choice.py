"""Step sizes, weights and start of experiment=memory by the loss on a validation swing.

    python benchmarks/networks_choice.py [--models pe2 bb2] [--seeds 4] [--fresh]

Every candidate is trained on four of the five trials of the pendulum on a box at 5 % noise, seeds from 0, once as
declared and once with a drag that nobody declared, and judged by its loss on the fifth trial, the swing of 50 degrees:
velocity and force against the noisy measurement. Where a black box starts is judged by the loss that its training
reaches, which is the same for all starts. Neither true forces nor true parameters are read, and Traj. 1, Traj. 2 and
the held-out swing are not looked at.

A weight is chosen by the rule of one standard error (Breiman et al., Classification and Regression Trees, 1984, 3.4.3):
the largest, whose network departs least, of those whose loss is within one standard error of the least; the standard
error is that of the difference to the best on the same recordings. Writes benchmarks/results/networks_choice.txt; every
loss is kept in the .json beside it, from which the next call goes on; --fresh begins anew.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import torch
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf

from frictionpinn.workflow.experiment import build_data
from frictionpinn.workflow.load import load_run
from frictionpinn.workflow.train import train

ROOT = Path(__file__).resolve().parents[1]
RESULT = ROOT / "benchmarks" / "results" / "networks_choice.txt"
WEIGHTS = {"pe2": (1, 10, 100, 1000), "bb2": (100, 1000, 10000)}
STEPS = {"pe2": ["optimizer.lr_physical=2e-2"], "bb2": ["optimizer.lr=1e-2"]}
BY_VALIDATION = {name: [f"model.loss.weight={w}" for w in own] + STEPS[name] for name, own in WEIGHTS.items()}
BY_TRAINING = {"bb2": ["model.state.start=law", "model.state.start=reach"]}
TOLD = {"validation": "validation swing", "train": "training"}
RECORDINGS = {"as declared": (), "undeclared drag": ("data.effects={drag: {drag: 1.0}}",)}  # N s^2/m^2


def judged(name: str, changes: Sequence[str], seed: int, folder: Path, split: str) -> float:
    """Loss of one training on the trials of a split."""
    with initialize_config_dir(str(ROOT / "conf"), version_base="1.3"):
        options = ["experiment=memory", f"model={name}", f"seed={seed}", "data.validation=['3']", *changes,
                   "trainer.accelerator=cpu", "trainer.threads=1", "trainer.progress_bar=false"]  # fmt: skip
        cfg: Any = OmegaConf.to_container(compose("train", overrides=options), resolve=True)
    train(cfg, folder)
    cfg, system, model = load_run(folder)
    arrays = [model.arrays(trial, "offline") for trial in build_data(cfg, system).select(split)]
    batch = {key: torch.from_numpy(np.concatenate([array[key] for array in arrays])) for key in arrays[0]}
    with torch.no_grad():
        parts = model.losses(batch)
    return float(parts["loss"] - parts.get("consistency", 0.0))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--models", nargs="*", default=list(WEIGHTS), choices=list(WEIGHTS))
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--fresh", action="store_true", help="forget what is kept")
    options = parser.parse_args()
    kept = RESULT.with_suffix(".json")
    known = json.loads(kept.read_text()) if kept.exists() and not options.fresh else {}
    lines = [f"experiment=memory, losses, seeds 0 to {options.seeds - 1}"]
    for split, candidates in {"validation": BY_VALIDATION, "train": BY_TRAINING}.items():
        for name, own in candidates.items():
            found = {option: np.full((len(RECORDINGS), options.seeds), np.nan) for option in own}
            for option, (row, recording), seed in product(own, enumerate(RECORDINGS), range(options.seeds)):
                key = f"{name} {option} {recording} {seed}"
                if key not in known and name in options.models:
                    with tempfile.TemporaryDirectory() as folder:
                        changes = [option, *RECORDINGS[recording]]
                        known[key] = judged(name, changes, seed, Path(folder) / "run", split)
                    print(key, round(known[key], 4), flush=True)
                    kept.write_text(json.dumps(known))
                found[option][row, seed] = known.get(key, np.nan)
            if not np.isnan(list(found.values())).any():
                lines += table(f"{name}, {TOLD[split]}", found)
    RESULT.write_text("\n".join(lines) + "\n")
    print(RESULT.read_text())


def table(what: str, found: dict[str, np.ndarray]) -> list[str]:
    """Mean loss of every candidate by recording, and what it is above the best with the standard error of that."""
    best = min(found.values(), key=np.mean)
    lines = [f"{what:<30}" + "".join(f"{recording:>18}" for recording in RECORDINGS) + "    above the best"]
    for option, losses in found.items():
        above = (losses - best).ravel()
        error = above.std(ddof=1) / np.sqrt(above.size)
        means = "".join(f"{mean:>18.4f}" for mean in losses.mean(1))
        lines.append(f"  {option:<28}{means}    {above.mean():.4f} +- {error:.4f}")
    return lines


if __name__ == "__main__":
    main()
