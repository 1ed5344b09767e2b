"""Maximum likelihood on other systems and laws: wrong minima and coverage over noise draws.

    python benchmarks/identify_systems.py [--seeds 12] [--cases drive:stribeck sdob:stribeck drive:lugre sdob:lugre]

All trials of conf/system, 200 Hz, 5 % noise on every signal, default bounds. A fit that started at the truth shows what
the search missed: "behind" counts estimates whose cost is higher by more than 5 in log-likelihood. What an estimate
names as not told is counted apart. Writes benchmarks/results/identify_systems.txt.
"""

from __future__ import annotations

import argparse
import os
import platform
import time

import numpy as np
from identify_accuracy import BASIN, ROOT, cost_from_truth
from omegaconf import OmegaConf

from frictionpinn.data.noise import GaussianNoise
from frictionpinn.data.simulated import simulate_recording
from frictionpinn.identify import Problem, maximum_likelihood
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.mechanism import Mechanism

RESULT = ROOT / "benchmarks" / "results" / "identify_systems.txt"
RATE_HZ, LEVEL = 200.0, 0.05
CASES = ("drive:stribeck", "sdob:stribeck", "drive:lugre", "sdob:lugre")


def study(system: str, law: str, seeds: int) -> list[str]:
    """One system and law over all seeds: a line a parameter."""
    config = OmegaConf.to_container(OmegaConf.load(ROOT / "conf" / "system" / f"{system}.yaml"), resolve=True)
    mechanism = Mechanism(SYSTEMS[system](**config["parameters"]), LAWS[law]())
    wanted = [par.name for par in mechanism.law.parameters if par.value is None]
    truth = {name: float(config["simulate"]["truth"][name]) for name in wanted}
    clean = simulate_recording(mechanism.system, law, truth, config["simulate"]["trials"], RATE_HZ)
    errors, deviations, covered, behind, seconds = [], [], [], 0, []
    for seed in range(seeds):
        began = time.process_time()
        problem = Problem(mechanism, GaussianNoise(LEVEL)(clean, seed))
        estimate = maximum_likelihood(problem)
        seconds.append(time.process_time() - began)
        names = problem.names
        errors.append([np.log(estimate.values[n] / truth[n]) for n in names])
        deviations.append([estimate.std[n] / estimate.values[n] for n in names])
        covered.append([_inside(estimate.ci95[n], truth[n]) for n in names])
        behind += estimate.cost - cost_from_truth(problem, truth, estimate.sigmas) > BASIN
        print(system, law, seed, estimate.outcome, np.round(errors[-1], 3), np.round(deviations[-1], 3), flush=True)
    lines = ["", f"{system}, {law}: {seeds} seeds, behind in {behind}, processor time {np.median(seconds):.1f} s",
             f"{'':10s}{'RMSE %':>9s}{'median std error %':>20s}{'covered %':>11s}{'told in':>9s}"]  # fmt: skip
    for j, name in enumerate(names):
        told = [row[j] for row in covered if row[j] is not None]
        rmse = 100 * np.sqrt(np.nanmean(np.square([row[j] for row in errors])))
        width = 100 * np.nanmedian([row[j] for row in deviations])
        lines.append(f"{name:10s}{rmse:9.2f}{width:20.2f}{100 * np.mean(told):11.0f}{len(told):9d}")
    return lines


def _inside(interval: tuple[float, float], value: float) -> bool | None:
    return interval[0] <= value <= interval[1] if np.isfinite(interval).all() else None


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=12)
    parser.add_argument("--cases", nargs="*", default=list(CASES))
    chosen = parser.parse_args()
    text = [
        "Maximum likelihood at 5 % noise on every signal, 200 Hz, noise levels estimated; errors of the logarithm",
        f"Python {platform.python_version()}, {os.cpu_count()} cores (shared), load {os.getloadavg()[0]:.1f}",
    ]
    for item in chosen.cases:
        text += study(*item.split(":"), chosen.seeds)
        print("\n".join(text), flush=True)
        RESULT.write_text("\n".join(text) + "\n")
