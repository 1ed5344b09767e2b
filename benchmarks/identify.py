"""Every estimator on the same data, machine and simulator: error over the bound, time, simulations.

    python benchmarks/identify.py --seeds 3

The six-trial protocol of conf/system/pob.yaml at 5 % noise; bounds two decades wide with the truth somewhere inside,
the searches start anywhere within them. "inputs fixed": maximum likelihood with what the searches have, the swing taken
as its smoothed path. An estimator that returns no value for a parameter has an infinite error. Writes
benchmarks/results/identify.txt and identify.png.
"""

from __future__ import annotations

import argparse
import statistics
import time
from pathlib import Path

import numpy as np
from identify_accuracy import bounds_for
from matplotlib.figure import Figure
from omegaconf import OmegaConf

from frictionpinn.data.noise import GaussianNoise
from frictionpinn.data.simulated import simulate_recording
from frictionpinn.identify.likelihood import maximum_likelihood
from frictionpinn.identify.problem import Problem
from frictionpinn.identify.search_methods import METHODS, search
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.mechanism import Mechanism

ROOT = Path(__file__).resolve().parents[1]
COLORS = {
    "maximum_likelihood": "#d1495b",
    "maximum_likelihood, inputs fixed": "#edae49",
    "least_squares": "#2a9d8f",
    "nelder_mead": "#457b9d",
    "genetic": "#8d99ae",
}
SCORED = ("sigma_0", "sigma_1", "sigma_2", "mu_c")


def protocol():
    """Mechanism, noise-free recording and truth."""
    cfg = OmegaConf.to_container(OmegaConf.load(ROOT / "conf" / "system" / "pob.yaml"))
    system, spec = SYSTEMS["pob"](**cfg["parameters"]), cfg["simulate"]
    recording = simulate_recording(system, spec["friction"], spec["truth"], spec["trials"], 400.0)
    return Mechanism(system, LAWS["lugre"]()), recording, spec["truth"]


def error(values, truth: dict[str, float]) -> float:
    """Root mean square of the relative errors of sigma_0, sigma_1, sigma_2 and mu_c, each over its bound."""
    bound = {"sigma_0": 0.027, "sigma_1": 0.017, "sigma_2": 0.022, "mu_c": 0.0004}
    found = float(np.sqrt(np.mean([((values[n] / truth[n] - 1) / bound[n]) ** 2 for n in SCORED])))
    return found if np.isfinite(found) else np.inf


def run(method: str, mechanism: Mechanism, recording, seed: int, truth) -> dict:
    """One estimator on one draw of the noise: its estimate, time and the errors on the way."""
    noisy = GaussianNoise(0.05)(recording, seed)
    bounds = bounds_for(truth, seed)
    began = time.perf_counter()
    if method.startswith("maximum_likelihood"):
        inputs = "fixed" if method.endswith("fixed") else "joint"
        estimate = maximum_likelihood(mechanism, noisy, bounds=bounds, inputs=inputs)
        path = []
    else:
        problem = Problem(mechanism, noisy, bounds=bounds)
        estimate = search(method, problem, start=random_start(bounds, seed), seed=seed)
        names = problem.names
        path = [
            (row[0], error(dict(zip(names, p, strict=True)), truth))
            for row, p in zip(estimate.details["trace"], estimate.details["path"], strict=True)
        ]
    seconds = time.perf_counter() - began
    final = error(estimate.values, truth)
    return {"estimate": estimate, "seconds": seconds, "path": [*path, (seconds, final)], "error": final}


def random_start(bounds: dict, seed: int) -> dict[str, float]:
    """A start log-uniform within the bounds, mu_s above mu_c."""
    generator = np.random.default_rng(seed)
    start = {name: float(np.exp(generator.uniform(*np.log(pair)))) for name, pair in bounds.items()}
    start["mu_s"] = max(start["mu_s"], 1.05 * start["mu_c"])
    return start


def table(results: dict[str, list[dict]], truth: dict[str, float]) -> str:
    """Medians over seeds, an estimator a line."""
    names = list(truth)
    lines = [
        f"{'estimator':<34}{'time, s':>9}{'simulations':>13}{'error/bound':>13}" + "".join(f"{n:>10}" for n in names)
    ]
    for method, runs in results.items():
        cells = [
            statistics.median(r["seconds"] for r in runs),
            statistics.median(r["estimate"].n_simulations for r in runs),
        ]
        text = f"{method:<34}{cells[0]:>9.2f}{cells[1]:>13.0f}{statistics.median(r['error'] for r in runs):>13.2f}"
        for name in names:
            off = statistics.median(abs(r["estimate"].values[name] / truth[name] - 1) for r in runs)
            text += f"{100 * off:>9.2f}%"
        lines.append(text)
    ours = statistics.median(r["seconds"] for r in results["maximum_likelihood"])
    for method in results:
        if not method.startswith("maximum_likelihood"):
            ratio = statistics.median(r["seconds"] for r in results[method]) / ours
            lines.append(f"maximum likelihood is {ratio:.1f} times faster than {method}")
    return "\n".join(lines)


def draw(results: dict[str, list[dict]]) -> Figure:
    """Error against time, a line for each run."""
    figure = Figure(figsize=(8, 5), layout="constrained")
    axes = figure.subplots()
    for method, runs in results.items():
        for k, item in enumerate(runs):
            times, errors = zip(*item["path"], strict=True)
            label = method.replace("_", " ") if k == 0 else None
            axes.plot(times, errors, color=COLORS[method], lw=1.2, alpha=0.8, label=label)
            axes.plot(times[-1], errors[-1], "o", color=COLORS[method], ms=6)
    axes.axhline(1.0, color="#222222", lw=0.8, ls="--")
    axes.set(
        xscale="log", yscale="log", xlabel="time (s)", ylabel="error over the bound (sigma_0, sigma_1, sigma_2, mu_c)"
    )
    axes.text(0.02, 1.08, "Cramer-Rao bound", transform=axes.get_yaxis_transform(), fontsize=9)
    axes.set_title("Identification of LuGre friction at 5 % noise: error against time")
    figure.legend(loc="outside lower center", ncols=3, frameon=False, fontsize=9)
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument(
        "--methods", nargs="*", default=["maximum_likelihood", "maximum_likelihood, inputs fixed", *METHODS]
    )
    arguments = parser.parse_args()
    mechanism, recording, truth = protocol()
    maximum_likelihood(mechanism, GaussianNoise(0.05)(recording, 999))  # compiled code warm
    results: dict[str, list[dict]] = {method: [] for method in arguments.methods}
    for seed in range(arguments.seeds):
        for method in arguments.methods:
            results[method].append(run(method, mechanism, recording, seed, truth))
            print(
                method,
                seed,
                f"{results[method][-1]['seconds']:.1f} s, error {results[method][-1]['error']:.2f}",
                flush=True,
            )
    text = f"python benchmarks/identify.py --seeds {arguments.seeds}\nmedians over seeds\n{table(results, truth)}\n"
    print(text)
    folder = ROOT / "benchmarks" / "results"
    (folder / "identify.txt").write_text(text)
    draw(results).savefig(folder / "identify.png", dpi=120)


if __name__ == "__main__":
    main()
