"""``python train.py`` in its own process, as a user calls it."""

from __future__ import annotations

import json

import numpy as np
import pytest
import torch

QUICK = ["trainer.max_epochs=3", "trainer.threads=1", "trainer.accelerator=cpu"]


@pytest.fixture(scope="module")
def finished(command, tmp_path_factory):
    """The main job, short, in an empty folder."""
    folder = tmp_path_factory.mktemp("user")
    return folder, command(folder, "model=pe2", "system=pob", *QUICK)


def test_the_main_job_writes_its_run_under_outputs_and_says_where(finished):
    folder, process = finished
    assert process.returncode == 0, process.stderr
    (run,) = (folder / "outputs" / "pob" / "pe2").iterdir()
    assert {"result.json", "checkpoints", "figures", "tensorboard", "train.log", ".hydra"} == {
        item.name for item in run.iterdir()
    }
    assert {item.name for item in (run / "checkpoints").iterdir()} == {"best.ckpt", "last.ckpt"}
    lines = [line for line in process.stdout.splitlines() if not line.startswith("compiling")]  # once on a machine
    assert "4000 samples of 5 trials; held out: 6" in lines[0]
    assert str(run.relative_to(folder)) in lines[-2] and lines[-2].startswith("3 epochs in")
    assert lines[-1] == f"next: python evaluate.py run={run.relative_to(folder)}"
    table = json.loads((run / "result.json").read_text())["parameters"]
    row = next(line.split() for line in lines if line.startswith("mu_c"))
    assert float(row[1]) == pytest.approx(table["mu_c"]["value"], rel=1e-3) and row[-1] == "0.3"


def test_the_main_job_prints_no_warnings(finished):
    assert "Warning" not in finished[1].stderr and "Traceback" not in finished[1].stderr


def test_a_sweep_trains_every_job_and_a_bad_one_does_not_stop_the_others(command, tmp_path):
    process = command(tmp_path, "-m", "model=bb1,pe1", "friction=coulomb", *QUICK, "data.rate_hz=100")
    assert process.returncode == 2
    assert process.stderr.count("error: ") == 1 and "needs a friction law with a bristle state" in process.stderr
    assert "Traceback" not in process.stderr
    assert len(list(tmp_path.glob("outputs/sweeps/*/*/result.json"))) == 1


@pytest.mark.parametrize(
    ("case", "overrides"),
    [
        ("did you mean 'pe2'", ["model=pe22"]),
        ("unreadable checkpoint", ["ckpt_path=cut.ckpt", "data.rate_hz=100"]),
    ],
)
def test_a_mistake_ends_with_one_line_and_exit_code_2(command, tmp_path, case, overrides):
    (tmp_path / "cut.ckpt").write_bytes(b"PK\x03\x04 torn")
    process = command(tmp_path, *overrides, *QUICK)
    assert process.returncode == 2
    (line,) = process.stderr.splitlines()
    assert line.startswith("error: ") and case in line and "allowed: " in line
    assert not list(tmp_path.glob("outputs/*/*/*/result.json"))


def test_hydra_full_error_shows_the_traceback(command, tmp_path):
    process = command(tmp_path, "system.parameters.m_b=-0.5", *QUICK, HYDRA_FULL_ERROR="1")
    assert process.returncode not in (0, 2) and "Traceback (most recent call last)" in process.stderr
    assert "system.parameters.m_b is -0.5 kg" in process.stderr


def test_help_is_shown(command, tmp_path):
    process = command(tmp_path, "--help")
    assert process.returncode == 0 and "pob" in process.stdout and not (tmp_path / "outputs").exists()


def test_a_csv_in_millimetres_and_degrees_with_its_own_columns_trains(command, csv, tmp_path, measured_table):
    def relabel(table):
        for name in ("x", "v", "a"):
            table[name] *= 1e3
        for name in ("theta", "omega", "alpha"):
            table[name] = np.rad2deg(table[name])
        return table.rename(columns={"t": "time", "x": "box position (mm)", "theta": "angle"})

    csv(relabel)
    units = "data.units={t: s, x: mm, v: mm/s, a: 'mm/s^2', theta: deg, omega: deg/s, alpha: 'deg/s^2'}"
    columns = "data.columns={t: time, x: 'box position (mm)', v: v, a: a, theta: angle, omega: omega, alpha: alpha}"
    process = command(tmp_path, "data=csv", "data.path=run.csv", "system=pob", units, columns, *QUICK)
    assert process.returncode == 0, process.stderr
    (path,) = tmp_path.glob("outputs/pob/pe2/*/result.json")
    result = json.loads(path.read_text())
    assert result["data"]["trials"] == {"train": ["1"], "validation": [], "held_out": ["2"]}
    assert result["data"]["samples"]["train"] == int((measured_table.trial == 1).sum())
    for key in ("model", "coulomb_viscous"):
        assert result["force_error"][key]["reference"] == "friction force implied by the equation of motion"
        assert 1.0 < result["force_error"][key]["reference_rms"] < 20.0  # N: the units were understood
    assert "truth" not in result["parameters"]["mu_c"]
    torch.load(path.parent / "checkpoints" / "best.ckpt", weights_only=True)
