"""Sweeps in processes of their own, for tests that kill them."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
TINY = ["trainer.threads=1", "trainer.accelerator=cpu", "data.rate_hz=100", "model.network.width=8"]
LONG = [*TINY, "trainer.max_epochs=150", "trainer.checkpoint_every_n_epochs=5", "trainer.early_stopping=null"]
SWEEP = ["-m", "model=bb1", "seed=0,1,2", *LONG]


def start(folder: Path, *arguments: str) -> subprocess.Popen:
    return subprocess.Popen(
        [sys.executable, str(ROOT / "train.py"), *arguments],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def wait_for(condition, process: subprocess.Popen, seconds: float = 300.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < end
        time.sleep(0.02)


def running(folder: Path) -> int | None:
    """Process that trains in a job's folder and has written a checkpoint."""
    if not list(folder.glob("checkpoints/last.ckpt")):
        return None
    try:
        return json.loads((folder / "status.json").read_text()).get("process")
    except (OSError, ValueError):
        return None
