"""Ctrl-C: a line, no traceback; a training keeps what it has and goes on from there as if it had not been stopped."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path

import pytest
import torch

from frictionpinn.errors import Interrupted
from frictionpinn.workflow.callbacks import Scalars

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def stopped(quick, tmp_path, monkeypatch) -> Path:
    """The folder of a training of 30 epochs in which the user pressed Ctrl-C in epoch 14, long before a checkpoint."""
    write = Scalars.on_train_batch_end

    def press(self, trainer, *arguments):
        if trainer.current_epoch == 13:
            signal.raise_signal(signal.SIGINT)
        write(self, trainer, *arguments)

    with monkeypatch.context() as patch:
        patch.setattr(Scalars, "on_train_batch_end", press)
        with pytest.raises(Interrupted, match=r"stopped after epoch 14 of 30; go on with: .*train resume=.*first"):
            quick(tmp_path / "first", "model=pe1", epochs=30)
    return tmp_path / "first"


def hearing() -> None:
    """Take Ctrl-C, which a suite that runs in the background leaves its programs deaf to."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


def test_a_stopped_training_goes_on_to_the_same_end_and_counts_all_its_seconds(quick, stopped, tmp_path):
    last = stopped / "checkpoints" / "last.ckpt"
    content = torch.load(last, weights_only=False)
    (told,) = (state for state in content["callbacks"].values() if "seconds" in state)
    assert told["seconds"] > 0
    told["seconds"] = 1000.0
    torch.save(content, last)
    resumed = quick(stopped, "model=pe1", f"ckpt_path={last}", epochs=30)
    whole = quick(tmp_path / "whole", "model=pe1", epochs=30)
    assert resumed["parameters"] == whole["parameters"] and resumed["force_error"] == whole["force_error"]
    assert resumed["training"]["seconds"]["training"] > 1000 > whole["training"]["seconds"]["training"]


def test_after_a_training_the_next_ctrl_c_is_an_ordinary_one(quick, tmp_path):
    before = signal.getsignal(signal.SIGINT)
    quick(tmp_path / "run", "model=bb1", epochs=1)
    assert signal.getsignal(signal.SIGINT) is before


@pytest.mark.parametrize(
    ("script", "line", "options"),
    [
        ("identify.py", "seed 0, least_squares", ["methods=[least_squares,nelder_mead]", "system=drive"]),
        ("diagnose.py", "diagnosing", ["data=simulated", "system=drive", "friction=coulomb"]),
    ],
)
def test_ctrl_c_in_the_middle_of_a_search_ends_with_one_line_and_leaves_no_folder(tmp_path, script, line, options):
    process = subprocess.Popen(
        [sys.executable, str(ROOT / script), "data.rate_hz=100", *options],
        cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, preexec_fn=hearing,
    )  # fmt: skip
    assert process.stdout is not None
    assert any(line in said for said in iter(process.stdout.readline, ""))
    process.send_signal(signal.SIGINT)
    told, errors = process.communicate(timeout=120)
    assert process.returncode == 130 and "stopped; nothing was kept" in told
    assert "Traceback" not in errors and not (tmp_path / "outputs").exists()


def test_a_sweep_that_is_stopped_says_how_to_go_on(tmp_path):
    options = ["-m", "seed=0,1", "model=bb1", "data.rate_hz=100", "trainer.max_epochs=100000", "trainer.threads=1"]
    process = subprocess.Popen(
        [sys.executable, str(ROOT / "train.py"), *options],
        cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, preexec_fn=hearing,
    )  # fmt: skip
    assert process.stdout is not None
    assert "2 jobs" in process.stdout.readline()
    process.send_signal(signal.SIGINT)
    told, errors = process.communicate(timeout=120)
    (folder,) = (tmp_path / "outputs" / "sweeps").iterdir()
    assert process.returncode == 130 and f"go on with: python train.py resume={folder.relative_to(tmp_path)}" in told
    assert "Traceback" not in errors and len(json.loads((folder / "manifest.json").read_text())["jobs"]) == 2
