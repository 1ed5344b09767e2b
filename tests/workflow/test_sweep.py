"""Sweeps: summary, going on after a stop, jobs that die, folders that are never overwritten."""

from __future__ import annotations

import csv
import json
import os
import signal
import time
from dataclasses import replace
from pathlib import Path

import pytest
from omegaconf import OmegaConf
from sweeping import SWEEP, running, start, wait_for

from frictionpinn.errors import UserError
from frictionpinn.workflow import job
from frictionpinn.workflow.manifest import (
    Job,
    digest,
    read_manifest,
    result_of,
    set_status,
    write_json,
    write_manifest,
)
from frictionpinn.workflow.resume import resumed
from frictionpinn.workflow.summary import groups, summarise_sweep
from frictionpinn.workflow.summary_figure import summary_figure
from frictionpinn.workflow.sweep import Sweep, of_all_commands


def test_a_sweep_with_killed_jobs_that_was_killed_itself_ends_like_one_never_disturbed(tmp_path):
    whole = start(tmp_path, *SWEEP, "hydra.sweep.dir=whole")
    out, err = whole.communicate(timeout=240)
    assert whole.returncode == 0 and "3 of 3 jobs finished" in out and err == "", err
    process = start(tmp_path, *SWEEP, "hydra.sweep.dir=s")
    jobs = [tmp_path / "s" / f"{k}_pob_bb1_seed{k}" for k in range(3)]
    wait_for(lambda: running(jobs[1]), process)
    os.kill(running(jobs[1]), signal.SIGKILL)
    wait_for(lambda: running(jobs[2]), process)  # the others go on
    last = running(jobs[2])
    process.kill()
    process.wait()  # what it said is read later: that would wait for a job that outlived it
    end = time.monotonic() + 10
    while Path(f"/proc/{last}").exists() and "Z" not in Path(f"/proc/{last}/stat").read_text().split()[2]:
        assert time.monotonic() < end, "a job outlived its sweep"
        time.sleep(0.02)
    err = process.stderr.read()
    assert err.count("error: ") == 1 and "[2/3] seed=1: its process died: SIGKILL" in err
    again = start(tmp_path, "resume=s")
    out, err = again.communicate(timeout=240)
    assert again.returncode == 0 and err == ""
    assert "finished before and skipped: 0_pob_bb1_seed0" in out
    assert "going on from their last checkpoint: 1_pob_bb1_seed1, 2_pob_bb1_seed2" in out
    for name in ("summary.csv", "groups.csv"):
        assert (tmp_path / "s" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()


def test_further_values_in_the_folder_of_a_sweep_get_folders_of_their_own(tmp_path):
    few = (*SWEEP, "trainer.max_epochs=2", "hydra.sweep.dir=s")
    start(tmp_path, *few, "seed=0,1").communicate(timeout=120)
    before = {path: path.read_bytes() for path in tmp_path.glob("s/*/result.json")}
    out, err = start(tmp_path, *few, "seed=2,0").communicate(timeout=120)
    assert "finished before and skipped: 0_pob_bb1_seed0" in out, err
    assert (tmp_path / "s" / "2_pob_bb1_seed2" / "result.json").is_file()
    assert len(before) == 2 and all(path.read_bytes() == content for path, content in before.items())
    assert [job.number for job in read_manifest(tmp_path / "s")["jobs"]] == [0, 1, 2]
    assert [row["seed"] for row in csv.DictReader((tmp_path / "s" / "summary.csv").open())] == ["0", "1", "2"]


# ---- the parts, without training


def result(model: str, seed: int, rmse: float, mu_c: float | None = None) -> dict:
    force = {"rmse": rmse, "relative": rmse / 10}
    return {
        "system": "pob",
        "model": model,
        "parameters": {"mu_c": {"value": mu_c, "truth": 0.3}} if mu_c else {},
        "force_error": {"unit": {"rmse": "N"}, "model": force, "coulomb_viscous": {"rmse": 2.0, "relative": 0.2}},
        "training": {"seed": seed, "epochs": 5, "loss": {"loss": 0.5}},
        "config": {"model": model, "seed": seed, "trainer": {}},
    }


def planned(folder: Path, entries: list[dict]) -> list[Job]:
    jobs = []
    for k, entry in enumerate(entries):
        swept = {"model": entry["model"], "seed": str(entry["training"]["seed"])}
        jobs.append(Job(k, f"{k}_job", digest(entry["config"]), swept, []))
        (folder / f"{k}_job").mkdir()
        write_json(folder / f"{k}_job" / "result.json", entry)
    return jobs


def test_the_summary_has_a_row_for_each_job_and_mean_and_spread_for_each_group(tmp_path, capsys):
    entries = [result("bb1", 0, 1.0), result("bb1", 1, 2.0), result("pe1", 0, 0.5, 0.33), result("pe1", 1, 0.7, 0.27)]
    jobs = planned(tmp_path, entries)
    (tmp_path / "3_job" / "result.json").unlink()
    set_status(tmp_path / "3_job", "failed", error="no such file")
    summarise_sweep(tmp_path, jobs, "here")
    rows = list(csv.DictReader((tmp_path / "summary.csv").open()))
    assert [row["state"] for row in rows] == ["finished"] * 3 + ["failed"]
    assert rows[3]["error"] == "no such file" and float(rows[2]["mu_c_off"]) == pytest.approx(0.1)
    first, second = csv.DictReader((tmp_path / "groups.csv").open())
    assert float(first["force_rmse_mean"]) == 1.5 and float(first["force_rmse_std"]) == pytest.approx(0.5**0.5)
    assert second["runs"] == "1" and second["jobs"] == "2"
    out = capsys.readouterr().out
    assert "1.5 ± 0.71 N" in out and "3 of 4 jobs finished" in out and "1 of 2" in out
    assert (tmp_path / "summary.png").read_bytes().startswith(b"\x89PNG")


def test_the_time_that_is_left_is_told_from_all_jobs_done_so_far(tmp_path, monkeypatch):
    jobs = planned(tmp_path, [result("bb1", seed, 1.0) for seed in range(4)])
    write_manifest(tmp_path, "train", [], [], jobs)
    results = {name: (tmp_path / name / "result.json").read_bytes() for name in (own.folder for own in jobs)}
    for name in results:
        (tmp_path / name / "result.json").unlink()
    clock = iter([0.0, 100.0, 100.0, 120.0])  # the first job takes 100 s, the second 20 s

    class Finishing:
        def run(self, cfg, folder, command):
            (folder / "result.json").write_bytes(results[folder.name])

    monkeypatch.setattr(job, "_worker_for", lambda environment: Finishing())
    monkeypatch.setattr(job.time, "perf_counter", lambda: next(clock))
    told = [job.settled({}, tmp_path / own.folder, "train").line for own in jobs[:2]]
    assert told[0].endswith("100.0 s, about 5 min left") and told[1].endswith("20.0 s, about 2 min left")


def test_jobs_of_several_commands_have_every_option_that_one_of_these_varied(tmp_path, capsys):
    jobs = planned(tmp_path, [result("bb1", 0, 1.0), result("pe1", 1, 2.0), result("bb1", 2, 3.0)])
    jobs = [replace(jobs[0], swept={"seed": "0"}, overrides=["model=bb1", "seed=0"]),
            replace(jobs[1], swept={"model": "pe1"}, overrides=["model=pe1"]),
            replace(jobs[2], swept={"+noise": "gaussian"}, overrides=["+noise=gaussian"])]  # fmt: skip
    every = of_all_commands(jobs)
    assert [job.swept["model"] for job in every] == ["bb1", "pe1", "default"]
    assert [job.swept.get("seed") for job in every] == ["0", None, None]
    summarise_sweep(tmp_path, every, "here")
    assert [row["seed"] for row in csv.DictReader((tmp_path / "summary.csv").open())] == ["0", "1", "2"]
    assert "3 of 3 jobs finished" in capsys.readouterr().out


def test_the_summary_tells_the_parameters_of_several_contacts_apart(tmp_path, capsys):
    entries = [result("pe1", seed, 0.4 + 0.1 * seed) for seed in (0, 1)]
    for entry in entries:
        entry["force_error"]["unit"]["rmse"] = "1"  # of several contacts: each over its own force
        names = (f"{c}.{n}" for c in ("box", "hinge") for n in ("sigma_0", "sigma_1", "sigma_2", "mu_c", "mu_s", "v_s"))
        entry["parameters"] = {name: {"value": 1.1, "truth": 1.0} for name in names}
    jobs = planned(tmp_path, entries)
    rows = summarise_sweep(tmp_path, jobs, "here")
    out = capsys.readouterr().out
    assert "hinge." in out and "sigma_2" in out and "…" not in out
    figure = summary_figure(rows, groups(rows, ["seed"]), [])
    forces, parameters = figure.axes
    looks = {(line.get_color(), line.get_marker()) for line in parameters.lines}
    assert len(parameters.lines) == len(looks) == 12
    assert "(of the force)" in forces.get_xlabel() and forces.get_ylim() == parameters.get_ylim()


def test_parameter_errors_of_a_group_do_not_cancel():
    rows = [
        {"job": k, "folder": "", "state": "finished", "force_rmse": 1.0, "force_unit": "N", "mu_c_off": off}
        for k, off in enumerate((0.1, -0.1))
    ]
    (entry,) = groups(rows, [])
    assert entry["mu_c_off_mean"] == 0.0 and entry["mu_c_off_abs"] == pytest.approx(0.1)


def test_a_result_of_another_configuration_does_not_count(tmp_path):
    (job,) = planned(tmp_path, [result("bb1", 0, 1.0)])
    assert result_of(tmp_path / job.folder, job.digest)
    assert result_of(tmp_path / job.folder, digest({"model": "bb2", "seed": 0, "trainer": {}})) is None
    (tmp_path / job.folder / "result.json").write_text('{"model": "bb1"')
    assert result_of(tmp_path / job.folder) is None


def test_threads_and_checkpoint_make_no_other_job():
    cfg = {"model": "bb1", "trainer": {"threads": 2, "max_epochs": 5}, "ckpt_path": "a"}
    assert digest(cfg) == digest({"model": "bb1", "trainer": {"threads": None, "max_epochs": 5}})
    assert digest(cfg) != digest({"model": "bb1", "trainer": {"max_epochs": 6}})


class Launcher:
    """Runs jobs in order; a job named in ``deadly`` ends the launch, as a broken pool of workers does."""

    def __init__(self, folder: Path, deadly=()):
        self.folder, self.deadly, self.launched = folder, list(deadly), []

    def launch(self, overrides, initial_job_idx):
        for options in overrides:
            values = dict(item.partition("=")[::2] for item in options)
            seed, name = int(values["seed"]), values["hydra.sweep.subdir"].strip("'")
            self.launched.append(seed)
            (self.folder / name).mkdir(parents=True, exist_ok=True)
            set_status(self.folder / name, "running")
            if seed in self.deadly:
                raise RuntimeError("worker terminated")
            write_json(self.folder / name / "result.json", result("bb1", seed, 1.0))


def sweep(folder: Path, seeds, subdir="${hydra.job.num}_job") -> Sweep:
    def compose(overrides):
        seed = int(overrides[0].partition("=")[2])
        hydra = {
            "sweep": {"dir": str(folder), "subdir": subdir},
            "job": {"num": 0, "id": 0},
            "overrides": {"hydra": []},
        }
        return OmegaConf.create({"model": "bb1", "seed": seed, "trainer": {}, "hydra": hydra})

    config = compose(["seed=0"])
    return Sweep(config, ["seed=..."], ["seed"], [[f"seed={k}"] for k in seeds], compose)


def test_a_launcher_whose_pool_breaks_loses_one_job_only(tmp_path):
    launcher = Launcher(tmp_path, deadly=[1])
    results = sweep(tmp_path, range(4)).run(launcher, batch=4)
    assert [item is not None for item in results] == [True, False, True, True]
    assert launcher.launched == [0, 1, 1, 2, 3]  # the rest once more, each alone


def test_a_launcher_that_cannot_start_is_one_line(tmp_path):
    class Broken:
        def launch(self, overrides, initial_job_idx):
            raise RuntimeError("no sbatch here")

    with pytest.raises(UserError, match=r"the launcher cannot launch: .*RuntimeError: no sbatch here"):
        sweep(tmp_path, [0, 1]).run(Broken(), batch=2)


def test_jobs_that_would_share_a_folder_are_refused_before_any_runs(tmp_path):
    launcher = Launcher(tmp_path)
    with pytest.raises(UserError, match=r"two jobs with one folder: hydra\.sweep\.subdir is same"):
        sweep(tmp_path, [0, 1], subdir="same").run(launcher, batch=2)
    assert launcher.launched == []


def test_repeated_combinations_run_once(tmp_path):
    launcher = Launcher(tmp_path)
    sweep(tmp_path, [0, 0, 1]).run(launcher, batch=3)
    assert launcher.launched == [0, 1]


# ---- resume= on the command line


def test_resume_of_a_sweep_gives_back_its_command(tmp_path):
    (tmp_path / "manifest.json").write_text(
        json.dumps({"arguments": ["model=bb1,pe1", "seed=0,1"], "launch": ["hydra/launcher=joblib"], "jobs": []})
    )
    told = resumed([f"resume={tmp_path}"], "train")
    assert told == ["-m", "hydra/launcher=joblib", "model=bb1,pe1", "seed=0,1", f"hydra.sweep.dir='{tmp_path}'"]
    told = resumed([f"resume={tmp_path}", "hydra/launcher=basic"], "train")
    assert "hydra/launcher=basic" in told and "hydra/launcher=joblib" not in told


def test_resume_of_a_run_goes_on_in_its_folder(tmp_path):
    (tmp_path / ".hydra").mkdir()
    (tmp_path / ".hydra" / "overrides.yaml").write_text("- model=bb1\n- ckpt_path=old.ckpt\n")
    assert resumed([f"resume={tmp_path}"], "train") == ["model=bb1", f"hydra.run.dir='{tmp_path}'"]
    (tmp_path / "checkpoints").mkdir()
    (tmp_path / "checkpoints" / "last.ckpt").touch()
    assert resumed([f"resume={tmp_path}"], "train")[-1] == f"ckpt_path='{tmp_path}/checkpoints/last.ckpt'"


def test_what_another_command_left_in_a_folder_is_not_gone_on_with(tmp_path):
    (tmp_path / ".hydra").mkdir()
    (tmp_path / ".hydra" / "overrides.yaml").write_text("- system=drive\n")
    (tmp_path / ".hydra" / "hydra.yaml").write_text("hydra: {job: {name: identify}}\n")
    with pytest.raises(UserError, match=rf"another command: resume is {tmp_path}, of identify; .* resume={tmp_path}$"):
        resumed([f"resume={tmp_path}"], "train")
    assert resumed([f"resume={tmp_path}"], "identify")[0] == "system=drive"
    write_manifest(tmp_path, "diagnose", [], [], [])
    with pytest.raises(UserError, match=rf"another command: resume is {tmp_path}, of diagnose"):
        resumed([f"resume={tmp_path}"], "train")


def test_a_sweep_in_the_folder_of_another_commands_sweep_is_refused(tmp_path):
    write_manifest(tmp_path, "diagnose", [], [], [])
    with pytest.raises(UserError, match=r"another command: hydra.sweep.dir is .*, of diagnose; allowed: one of train"):
        sweep(tmp_path, [0])._plan()


def test_what_cannot_be_resumed_is_said_in_one_line(tmp_path):
    (tmp_path / "empty").mkdir()
    (tmp_path / "torn").mkdir()
    (tmp_path / "torn" / "manifest.json").write_text('{"jobs": [')
    done = tmp_path / "done"
    (done / ".hydra").mkdir(parents=True)
    (done / ".hydra" / "overrides.yaml").write_text("- model=bb1\n")
    (done / "result.json").write_text("{}")
    cases = {
        ("resume=nowhere",): "no such folder: resume is nowhere",
        (f"resume={tmp_path}/empty",): "neither a run nor a sweep",
        (f"resume={tmp_path}/torn",): "damaged manifest",
        (f"resume={done}",): "the run has finished",
        (f"resume={done}", "model=pe1"): "an option that would make it another experiment: command line is model=pe1",
    }
    for arguments, message in cases.items():
        with pytest.raises(UserError, match=message):
            resumed(list(arguments), "train")
