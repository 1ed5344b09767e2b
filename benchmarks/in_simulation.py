"""Integrators of a memoryless network inside the equation of motion: error against a fine one, and time.

    python train.py model=bb1 hydra.run.dir=outputs/bb1
    python benchmarks/in_simulation.py outputs/bb1

Both trajectories of conf/evaluate.yaml; the reference is bdf2 with 64 steps per sample. Writes
benchmarks/results/in_simulation.txt.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf

from frictionpinn.evaluate.in_simulation import INTEGRATORS, simulate_model
from frictionpinn.workflow.load import load_run
from frictionpinn.workflow.trajectories import build_trajectories, transferred

ROOT = Path(__file__).resolve().parents[1]
RESULT = ROOT / "benchmarks" / "results" / "in_simulation.txt"


def main(run: str) -> None:
    with initialize_config_dir(str(ROOT / "conf"), version_base="1.3"):
        options = OmegaConf.to_container(compose("evaluate", overrides=[f"run={run}"]), resolve=True)
    trained, system, model = load_run(run)
    away = transferred(trained, None, options["trajectories"])
    cases = [("bdf2", steps) for steps in (1, 2, 4, 8)] + [(name, 1) for name in INTEGRATORS[1:]]
    lines = [__doc__.split("\n")[0], f"{trained['model']['name']} trained on {system.title}, {away['noise']}"]
    for trajectory in build_trajectories(away, system, None, options):
        fine = simulate_model(system, model, trajectory.path, trajectory.start, 64, "bdf2")
        lines += ["", f"{trajectory.name:<28}{'time, s':>10}{'force, N rms':>14}{'velocity, m/s':>15}"]
        for name, steps in cases:
            began = time.perf_counter()
            found = simulate_model(system, model, trajectory.path, trajectory.start, steps, name)
            seconds = time.perf_counter() - began
            label = f"{name}, {steps} per sample" if name == "bdf2" else f"{name} (torchdiffeq)"
            force = np.sqrt(np.mean((found.F - fine.F) ** 2))
            lines.append(f"{label:<28}{seconds:>10.2f}{force:>14.1e}{np.abs(found.v - fine.v).max():>15.1e}")
    RESULT.write_text("\n".join(lines) + "\n")
    print(RESULT.read_text())


if __name__ == "__main__":
    main(sys.argv[1])
