"""The same sweep through each launcher, two jobs at a time, on this machine: run it where nothing else computes.

    python benchmarks/launchers.py                 8 runs of 400 epochs, some minutes
    python benchmarks/launchers.py --epochs 100

Launchers whose package is missing are named and left out. Writes benchmarks/results/launchers.txt.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from importlib.util import find_spec
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
LAUNCHERS = {
    "basic": ([], None),
    "joblib": (["hydra.launcher.n_jobs=2"], "hydra_plugins.hydra_joblib_launcher"),
    "ray": (["hydra.launcher.init.num_cpus=2"], "ray"),
    "slurm": (["hydra.launcher.cluster=local"], "submitit"),
}


def timed(name: str, options: list[str], place: Path) -> tuple[float, bytes]:
    """Seconds of the whole command, and its summary."""
    command = [sys.executable, str(ROOT / "train.py"), "-m", f"hydra/launcher={name}", *options]
    begin = time.perf_counter()
    subprocess.run([*command, f"hydra.sweep.dir={name}"], cwd=place, check=True, stdout=subprocess.DEVNULL)
    return time.perf_counter() - begin, (place / name / "summary.csv").read_bytes()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--epochs", type=int, default=400)
    parser.add_argument("--seeds", type=int, default=8)
    arguments = parser.parse_args()
    sweep = ["model=pe2", f"seed=range(0,{arguments.seeds})", f"trainer.max_epochs={arguments.epochs}"]
    sweep += ["trainer.threads=1", "trainer.accelerator=cpu", "trainer.early_stopping=null"]
    lines, reference, base = [], b"", 0.0
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as name:
        subprocess.run(  # the equations are compiled before anything is timed
            [sys.executable, str(ROOT / "train.py"), "trainer.max_epochs=1", "hydra.run.dir=warm"],
            cwd=name, check=True, stdout=subprocess.DEVNULL,
        )  # fmt: skip
        for launcher, (options, package) in LAUNCHERS.items():
            if package and find_spec(package) is None:
                lines.append(f"{launcher:<8} not installed")
                continue
            seconds, summary = timed(launcher, [*options, *sweep], Path(name))
            base, reference = base or seconds, reference or summary
            same = "same summary" if summary == reference else "ANOTHER SUMMARY"
            # submitit's local executor starts all jobs at once
            lines.append(f"{launcher:<8} {seconds:7.1f} s   {base / seconds:5.2f} times as fast as basic   {same}")
            print(lines[-1], flush=True)
    head = f"{arguments.seeds} runs of pe2, {arguments.epochs} epochs, one thread each, {os.cpu_count()} cores"
    text = "\n".join([head, *lines]) + "\n"
    (ROOT / "benchmarks" / "results" / "launchers.txt").write_text(text)


if __name__ == "__main__":
    main()
