"""Accuracy of maximum likelihood on the six-trial pendulum-on-a-box protocol, against the Cramer-Rao bound.

    python benchmarks/identify_accuracy.py [--seeds 50]

5 % noise on all six signals, the swing unknown, noise levels estimated. Bounds are two decades wide and the truth lies
anywhere in their middle 70 %, drawn anew for every seed. Writes benchmarks/results/identify_accuracy.txt.
"""

from __future__ import annotations

import argparse
import os
import platform
import time
from pathlib import Path

import numpy as np
from omegaconf import OmegaConf

from frictionpinn.data.noise import GaussianNoise
from frictionpinn.data.simulated import simulate_recording
from frictionpinn.identify import Problem, bound, maximum_likelihood
from frictionpinn.numerics.descent import levenberg_marquardt
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.mechanism import Mechanism

ROOT = Path(__file__).resolve().parents[1]
RATE_HZ, LEVEL, BASIN = 400.0, 0.05, 5.0  # Hz, -, log-likelihood by which the fit from the truth may be better
RESULT = ROOT / "benchmarks" / "results" / "identify_accuracy.txt"


def protocol() -> tuple[Mechanism, dict[str, float], list[dict]]:
    config = OmegaConf.to_container(OmegaConf.load(ROOT / "conf" / "system" / "pob.yaml"), resolve=True)
    system = SYSTEMS["pob"](**config["parameters"])
    truth = {name: float(value) for name, value in config["simulate"]["truth"].items()}
    return Mechanism(system, LAWS["lugre"]()), truth, config["simulate"]["trials"]


def bounds_for(truth: dict[str, float], seed: int) -> dict[str, tuple[float, float]]:
    shift = 10 ** np.random.default_rng(seed).uniform(-0.7, 0.7, len(truth))
    return {name: (value / 10 * s, value * 10 * s) for (name, value), s in zip(truth.items(), shift, strict=True)}


def cost_from_truth(problem: Problem, truth: dict[str, float], sigmas: dict[str, float]) -> float:
    """Cost of the fit that starts at the truth."""
    problem = problem.varied(limits=problem.space.reaching(truth))  # the default bounds may exclude the truth
    u = problem.space.to_search(truth)
    models = problem.models_at(u)
    evaluate = problem.evaluator(models, sigmas)
    first = evaluate(u, [model.local for model in models], True)
    return levenberg_marquardt(evaluate, first, problem.space.limits, iterations=30).state.cost


def study(seeds: int, start: int = 0) -> list[str]:
    mechanism, truth, trials = protocol()
    clean = simulate_recording(mechanism.system, "lugre", truth, trials, RATE_HZ)
    noise = GaussianNoise(LEVEL)
    limit = bound(mechanism, clean, truth, sigmas=noise.levels(clean)).relative
    known = bound(mechanism, clean, truth, sigmas=noise.levels(clean), inputs="known").relative
    names = list(limit)
    maximum_likelihood(mechanism, noise(clean, 10_000), bounds=bounds_for(truth, 10_000))  # warm
    errors, covered, seconds, processor, simulations, basin = [], [], [], [], [], []
    for seed in range(start, start + seeds):
        wall, cpu = time.perf_counter(), time.process_time()
        problem = Problem(mechanism, noise(clean, seed), bounds=bounds_for(truth, seed))
        estimate = maximum_likelihood(problem)
        seconds.append(time.perf_counter() - wall)
        processor.append(time.process_time() - cpu)
        simulations.append(estimate.n_simulations)
        errors.append([np.log(estimate.values[name] / truth[name]) for name in names])
        covered.append([estimate.ci95[name][0] <= truth[name] <= estimate.ci95[name][1] for name in names])
        behind = estimate.cost - cost_from_truth(problem, truth, estimate.sigmas)
        basin.append(behind)
        print(seed, estimate.outcome, f"{seconds[-1]:.1f} s, behind {behind:.2f}", np.round(errors[-1], 4), flush=True)
    rmse = np.sqrt(np.nanmean(np.square(errors), axis=0))
    lines = [
        f"Maximum likelihood on six pendulum-on-a-box trials, {len(clean)} samples, {seeds} noise seeds,"
        " 5 % noise on all six signals",
        f"Python {platform.python_version()}, {os.cpu_count()} cores (shared), load {os.getloadavg()[0]:.1f}",
        "errors are of the logarithm; bound: Cramer-Rao, swing unknown; in brackets with the swing known",
        "",
        f"{'':10s}{'bound %':>9s}{'(known)':>10s}{'RMSE %':>9s}{'/ bound':>9s}{'mean %':>9s}{'covered %':>11s}",
    ]
    for j, name in enumerate(names):
        lines.append(
            f"{name:10s}{100 * limit[name]:9.3f}{100 * known[name]:10.3f}{100 * rmse[j]:9.3f}"
            f"{rmse[j] / limit[name]:9.2f}"
            f"{100 * np.nanmean(errors, axis=0)[j]:9.3f}{100 * np.mean(covered, axis=0)[j]:11.0f}"
        )
    lines += [
        "",
        f"at most {BASIN:g} in log-likelihood behind the fit that starts at the truth: "
        f"{sum(b < BASIN for b in basin)} of {seeds}; "
        f"better than it: {sum(b < -0.5 for b in basin)}; behind by at most {max(basin):.1f}",
        f"time: median {np.median(seconds):.2f} s wall, {np.median(processor):.2f} s processor; "
        f"simulations of the whole recording: median {np.median(simulations):.0f}",
    ]
    return lines


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=50)
    parser.add_argument(
        "--from-seed", type=int, default=0, help="first noise seed; other than 0 writes a file of its own"
    )
    chosen = parser.parse_args()
    text = study(chosen.seeds, chosen.from_seed)
    suffix = f"_from_{chosen.from_seed}" if chosen.from_seed else ""
    target = RESULT.with_stem(RESULT.stem + suffix)
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_text("\n".join(text) + "\n")
    print("\n".join(text))
