"""Parts run once, resume, and share trainings; the command is the one that people type."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest
from commands import call

from frictionpinn.errors import UserError
from frictionpinn.reproduce import runs
from frictionpinn.reproduce.ablation import presets
from frictionpinn.reproduce.document import number
from frictionpinn.reproduce.draw import SWEPT
from frictionpinn.reproduce.equations import identified
from frictionpinn.reproduce.parts import PARTS, reproduce
from frictionpinn.reproduce.runs import Run, by_seed, each, finish, finish_all
from frictionpinn.workflow import cli, members
from frictionpinn.workflow.estimate import default_config

ROOT = Path(__file__).resolve().parents[2]
TINY = ("trainer.max_epochs=2", "model.network.width=8", "data.rate_hz=100", "model=bb1")
BRIEF = ("grid=5", "substeps=1", "identify=false", "simulators=[]")
BRIEF += ("trajectories.pob=[{name: Traj. 1, duration: 0.3, theta: '45*deg*sin(2*pi*t)'}]",)


def test_a_finished_training_is_not_repeated_unless_its_configuration_changed(workdir, monkeypatch):
    trained, evaluated = [], []
    train, evaluate = runs.train, runs.evaluate
    monkeypatch.setattr(runs, "train", lambda cfg, folder: trained.append(cfg) or train(cfg, folder))
    monkeypatch.setattr(runs, "evaluate", lambda cfg: evaluated.append(cfg) or evaluate(cfg))
    run = Run(Path("run"), TINY, (BRIEF,))
    first, (evaluation,) = finish(run)
    again, (same,) = finish(run)
    assert len(trained) == len(evaluated) == 1
    assert again == json.loads(json.dumps(first)) and same["errors"] == evaluation["errors"]
    other, _ = finish(Run(Path("run"), (*TINY, "seed=5"), (BRIEF,)))
    assert len(trained) == len(evaluated) == 2 and other["config"]["seed"] == 5


def test_trainings_that_differ_by_their_seed_alone_run_as_one_and_leave_a_run_each(workdir, monkeypatch):
    calls = []
    train = members.train
    monkeypatch.setattr(members, "train", lambda cfg, folder: calls.append(cfg["ensemble"]) or train(cfg, folder))
    monkeypatch.setattr(runs, "train", lambda cfg, folder: calls.append(cfg["seed"]) or train(cfg, folder))
    seeds = [Run(Path(f"seed_{k}"), (*TINY, f"seed={k}", "rollout=true"), ()) for k in (0, 1, 2, 5)]
    found = finish_all(seeds, 1)
    assert calls == [3, 5]
    assert [trained["training"]["seed"] for trained, _ in found] == [0, 1, 2, 5]
    assert not list(workdir.glob("*_more")) and (workdir / "seed_1" / "checkpoints" / "in_motion.ckpt").is_file()
    alone, _ = finish(Run(Path("alone"), (*TINY, "seed=1", "rollout=true"), ()))
    assert found[1][0]["force_error"]["model"]["mse"] == pytest.approx(alone["force_error"]["model"]["mse"], rel=1e-3)
    assert found[1][0]["config"] == alone["config"]
    finish_all(seeds, 1)
    assert calls == [3, 5, 1]


def test_networks_with_a_state_are_trained_each_by_itself(workdir, monkeypatch):
    calls = []
    train = runs.train
    monkeypatch.setattr(runs, "train", lambda cfg, folder: calls.append(cfg["seed"]) or train(cfg, folder))
    tiny = ("experiment=memory", *TINY, "data.held_out=[2]")
    tiny += (
        "data.trials=[{duration: 0.5, theta: '50*deg*sin(2*pi*t)'}, {duration: 0.5, theta: '60*deg*sin(2*pi*t)'}]",
    )
    seeds = [Run(Path(f"seed_{k}"), (*tiny, f"seed={k}"), ()) for k in (0, 1)]
    found = finish_all(seeds, 1)
    assert calls == [trained["training"]["seed"] for trained, _ in found] == [0, 1]


def test_a_part_that_has_its_result_file_is_left_alone(workdir, monkeypatch):
    calls = []
    monkeypatch.setitem(PARTS, "transfer", lambda *given: calls.append(given) or TRANSFER)
    cfg = default_config(["parts=[transfer]", "results=found", "pages=pages", "document=paper.md"], "reproduce")
    reproduce(cfg)
    written = (workdir / "paper.md").read_text()
    reproduce(cfg)
    assert len(calls) == 1 and (workdir / "paper.md").read_text() == written
    reproduce(cfg | {"again": True})
    assert len(calls) == 2
    reproduce(
        default_config(
            ["parts=[transfer]", "results=found", "pages=pages", "document=paper.md", "setting=full"], "reproduce"
        )
    )
    assert len(calls) == 3 and "(setting full," in (workdir / "paper.md").read_text()


CELL = {"value": 1.0, "by_seed": {"0": 1.0}, "failed": 0}
TRANSFER = {
    "matrix": {"bb1": {"pob": {"pob": {"online": CELL, "in_simulation": CELL}}}},
    "ratios": {"bb1": {}},
    "coulomb_viscous": {"pob": {"online": CELL, "in_simulation": CELL}},
}


def test_impossible_parts_settings_and_jobs_are_answered_before_anything_runs(workdir):
    with pytest.raises(UserError, match="did you mean 'transfer'"):
        reproduce(default_config(["parts=[transfar]"], "reproduce"))
    with pytest.raises(UserError, match="impossible number of processes: jobs is 0"):
        reproduce(default_config(["jobs=0"], "reproduce"))
    with pytest.raises(UserError, match=r"setting.*allowed: brief, full, short"):
        cli.check_command_line(ROOT / "conf", "reproduce", ["setting=long"])


def test_medians_count_what_failed():
    assert by_seed({0: 3.0, 1: 1.0, 2: None}) == {"value": 2.0, "by_seed": {"0": 3.0, "1": 1.0, "2": None}, "failed": 1}
    assert by_seed({0: None})["value"] is None


def test_every_ablation_sweeps_one_key_that_the_configuration_has():
    for name, (key, levels) in presets().items():
        assert len(levels) >= 2, name
        default_config([f"{key}={levels[0]}"])
        assert key in SWEPT, f"{name}: no axis label"


def test_make_paper_runs_a_part_from_the_command_line(workdir):
    tiny, brief = json.dumps([*TINY[:3]]), json.dumps([*BRIEF[:2]])
    options = ["parts=[transfer]", f"setting.transfer.train={tiny}", f"setting.transfer.evaluate={brief}", "jobs=1"]
    options += ["setting.transfer.models=[bb1]", "setting.transfer.systems=[sdob]", "setting.transfer.seeds=[1]"]
    options += ["results=found", "pages=pages", "document=paper.md"]
    done = call("reproduce.py", *options, cwd=workdir, timeout=300.0, PYTHONPATH=str(ROOT))
    assert done.returncode == 0, done.stderr
    cell = json.loads((workdir / "found" / "transfer.json").read_text())["matrix"]["bb1"]["sdob"]["sdob"]
    assert f"| BB1 | sdob | sdob | {number(cell['online']['value'])} |" in (workdir / "paper.md").read_text()
    assert (workdir / "found" / "transfer.png").stat().st_size > 10_000


def test_the_published_normal_force_puts_friction_coefficients_out():
    cases = ("published, data obey lagrange", "lagrange")
    wrong, right = (identified(case, 0, "data.held_out=[3, 4, 5, 6]")["mu_c"] for case in cases)
    assert abs(wrong["value"] / wrong["truth"] - 1) > 0.1 > abs(right["value"] / right["truth"] - 1)


def test_work_side_by_side_computes_with_one_thread_each(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    assert each(os.getenv, ["OMP_NUM_THREADS"] * 2, 2) == ["1", "1"]
    assert os.environ["OMP_NUM_THREADS"] == "7"
