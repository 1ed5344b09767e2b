"""Every estimator on the same data, machine and simulator: how long until its error is as small as it gets.

    python benchmarks/identify.py [--seeds 3] [--budget 150]
    python benchmarks/identify.py --from-seed 1 --seeds 1 --keep     # adds to what was measured before

The six-trial protocol of conf/system/pob.yaml at 5 % noise; bounds two decades wide with the truth somewhere inside.
The searches start anywhere within them and, as a user would who knows no truth, start anew elsewhere when they have
converged, until their budget (s) is spent; what counts at any time is the point of lowest cost so far. Their cost takes
the swing as its smoothed path; "inputs fixed" is maximum likelihood under the same assumption. The error is the root
mean square of the relative errors of sigma_0, sigma_1, sigma_2 and mu_c, each over its Cramer-Rao bound; an estimator
that names no value for a parameter has an infinite one. Writes identify.json, identify.txt and
identify.png.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from identify_accuracy import bounds_for, protocol
from matplotlib.figure import Figure

from frictionpinn.data.noise import GaussianNoise
from frictionpinn.data.recording import Recording
from frictionpinn.data.simulated import simulate_recording
from frictionpinn.evaluate.search_methods import METHODS, search
from frictionpinn.identify import Problem, bound, maximum_likelihood
from frictionpinn.physics.mechanism import Mechanism

RESULTS = Path(__file__).resolve().parent / "results"
COLORS = {
    "maximum_likelihood": "#d1495b",
    "maximum_likelihood, inputs fixed": "#edae49",
    "least_squares": "#2a9d8f",
    "nelder_mead": "#457b9d",
    "genetic": "#8d99ae",
}
SCORED = ("sigma_0", "sigma_1", "sigma_2", "mu_c")
TARGETS = (30.0, 10.0, 5.0, 2.0)  # times the bound
LEVEL = 0.05


@dataclass(frozen=True)
class Case:
    """The protocol: model, clean recording, truth, and relative standard errors at the bound."""

    mechanism: Mechanism
    clean: Recording
    truth: dict[str, float]
    limit: dict[str, float]

    def error(self, values) -> float:
        """Root mean square over SCORED of relative error over bound; infinite where a value is missing."""
        ratios = [(values[n] / self.truth[n] - 1) / self.limit[n] for n in SCORED]
        found = float(np.sqrt(np.mean(np.square(ratios))))
        return found if np.isfinite(found) else np.inf


@dataclass(frozen=True)
class Run:
    """One estimator on one draw of the noise.

    Attributes:
        path: (s, error) at every new lowest cost.
        first: s until it converged for the first time, and its error then.
        simulations: of the whole recording, up to then.
        values: at the end.
        spent: s, of all searches together.
    """

    path: list[tuple[float, float]]
    first: tuple[float, float]
    simulations: int
    values: dict[str, float]
    spent: float = 0.0

    @property
    def final(self) -> float:
        """Error at the end."""
        return self.path[-1][1]

    def reached(self, target: float) -> float:
        """Time after which the error stays at most ``target``; infinite where it does not."""
        above = [k for k, (_, error) in enumerate(self.path) if error > target]
        last = max(above, default=-1)
        return self.path[last + 1][0] if last + 1 < len(self.path) else np.inf


def case() -> Case:
    """The protocol without noise, and its bound."""
    mechanism, truth, trials = protocol()
    clean = simulate_recording(mechanism.system, "lugre", truth, trials, 400.0)
    limit = bound(mechanism, clean, truth, sigmas=GaussianNoise(LEVEL).levels(clean)).relative
    return Case(mechanism, clean, truth, limit)


def random_start(bounds: dict, generator: np.random.Generator) -> dict[str, float]:
    """A start log-uniform within the bounds, mu_s above mu_c."""
    start = {name: float(np.exp(generator.uniform(*np.log(pair)))) for name, pair in bounds.items()}
    start["mu_s"] = max(start["mu_s"], 1.05 * start["mu_c"])
    return start


def likelihood_run(method: str, own: Case, noisy: Recording, bounds: dict) -> Run:
    """Maximum likelihood: one number, its end."""
    began = time.perf_counter()
    inputs = "fixed" if method.endswith("fixed") else "joint"
    estimate = maximum_likelihood(own.mechanism, noisy, bounds=bounds, inputs=inputs)
    end = time.perf_counter() - began, own.error(estimate.values)
    return Run([end], end, estimate.n_simulations, estimate.values)


def search_run(method: str, own: Case, noisy: Recording, bounds: dict, seed: int, budget: float) -> Run:
    """A search method, started anew until the budget is spent."""
    generator, began = np.random.default_rng(seed), time.perf_counter()
    problem = Problem(own.mechanism, noisy, bounds=bounds)
    path: list[tuple[float, float]] = []
    first, simulations, best, restart = (np.inf, np.inf), 0, np.inf, 0
    values: dict[str, float] = {}
    while (spent := time.perf_counter() - began) < budget:
        rate = problem.simulations / spent if restart else np.inf  # the first run may end by itself
        allowed = max(2.0, rate * (budget - spent))
        found = search(method, problem, start=random_start(bounds, generator), seed=seed + restart, simulations=allowed)
        for improvement in found.path:
            if improvement.cost < best:
                best, values = improvement.cost, improvement.values
                path.append((spent + improvement.seconds, own.error(values)))
        if restart == 0:
            first, simulations = (time.perf_counter() - began, own.error(values)), problem.simulations
        restart += 1
    return Run(path, first, simulations, values, time.perf_counter() - began)


def median(values) -> str:
    """Median of times, '-' where more than half are infinite."""
    middle = statistics.median_high(list(values))
    return f"{middle:.2f}" if np.isfinite(middle) else "-"


def comparison(results: dict[str, list[Run]]) -> list[str]:
    """How many times faster maximum likelihood is than each search, by three measures, a line each."""
    ours, fixed = results["maximum_likelihood"], results["maximum_likelihood, inputs fixed"]
    lines = [
        "How many times faster maximum likelihood is than a search that starts anew until it is as good (A), until it",
        "is as good as maximum likelihood on the search's own cost, with inputs fixed (B), and than one search from",
        "one start, which is not as good (C, its error over the bound in brackets); medians",
        ">=: it never was, within its budget or its first run, whichever is longer",
    ]
    for method, runs in results.items():
        if method.startswith("maximum_likelihood"):
            continue
        as_good, as_fixed = (
            ratio([faster(run, other, own) for run, other, own in zip(runs, rivals, ours, strict=True)])
            for rivals in (ours, fixed)
        )
        once = statistics.median(run.first[0] / own.first[0] for run, own in zip(runs, ours, strict=True))
        lines.append(
            f"{method:<34}A {as_good:>9}   B {as_fixed:>9}   C {once:8.1f} ({median(r.first[1] for r in runs)})"
        )
    return lines


def ratio(found: list[tuple[float, bool]]) -> str:
    """Median of ratios; at least that where most were never reached."""
    middle, reached = sorted(found)[(len(found) - 1) // 2]
    return f"{'' if reached else '>='}{middle:.1f}"


def faster(run: Run, rival: Run, ours: Run) -> tuple[float, bool]:
    """Time of a search until its error stays at most the rival's, over our time; and whether it ever does."""
    reached = run.reached(rival.final)
    spent = reached if np.isfinite(reached) else max(run.spent, run.first[0])
    return spent / ours.first[0], bool(np.isfinite(reached))


def table(results: dict[str, list[Run]], own: Case, budget: float) -> str:
    """Medians over seeds, an estimator a line; then how many times faster maximum likelihood is."""
    head = f"{'':<34}{'converges, s':>13}{'simulations':>13}{'error then':>12}{'at the end':>12}"
    lines = [head + "".join(f"{f'<= {t:g}, s':>11}" for t in TARGETS)]
    for method, runs in results.items():
        text = (
            f"{method:<34}{median(r.first[0] for r in runs):>13}{statistics.median(r.simulations for r in runs):>13.0f}"
        )
        text += f"{median(r.first[1] for r in runs):>12}{median(r.final for r in runs):>12}"
        lines.append(text + "".join(f"{median(r.reached(t) for r in runs):>11}" for t in TARGETS))
    lines += ["", "error: over the bound; <= 10, s: time after which it stays at most 10; -: not by most runs within "
              f"{budget:g} s", ""]  # fmt: skip
    lines += [*comparison(results), ""]
    lines.append("relative errors at the end, medians, %: " + ", ".join(own.truth))
    for method, runs in results.items():
        off = [100 * statistics.median(abs(r.values[n] / own.truth[n] - 1) for r in runs) for n in own.truth]
        lines.append(f"{method:<34}" + "".join(f"{x:>10.2f}" for x in off))
    return "\n".join(lines)


def draw(results: dict[str, list[Run]], budget: float) -> Figure:
    """Error against time, a line for each run."""
    figure = Figure(figsize=(8, 5), layout="constrained")
    axes = figure.subplots()
    for method, runs in results.items():
        for k, run in enumerate(runs):
            times, errors = zip(*run.path, strict=True)
            label = method.replace("_", " ") if k == 0 else None
            if len(times) == 1:
                axes.plot(times, errors, "o", color=COLORS[method], ms=8, label=label)
                continue
            axes.step(
                [*times, max(budget, run.spent)],
                [*errors, errors[-1]],
                where="post",
                color=COLORS[method],
                lw=1.2,
                label=label,
            )
    axes.axhline(1.0, color="#222222", lw=0.8, ls="--")
    axes.set(xscale="log", yscale="log", xlabel="time (s)",
             ylabel="error over the bound (sigma_0, sigma_1, sigma_2, mu_c)")  # fmt: skip
    axes.text(0.02, 1.08, "Cramer-Rao bound", transform=axes.get_yaxis_transform(), fontsize=9)
    axes.set_title("Identification of LuGre friction at 5 % noise: error against time")
    figure.legend(loc="outside lower center", ncols=3, frameon=False, fontsize=9)
    return figure


def earlier(file: Path, budget: float) -> dict[str, dict[str, Run]]:
    """Runs measured before with the same budget: method -> seed -> run."""
    saved = json.loads(file.read_text()) if file.exists() else {"budget": None}
    if saved["budget"] != budget:
        return {}
    return {
        method: {
            seed: Run(
                [(s, e) for s, e in run["path"]],
                tuple(run["first"]),
                run["simulations"],
                run["values"],
                run.get("spent", 0.0),
            )
            for seed, run in runs.items()
        }
        for method, runs in saved["methods"].items()
    }


def write(folder: Path, measured: dict[str, dict[str, Run]], own: Case, budget: float) -> None:
    """The runs, their table and their figure."""
    plain = {method: {seed: asdict(run) for seed, run in runs.items()} for method, runs in measured.items()}
    (folder / "identify.json").write_text(json.dumps({"budget": budget, "methods": plain}) + "\n")
    complete = set.intersection(*(set(runs) for runs in measured.values()))  # seeds that every method has
    if not complete:
        return
    seeds = sorted(complete, key=int)
    results = {method: [runs[seed] for seed in seeds] for method, runs in measured.items()}
    text = (
        f"python benchmarks/identify.py --seeds {len(seeds)} --budget {budget:g}\n"
        f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}; medians over seeds\n\n{table(results, own, budget)}\n"
    )
    print(text)
    (folder / "identify.txt").write_text(text)
    draw(results, budget).savefig(folder / "identify.png", dpi=120)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--from-seed", type=int, default=0)
    parser.add_argument("--budget", type=float, default=150.0, help="s for each search and seed")
    parser.add_argument("--folder", type=Path, default=RESULTS)
    parser.add_argument("--methods", nargs="*", default=list(METHODS), choices=list(METHODS))
    parser.add_argument("--keep", action="store_true", help="keep other seeds and methods of identify.json")
    arguments = parser.parse_args()
    own, noise = case(), GaussianNoise(LEVEL)
    methods = ["maximum_likelihood", "maximum_likelihood, inputs fixed", *arguments.methods]
    measured = earlier(arguments.folder / "identify.json", arguments.budget) if arguments.keep else {}
    for method in methods[:2]:  # compiled code warm
        likelihood_run(method, own, noise(own.clean, 999), bounds_for(own.truth, 999))
    for seed in range(arguments.from_seed, arguments.from_seed + arguments.seeds):
        noisy, bounds = noise(own.clean, seed), bounds_for(own.truth, seed)
        for method in methods:
            if method.startswith("maximum_likelihood"):
                run = likelihood_run(method, own, noisy, bounds)
            else:
                run = search_run(method, own, noisy, bounds, seed, arguments.budget)
            measured.setdefault(method, {})[str(seed)] = run
            print(f"{method} {seed}: {run.first[0]:.1f} s, error {run.first[1]:.2f}, end {run.final:.2f}", flush=True)
        write(arguments.folder, measured, own, arguments.budget)


if __name__ == "__main__":
    main()
