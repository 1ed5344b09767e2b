"""Trainings killed with SIGKILL at random moments and resumed, against one that was not disturbed.

    python benchmarks/faults.py                    10 kills, 300 epochs
    python benchmarks/faults.py --epochs 1500 --rate 400

Compares parameters, force errors and losses bit for bit, and counts the epochs that a kill costs.
Writes benchmarks/results/faults.txt.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
TRAIN = [sys.executable, str(ROOT / "train.py")]


def count_epochs(arguments: list[str]) -> None:
    """train.py, which also keeps its epoch in the file ``epoch``: what the last checkpoint lacks is counted by it."""
    import runpy

    from frictionpinn.workflow import callbacks

    count, scalars = os.open("epoch", os.O_CREAT | os.O_WRONLY), callbacks.Scalars

    class Counting(scalars):  # type: ignore[misc, valid-type]
        def on_train_batch_end(self, trainer, *rest) -> None:
            super().on_train_batch_end(trainer, *rest)
            os.pwrite(count, f"{trainer.current_epoch:8d}".encode(), 0)

    callbacks.Scalars = Counting  # type: ignore[misc]
    sys.argv = [str(ROOT / "train.py"), *arguments]
    runpy.run_path(sys.argv[0], run_name="__main__")


def final(folder: Path) -> str:
    """What must not depend on interruptions, every bit of it."""
    result = json.loads((folder / "result.json").read_text())
    kept = {key: result[key] for key in ("parameters", "force_error", "data")}
    return json.dumps(kept | {key: result["training"][key] for key in ("epochs", "loss")}, sort_keys=True)


def kill(place: Path, options: list[str], epoch: int, wait: float) -> tuple[int, int]:
    """Kill a training ``wait`` s after an epoch has begun; return its epochs and those of its last checkpoint."""
    import torch

    place.mkdir()
    command = [sys.executable, str(Path(__file__).resolve()), "--child", *options, "hydra.run.dir=run"]
    process = subprocess.Popen(command, cwd=place, stdout=subprocess.DEVNULL)
    count = place / "epoch"
    while process.poll() is None and not (count.exists() and int(count.read_text().strip() or -1) >= epoch):
        time.sleep(0.002)
    time.sleep(wait)
    process.kill()
    process.wait()
    last = place / "run" / "checkpoints" / "last.ckpt"
    saved = torch.load(last, weights_only=True)["epoch"] + 1 if last.exists() else 0
    return int((place / "epoch").read_text()) + 1, saved


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=10)
    parser.add_argument("--epochs", type=int, default=300)
    parser.add_argument("--rate", type=int, default=100, help="sampling rate of the simulated data, Hz")
    parser.add_argument("--seed", type=int, default=0, help="of the moments of the kills")
    arguments = parser.parse_args()
    every = max(arguments.epochs // 15, 1)
    options = ["model=pe2", f"trainer.max_epochs={arguments.epochs}", f"data.rate_hz={arguments.rate}"]
    options += ["trainer.threads=1", "trainer.accelerator=cpu", f"trainer.checkpoint_every_n_epochs={every}"]
    chance, lines, same, late = random.Random(arguments.seed), [], 0, 0
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as name:
        place = Path(name)
        subprocess.run([*TRAIN, *options, "hydra.run.dir=whole"], cwd=place, check=True, stdout=subprocess.DEVNULL)
        seconds = json.loads((place / "whole" / "result.json").read_text())["training"]["seconds"]["training"]
        for k in range(arguments.kills):
            folder = place / str(k)
            moment = chance.uniform(0.0, 0.9) * arguments.epochs, chance.uniform(0.0, 1.0) * seconds / arguments.epochs
            reached, saved = kill(folder, options, int(moment[0]), moment[1])
            if (folder / "run" / "result.json").exists():
                raise SystemExit("a training ended before it could be killed: take more epochs")
            subprocess.run([*TRAIN, "resume=run"], cwd=folder, check=True, stdout=subprocess.DEVNULL)
            identical = final(folder / "run") == final(place / "whole")
            same, late = same + identical, max(late, reached - saved)
            told = "identical" if identical else "DIFFERENT"
            lines.append(f"killed in epoch {reached:4d}, last checkpoint after {saved:4d}: resumed, {told}")
    head = f"{' '.join(options[:3])}, checkpoint every {every} epochs; undisturbed training {seconds:.1f} s"
    end = f"{same} of {arguments.kills} identical to the last bit; at most {late} epochs lost (interval: {every})"
    text = "\n".join([head, *lines, end]) + "\n"
    (ROOT / "benchmarks" / "results" / "faults.txt").write_text(text)
    print(text, end="")
    sys.exit(same != arguments.kills or late > every)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--child"]:
        count_epochs(sys.argv[2:])
    else:
        main()
