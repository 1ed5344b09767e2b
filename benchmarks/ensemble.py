"""Time per network of an ensemble trained as one program, against that many separate runs of train.py.

    python benchmarks/ensemble.py [--sizes 1 4 16 64] [--epochs 100] [--whole] [--cases default width]

Every training is a process of its own, as a user starts it, with one torch thread; "separate" is a run of one network,
the median of three. A training costs a fixed part (start of Python, data, smoothing, figures: that of one epoch) and a
part per epoch: both are measured, with 1 and with 1 + EPOCHS epochs, and added up for the default number of epochs.
--whole times trainings of the default length instead. CPU time is the process's own, so it holds on a busy machine too;
wall time asks for a quiet one. On a GPU: --accelerator gpu. Writes benchmarks/results/ensemble.txt.
"""

from __future__ import annotations

import argparse
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


def training(options: tuple[str, ...], size: int, epochs: int, accelerator: str) -> tuple[float, float]:
    """Wall and CPU seconds of one process of train.py."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, str(ROOT / "train.py"), *options, f"ensemble={size}", f"hydra.run.dir={folder}/run"]
        command += [f"trainer.max_epochs={epochs}", "trainer.threads=1", f"trainer.accelerator={accelerator}"]
        command += ["trainer.early_stopping=null", "trainer.progress_bar=false"]
        before, start = os.times(), time.perf_counter()
        subprocess.run(command, check=True, capture_output=True, env=os.environ | {"OMP_NUM_THREADS": "1"})
        after = os.times()
        cpu = after.children_user + after.children_system - before.children_user - before.children_system
        return time.perf_counter() - start, cpu


def seconds(options: tuple[str, ...], size: int, given: argparse.Namespace) -> dict[str, tuple[float, float]]:
    """(wall, CPU) seconds of the fixed part, of an epoch, and of the default training."""
    repeats = 3 if size == 1 else 1

    def median(epochs: int) -> list[float]:
        runs = [training(options, size, epochs, given.accelerator) for _ in range(repeats)]
        return [statistics.median(column) for column in zip(*runs, strict=True)]

    fixed, long = median(1), median(DEFAULT if given.whole else 1 + given.epochs)
    count = DEFAULT - 1 if given.whole else given.epochs
    epoch = [(b - a) / count for a, b in zip(fixed, long, strict=True)]
    total = [a + (DEFAULT - 1) * b for a, b in zip(fixed, epoch, strict=True)]
    return {name: tuple(values) for name, values in (("fixed", fixed), ("epoch", epoch), ("total", total))}  # type: ignore


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sizes", type=int, nargs="+", default=[1, 4, 16, 64])
    parser.add_argument("--epochs", type=int, default=100)
    parser.add_argument("--cases", nargs="+", default=["default", "width"], help="parts of the names of cases")
    parser.add_argument("--accelerator", default="cpu")
    parser.add_argument("--whole", action="store_true")
    given = parser.parse_args()
    how = f"trainings of {DEFAULT} epochs, " + ("timed whole" if given.whole else "added up from fixed part and epochs")
    device = torch.cuda.get_device_name() if given.accelerator == "gpu" else f"CPU, {os.cpu_count()} cores, one thread"
    lines = [
        f"Ensembles against separate runs: {how}",
        f"{device}; Python {platform.python_version()}, torch {torch.__version__}; one of N separate runs counts 1",
        "",
        f"{'case':24s}{'N':>4s}{'fixed, CPU s':>14s}{'epoch and member, CPU ms':>26s}"
        f"{'CPU s per network':>20s}{'of separate':>13s}{'wall':>8s}",
    ]
    for name, options in CASES.items():
        if not any(part in name for part in given.cases):
            continue
        alone = seconds(options, 1, given)
        for size in given.sizes:
            found = alone if size == 1 else seconds(options, size, given)
            wall, cpu = (t / size / a for t, a in zip(found["total"], alone["total"], strict=True))
            lines.append(
                f"{name:24s}{size:4d}{found['fixed'][1]:14.1f}{1e3 * found['epoch'][1] / size:26.2f}"
                f"{found['total'][1] / size:20.1f}{cpu:13.2f}{wall:8.2f}"
            )
            print(lines[-1], flush=True)
    text = "\n".join(lines) + "\n"
    print(text)
    (ROOT / "benchmarks" / "results" / "ensemble.txt").write_text(text)


if __name__ == "__main__":
    main()
