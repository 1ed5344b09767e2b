"""A sweep that is killed three times with SIGKILL and resumed, against the same sweep undisturbed.

    python benchmarks/sweep.py                     24 runs of 300 epochs, a few minutes
    python benchmarks/sweep.py --epochs 1500 --rate 400

Compares summary.csv and groups.csv byte for byte. Writes benchmarks/results/sweep.txt and sweep.png.
"""

from __future__ import annotations

import argparse
import random
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
TRAIN = [sys.executable, str(ROOT / "train.py")]
SWEPT = ["model=bb1,bb2,pe1,pe2", "noise=none,gaussian", "seed=0,1,2"]


def finished(folder: Path) -> int:
    """Jobs of a sweep that have a result."""
    return len(list(folder.glob("*/result.json")))


def killed(command: list[str], place: Path, folder: Path, until: int, delay: float) -> str:
    """Start a sweep and kill it ``delay`` s after ``until`` jobs have finished; return what it had said."""
    log = place / "sweep.log"
    with log.open("w") as out:
        process = subprocess.Popen(command, cwd=place, stdout=out, stderr=subprocess.STDOUT)
        while finished(folder) < until:
            if process.poll() is not None:
                raise SystemExit(f"the sweep ended before it could be killed:\n{log.read_text()}")
            time.sleep(0.01)
        time.sleep(delay)
        process.kill()
        process.wait()
    return log.read_text()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--epochs", type=int, default=300)
    parser.add_argument("--rate", type=int, default=100, help="sampling rate of the simulated data, Hz")
    parser.add_argument("--seed", type=int, default=0, help="of the moments of the kills")
    arguments = parser.parse_args()
    options = [f"trainer.max_epochs={arguments.epochs}", f"data.rate_hz={arguments.rate}", "trainer.threads=1"]
    options += [f"trainer.checkpoint_every_n_epochs={max(arguments.epochs // 15, 1)}", "trainer.accelerator=cpu"]
    chance, lines = random.Random(arguments.seed), []
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as name:
        place = Path(name)
        sweep = [*TRAIN, "-m", *SWEPT, *options]
        begin = time.perf_counter()
        subprocess.run([*sweep, "hydra.sweep.dir=whole"], cwd=place, check=True, stdout=subprocess.DEVNULL)
        lines.append(f"undisturbed: {finished(place / 'whole')} runs in {time.perf_counter() - begin:.0f} s")
        begin = time.perf_counter()
        for k, command in enumerate(([*sweep, "hydra.sweep.dir=hurt"], *[[*TRAIN, "resume=hurt"]] * 2)):
            until, delay = 3 + 7 * k, chance.uniform(0.0, 3.0)
            killed(command, place, place / "hurt", until, delay)
            done = finished(place / "hurt")
            lines.append(f"killed {delay:.2f} s after the run number {until} had finished: {done} results")
        told = subprocess.run([*TRAIN, "resume=hurt"], cwd=place, check=True, capture_output=True, text=True).stdout
        lines += [line for line in told.splitlines() if line.startswith(("finished before", "going on"))]
        lines.append(f"resumed: {finished(place / 'hurt')} runs, {time.perf_counter() - begin:.0f} s with all kills")
        for file in ("summary.csv", "groups.csv"):
            same = (place / "whole" / file).read_bytes() == (place / "hurt" / file).read_bytes()
            lines.append(f"{file}: {'identical, byte for byte' if same else 'DIFFERENT'}")
        results = ROOT / "benchmarks" / "results"
        shutil.copy(place / "hurt" / "summary.png", results / "sweep.png")
    head = f"{' '.join(SWEPT)}, {arguments.epochs} epochs, {arguments.rate} Hz, one thread"
    text = "\n".join([head, *lines]) + "\n"
    (results / "sweep.txt").write_text(text)
    print(text, end="")
    sys.exit("DIFFERENT" in text)


if __name__ == "__main__":
    main()
