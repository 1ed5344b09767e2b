"""Time per network of an ensemble trained as one program, against that many separate runs of train.py.

    python benchmarks/ensemble.py [--sizes 1 4 16 64] [--epochs 50] [--whole] [--cases default width] [--threads 1 2]

Every training is a process of its own, as a user starts it; "separate" is a run of one network, the median of three,
with as many torch threads as the ensemble. A training costs a fixed part (start of Python, data, smoothing, figures:
that of one epoch) and a part per epoch: both are measured, with 1 and with 1 + EPOCHS epochs, and added up for the
default number of epochs. --whole times trainings of the default length instead and compares what they reach. CPU time
is the process's own; wall time asks for a quiet machine. On a GPU: --accelerator gpu. Rows of other cases in
benchmarks/results/ensemble.txt stay (ensemble_whole.txt with --whole).
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import torch
from omegaconf import OmegaConf

ROOT = Path(__file__).resolve().parents[1]
CASES = {
    "bb1, default": ("model=bb1",),
    "pe2, default": ("model=pe2",),
    "bb1, width 16, 100 Hz": ("model=bb1", "model.network.width=16", "data.rate_hz=100"),
    "pe2, width 16, 100 Hz": ("model=pe2", "model.network.width=16", "data.rate_hz=100"),
}
DEFAULT = int(OmegaConf.load(ROOT / "conf" / "trainer" / "default.yaml").max_epochs)


def training(options: tuple[str, ...], size: int, epochs: int, threads: int, accelerator: str) -> tuple[float, ...]:
    """Wall and CPU seconds of one process of train.py, and the force error that it reached, N^2."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, str(ROOT / "train.py"), *options, f"ensemble={size}", f"hydra.run.dir={folder}/run"]
        command += [f"trainer.max_epochs={epochs}", f"trainer.threads={threads}", f"trainer.accelerator={accelerator}"]
        command += ["trainer.early_stopping=null", "trainer.progress_bar=false"]
        before, start = os.times(), time.perf_counter()
        subprocess.run(command, check=True, capture_output=True, env=os.environ | {"OMP_NUM_THREADS": str(threads)})
        wall, after = time.perf_counter() - start, os.times()
        cpu = after.children_user + after.children_system - before.children_user - before.children_system
        result = json.loads(Path(folder, "run", "result.json").read_text())
        return wall, cpu, result["force_error"]["model"]["mse"]


def seconds(options: tuple[str, ...], size: int, threads: int, given: argparse.Namespace) -> dict[str, list[float]]:
    """Wall and CPU seconds, and the error, of the fixed part, of an epoch, and of the default training."""
    repeats = 3 if size == 1 else 1

    def median(epochs: int) -> list[float]:
        runs = [training(options, size, epochs, threads, given.accelerator) for _ in range(repeats)]
        return [statistics.median(column) for column in zip(*runs, strict=True)]

    fixed, long = median(1), median(DEFAULT if given.whole else 1 + given.epochs)
    count = DEFAULT - 1 if given.whole else given.epochs
    epoch = [(b - a) / count for a, b in zip(fixed, long, strict=True)]
    total = [a + (DEFAULT - 1) * b for a, b in zip(fixed, epoch, strict=True)]
    return {"fixed": fixed, "epoch": epoch, "total": total}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sizes", type=int, nargs="+", default=[1, 4, 16, 64])
    parser.add_argument("--epochs", type=int, default=50)
    parser.add_argument("--cases", nargs="+", default=["default", "width"], help="parts of the names of cases")
    parser.add_argument("--threads", type=int, nargs="+", default=sorted({1, os.cpu_count() or 1}))
    parser.add_argument("--accelerator", default="cpu")
    parser.add_argument("--whole", action="store_true")
    given = parser.parse_args()
    path = ROOT / "benchmarks" / "results" / ("ensemble_whole.txt" if given.whole else "ensemble.txt")
    how = f"trainings of {DEFAULT} epochs, " + ("timed whole" if given.whole else "added up from fixed part and epochs")
    device = torch.cuda.get_device_name() if given.accelerator == "gpu" else f"CPU, {os.cpu_count()} cores"
    head = [
        f"Ensembles against separate runs: {how}",
        f"{device}; Python {platform.python_version()}, torch {torch.__version__}; one of N separate runs counts 1",
        "",
        f"{'case':24s}{'threads':>8s}{'N':>4s}{'fixed, s':>10s}{'epoch and member, ms':>22s}"
        f"{'s per network':>15s}{'of separate: wall':>19s}{'CPU':>7s}" + "   force error, N^2" * given.whole,
    ]
    rows = {line[:36]: line for line in path.read_text().splitlines()[len(head) :]} if path.is_file() else {}
    for name, options in CASES.items():
        if not any(part in name for part in given.cases):
            continue
        for threads in given.threads:
            alone = seconds(options, 1, threads, given)
            for size in given.sizes:
                found = alone if size == 1 else seconds(options, size, threads, given)
                wall, cpu = (found["total"][k] / size / alone["total"][k] for k in (0, 1))
                key = f"{name:24s}{threads:8d}{size:4d}"
                rows[key] = (
                    f"{key}{found['fixed'][0]:10.1f}{1e3 * found['epoch'][0] / size:22.2f}"
                    f"{found['total'][0] / size:15.1f}{wall:19.2f}{cpu:7.2f}"
                ) + f"{found['total'][2]:19.3f}" * given.whole
                print(rows[key], flush=True)
                path.write_text("\n".join([*head, *(rows[key] for key in sorted(rows))]) + "\n")


if __name__ == "__main__":
    main()
