"""Step sizes and weights of experiment=memory by the loss on a validation swing.

    python benchmarks/networks_choice.py [--models pe2 bb2] [--seeds 1]

Every candidate is trained on four of the five trials of the pendulum on a box at 5 % noise, seeds from 0, and judged by
its loss on the fifth, the swing of 50 degrees: velocity and force against the noisy measurement. Neither true forces
nor true parameters are read, and Traj. 1, Traj. 2 and the held-out swing are not looked at. What it does not tell is
the weight of pe2: that is a thousand because its law's parameters then came out better on development seeds (3 to 8).
Writes benchmarks/results/networks_choice.txt.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
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
CANDIDATES = {
    "pe2": ["", "model.loss.weight=10", "model.loss.weight=100", "optimizer.lr_physical=2e-2"],
    "bb2": ["", "model.loss.weight=100", "model.loss.weight=10000", "optimizer.lr=3e-3", "optimizer.lr_physical=2e-2"],
}  # fmt: skip


def judged(name: str, option: str, seed: int, folder: Path) -> float:
    """Loss on the validation trial of one training."""
    with initialize_config_dir(str(ROOT / "conf"), version_base="1.3"):
        options = ["experiment=memory", f"model={name}", f"seed={seed}", "data.validation=['3']", *option.split(),
                   "trainer.accelerator=cpu", "trainer.threads=1", "trainer.progress_bar=false"]  # fmt: skip
        cfg: Any = OmegaConf.to_container(compose("train", overrides=options), resolve=True)
    train(cfg, folder)
    cfg, system, model = load_run(folder)
    arrays = [model.arrays(trial, "offline") for trial in build_data(cfg, system).select("validation")]
    batch = {key: torch.from_numpy(np.concatenate([array[key] for array in arrays])) for key in arrays[0]}
    with torch.no_grad():
        parts = model.losses(batch)
    return float(parts["loss"] - parts.get("consistency", 0.0))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--models", nargs="*", default=list(CANDIDATES), choices=list(CANDIDATES))
    parser.add_argument("--seeds", type=int, default=1)
    options = parser.parse_args()
    lines = [f"experiment=memory, loss on the validation swing, mean of {options.seeds} seeds from 0 on, and each"]
    for name in options.models:
        lines.append(f"{name}")
        for option in CANDIDATES[name]:
            with tempfile.TemporaryDirectory() as folder:
                found = [judged(name, option, seed, Path(folder) / str(seed)) for seed in range(options.seeds)]
            each = ", ".join(f"{value:.4f}" for value in found)
            lines.append(f"  {option or 'as it is':<28} {statistics.mean(found):.4f}  ({each})")
            print(lines[-1], flush=True)
            RESULT.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
