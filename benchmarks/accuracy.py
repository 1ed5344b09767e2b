"""Accuracy of configurations over seeds: online force error on the held-out swing, and parameters against the truth.

    python benchmarks/accuracy.py --name defaults --seeds 5 model=pe2,bb2
    python benchmarks/accuracy.py --name lambda --seeds 3 model=pe2 model.loss.weight=0.1,1,10

Every other argument is an override of train.py; lists are swept. Writes benchmarks/results/accuracy_NAME.txt.
"""

from __future__ import annotations

import argparse
import itertools
import statistics
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def run(overrides: list[str]) -> dict:
    """Train one configuration and return its result."""
    from hydra import compose, initialize_config_dir
    from omegaconf import OmegaConf

    from frictionpinn.workflow.train import train

    with initialize_config_dir(str(ROOT / "conf"), version_base="1.3"):
        cfg = OmegaConf.to_container(compose("train", overrides=[*overrides, "trainer.threads=1"]), resolve=True)
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        return train(cfg, Path(folder))


def row(label: str, results: list[dict]) -> str:
    """One line of the table: medians over seeds, and the range of the force error."""
    mse = [item["force_error"]["model"]["mse"] for item in results]
    seconds = statistics.median(item["training"]["seconds"]["training"] for item in results)
    text = f"{label:<58} mse {statistics.median(mse):.4f} ({min(mse):.4f} to {max(mse):.4f})"
    for name in results[0]["parameters"]:
        known = [item["parameters"][name] for item in results]
        if "truth" in known[0]:
            errors = [100 * (entry["value"] / entry["truth"] - 1) for entry in known]
            text += f"  {name} {statistics.median(errors):+.2f}% (|.| {statistics.median(map(abs, errors)):.2f})"
    return text + f"  {seconds:.0f} s"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--name", required=True)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--jobs", type=int, default=2)
    arguments, overrides = parser.parse_known_args()
    lists = [[f"{key}={value}" for value in _split(values)] for key, _, values in (o.partition("=") for o in overrides)]
    cases = [list(case) for case in itertools.product(*lists)]
    jobs = [[*case, f"seed={seed}"] for case in cases for seed in range(arguments.seeds)]
    with ProcessPoolExecutor(arguments.jobs, mp_context=get_context("spawn")) as pool:
        results = list(pool.map(run, jobs))
    unit = results[0]["force_error"]["unit"]["mse"]
    lines = [f"python benchmarks/accuracy.py {' '.join(sys.argv[1:])}"]
    lines.append(
        f"medians over {arguments.seeds} seeds; mse: online force error on held-out trials, {unit}; seconds of training"
    )
    for k, case in enumerate(cases):
        lines.append(row(" ".join(case), results[k * arguments.seeds : (k + 1) * arguments.seeds]))
    text = "\n".join(lines) + "\n"
    print(text)
    (ROOT / "benchmarks" / "results" / f"accuracy_{arguments.name}.txt").write_text(text)
    if arguments.name == "defaults":
        grouped = [results[k * arguments.seeds : (k + 1) * arguments.seeds] for k in range(len(cases))]
        fill_page("accuracy", markdown(grouped, unit))


def markdown(groups: list[list[dict]], unit: str) -> str:
    """The documentation's table: median force error, and median error of the well-determined parameters."""
    lines = [
        f"| model | online force error, {unit} | Coulomb + viscous fit, {unit} | mu_c | sigma_2 | training, s |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for results in groups:
        cells = [results[0]["model"]]
        for key in ("model", "coulomb_viscous"):
            cells.append(f"{statistics.median(item['force_error'][key]['mse'] for item in results):.3f}")
        for name in ("mu_c", "sigma_2"):
            found = [item["parameters"].get(name) for item in results]
            known = [abs(100 * (entry["value"] / entry["truth"] - 1)) for entry in found if entry]
            cells.append(f"{statistics.median(known):.2f} % off" if known else "")
        cells.append(f"{statistics.median(item['training']['seconds']['training'] for item in results):.0f}")
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def fill_page(name: str, table: str) -> None:
    """Put a table between its markers in docs/accuracy.md."""
    path = ROOT / "docs" / "accuracy.md"
    head, _, rest = path.read_text(encoding="utf-8").partition(f"<!-- {name} -->")
    tail = rest.partition(f"<!-- /{name} -->")[2]
    path.write_text(f"{head}<!-- {name} -->\n{table}\n<!-- /{name} -->{tail}", encoding="utf-8")


def _split(values: str) -> list[str]:
    return values.split(",") if not any(mark in values for mark in "[{") else values.split("|")


if __name__ == "__main__":
    main()
