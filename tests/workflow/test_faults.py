"""Kills, full disks, folders that cannot be written, numbers that are not finite: a line, and nothing lost."""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import time
from pathlib import Path

import pytest
import torch
from commands import call

from frictionpinn.errors import UserError
from frictionpinn.models import FrictionModel
from frictionpinn.workflow import train as training
from frictionpinn.workflow.checkpoints import WholeFiles
from frictionpinn.workflow.manifest import write_json

ROOT = Path(__file__).resolve().parents[2]
TINY = ["trainer.threads=1", "trainer.accelerator=cpu", "data.rate_hz=100", "model.network.width=8"]
RUN = [*TINY, "model=pe2", "trainer.max_epochs=150", "trainer.checkpoint_every_n_epochs=10"]
FINAL = ("model", "parameters", "force_error", "data")


def final(folder: Path) -> dict:
    """What must not depend on interruptions."""
    result = json.loads((folder / "result.json").read_text())
    return {key: result[key] for key in FINAL} | {key: result["training"][key] for key in ("epochs", "loss")}


def killed_after(command: list[str], folder: Path, checkpoints: int) -> None:
    """SIGKILL a training some time after it has replaced its last checkpoint that often."""
    process = subprocess.Popen(command, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    last, seen = folder / "run" / "checkpoints" / "last.ckpt", set()
    end = time.monotonic() + 120
    while len(seen) < checkpoints:
        assert process.poll() is None and time.monotonic() < end
        if last.exists():
            seen.add(last.stat().st_ino)
        time.sleep(0.002)  # leaves the core to the training
    process.kill()
    process.wait()


def test_a_training_killed_twice_ends_with_the_same_numbers_to_the_last_bit(command, tmp_path):
    (tmp_path / "whole").mkdir()
    whole = command(tmp_path / "whole", *RUN, "hydra.run.dir=run")
    assert whole.returncode == 0, whole.stderr
    base = [sys.executable, str(ROOT / "train.py")]
    killed_after([*base, *RUN, "hydra.run.dir=run"], tmp_path, 3)
    killed_after([*base, "resume=run"], tmp_path, 3)
    ended = command(tmp_path, "resume=run")
    assert ended.returncode == 0, ended.stderr
    assert final(tmp_path / "run") == final(tmp_path / "whole" / "run")
    names = {path.name for path in (tmp_path / "run" / "checkpoints").iterdir()}
    assert {"best.ckpt", "last.ckpt"} <= names
    again = command(tmp_path, "resume=run")
    assert again.returncode == 2 and "error: the run has finished" in again.stderr


@pytest.mark.parametrize("optimizer", ["adam", "adam_plateau", "adam_lbfgs", "adam_onecycle"])
def test_a_run_stopped_before_its_report_ends_with_the_same_numbers(quick, monkeypatch, tmp_path, optimizer):
    """Also where early stopping had ended it."""
    options = ["model=pe1", f"optimizer={optimizer}", "trainer.checkpoint_every_n_epochs=5"]
    options += ["trainer.early_stopping={patience: 5, min_delta: 0.05}"]
    quick(tmp_path / "whole", *options, epochs=40)

    def die(*arguments):
        raise SystemExit("killed")

    with monkeypatch.context() as patch:
        patch.setattr(training, "report", die)
        with pytest.raises(SystemExit):
            quick(tmp_path / "run", *options, epochs=40)
    quick(tmp_path / "run", *options, f"ckpt_path={tmp_path}/run/checkpoints/last.ckpt", epochs=40)
    assert final(tmp_path / "run") == final(tmp_path / "whole")


@pytest.mark.parametrize("optimizer", ["adam", "adam_plateau", "adam_lbfgs", "adam_onecycle"])
def test_resuming_in_another_folder_is_exact_too(quick, monkeypatch, tmp_path, optimizer):
    options = ["model=pe2", f"optimizer={optimizer}", "trainer.checkpoint_every_n_epochs=5"]
    quick(tmp_path / "whole", *options, epochs=30)

    def die(self, trainer, pl_module, outputs, batch, batch_idx):
        if trainer.global_step == 22:
            raise SystemExit("killed")

    with monkeypatch.context() as patch:
        patch.setattr(training.Scalars, "on_train_batch_end", die)
        with pytest.raises(SystemExit):
            quick(tmp_path / "first", *options, epochs=30)
    quick(tmp_path / "second", *options, f"ckpt_path={tmp_path}/first/checkpoints/last.ckpt", epochs=30)
    assert final(tmp_path / "second") == final(tmp_path / "whole")


# ---- disks


@pytest.fixture
def small_disk(tmp_path):
    """A disk of 4 MB; where it may not be made, the test is skipped."""
    folder = tmp_path / "disk"
    folder.mkdir()
    made = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=4m", "tmpfs", folder], capture_output=True, check=False)
    if made.returncode:
        pytest.skip("making a small disk needs the right to mount one")
    yield folder
    subprocess.run(["umount", "-l", folder], check=True)


def test_a_full_disk_is_one_line_and_the_last_checkpoint_stays_whole(command, small_disk):
    first = command(small_disk, *TINY, "model=pe2", "trainer.max_epochs=10", "hydra.run.dir=good")
    assert first.returncode == 0, first.stderr
    kept = (small_disk / "good" / "checkpoints" / "last.ckpt").read_bytes()
    size = 1 << 20  # leaves room to start with
    wide = ["model=pe2", "model.network.width=256", "trainer.max_epochs=20", *TINY[:3]]
    fill = os.statvfs(small_disk).f_bavail * os.statvfs(small_disk).f_frsize - size
    (small_disk / "ballast").write_bytes(b"0" * fill)
    process = command(small_disk, *wide, "trainer.checkpoint_every_n_epochs=5", "hydra.run.dir=run")
    assert process.returncode == 2, process.stderr
    (line,) = process.stderr.splitlines()
    assert line.startswith("error: cannot write: ") and "No space left on device" in line and "resume=" in line
    for path in (small_disk / "run" / "checkpoints").glob("*.ckpt"):
        torch.load(path, weights_only=True)
    assert (small_disk / "good" / "checkpoints" / "last.ckpt").read_bytes() == kept
    (small_disk / "ballast").unlink()
    if (small_disk / "run" / "checkpoints" / "last.ckpt").exists():
        assert command(small_disk, "resume=run").returncode == 0


def test_a_sweep_on_a_full_disk_is_told_in_lines_without_a_traceback(command, small_disk):
    fill = os.statvfs(small_disk).f_bavail * os.statvfs(small_disk).f_frsize - (300 << 10)
    (small_disk / "ballast").write_bytes(b"0" * fill)
    process = command(small_disk, "-m", "seed=0,1", *TINY, "model=bb1", "trainer.max_epochs=2", "hydra.sweep.dir=s")
    assert process.returncode == 2
    lines = process.stderr.splitlines()
    assert len(lines) <= 3 and all(line.startswith("error: ") for line in lines), process.stderr
    assert "resume=" in lines[-1]


def test_what_evaluate_cannot_write_is_one_line(quick, tmp_path):
    quick(tmp_path / "run", "model=bb1")
    (tmp_path / "run" / "export").write_text("a file where the folder of the exports would be")
    process = call("evaluate.py", f"run={tmp_path}/run", "export=c")
    (line,) = process.stderr.splitlines()
    assert process.returncode == 2 and line.startswith("error: cannot write: ")


def test_a_checkpoint_that_cannot_be_written_whole_leaves_the_one_before(tmp_path):
    io, path = WholeFiles(), tmp_path / "last.ckpt"
    io.save_checkpoint({"x": torch.zeros(10)}, path)
    before = path.read_bytes()
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, limit[1]))
    try:
        with pytest.raises(OSError):
            io.save_checkpoint({"x": torch.zeros(1_000_000)}, path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limit)
    assert path.read_bytes() == before and [item.name for item in tmp_path.iterdir()] == ["last.ckpt"]


def test_a_result_that_cannot_be_written_leaves_the_one_before(tmp_path):
    path = tmp_path / "result.json"
    write_json(path, {"a": 1})
    with pytest.raises(TypeError):
        write_json(path, {"a": object()})
    assert json.loads(path.read_text()) == {"a": 1} and len(list(tmp_path.iterdir())) == 1


@pytest.mark.parametrize("mode", [[], ["-m"]], ids=["run", "sweep"])
def test_an_output_folder_that_cannot_be_written_is_one_line(command, tmp_path, mode):
    (tmp_path / "outputs").write_text("a file where the folder would be")
    process = command(tmp_path, *mode, *TINY, "model=bb1")
    assert process.returncode == 2, process.stderr
    (line,) = process.stderr.splitlines()
    assert line.startswith("error: cannot write: ") and "outputs" in line


def test_an_occupied_folder_is_not_overwritten(command, quick, tmp_path):
    quick(tmp_path / "run", "model=bb1")
    before = {path: path.read_bytes() for path in (tmp_path / "run").rglob("*") if path.is_file()}
    process = command(tmp_path, *TINY, "model=bb1", "hydra.run.dir=run")
    assert process.returncode == 2 and "error: the folder holds a finished run: hydra.run.dir is run" in process.stderr
    (tmp_path / "run" / "result.json").unlink()
    process = command(tmp_path, *TINY, "model=bb1", "hydra.run.dir=run")
    assert process.returncode == 2 and "go on with resume=run, or choose another folder" in process.stderr
    now = {path: path.read_bytes() for path in (tmp_path / "run").rglob("*") if path.is_file()}
    assert now == {path: content for path, content in before.items() if path.name != "result.json"}


# ---- numbers that are not finite


def poisoned(monkeypatch, term: str, where: str, epoch: int) -> None:
    """Make a term of the loss, or only its gradient, NaN from an epoch on."""
    sound = FrictionModel.losses

    def losses(self, batch):
        parts = sound(self, batch)
        if self.trainer.current_epoch >= epoch:
            nan = torch.tensor(float("nan"))
            spoil = parts[term] * nan if where == "loss" else Spoiled.apply(parts[term])
            parts["loss"] = parts["loss"] - parts[term] + spoil
            parts[term] = spoil
        return parts

    monkeypatch.setattr(FrictionModel, "losses", losses)


class Spoiled(torch.autograd.Function):
    """The identity, whose derivative is NaN."""

    @staticmethod
    def forward(ctx, x):
        return x.clone()

    @staticmethod
    def backward(ctx, gradient):
        return gradient * float("nan")


@pytest.mark.parametrize("where", ["loss", "gradient"])
@pytest.mark.parametrize("term", ["force", "consistency"])
@pytest.mark.parametrize("optimizer", ["adam", "adam_onecycle", "adam_lbfgs"])
def test_a_number_that_is_not_finite_stops_the_training_at_its_step(
    quick, monkeypatch, tmp_path, where, term, optimizer
):
    poisoned(monkeypatch, term, where, epoch=7)
    options = ["model=pe2", f"optimizer={optimizer}", "trainer.checkpoint_every_n_epochs=5"]
    message = rf"the {where} is not a finite number at step 8: term {term}.*; the last good checkpoint is .*last\.ckpt"
    with pytest.raises(UserError, match=message):
        quick(tmp_path, *options, epochs=20)
    saved = torch.load(tmp_path / "checkpoints" / "last.ckpt", weights_only=True)
    assert saved["global_step"] == 5
    assert all(bool(value.isfinite().all()) for value in saved["state_dict"].values())
