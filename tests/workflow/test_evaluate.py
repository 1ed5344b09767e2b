"""Evaluation of a run: what it writes, transfer, the published figures beside ours, mistakes in one line."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from commands import call
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf
from pages import assert_reads_everywhere

from frictionpinn.errors import UserError
from frictionpinn.evaluate.published import published
from frictionpinn.workflow import cli
from frictionpinn.workflow.checkpoints import load_checkpoint
from frictionpinn.workflow.evaluate import evaluate
from frictionpinn.workflow.experiment import build_data
from frictionpinn.workflow.load import load_run

ROOT = Path(__file__).resolve().parents[2]
BRIEF = [
    "grid=11",
    "substeps=1",
    "identify=false",
    "simulators=[]",
    "trajectories.pob=[{name: Traj. 1, duration: 0.4, theta: '45*deg*sin(2*pi*t)'}]",
]


def configuration(*overrides: str) -> dict:
    with initialize_config_dir(str(ROOT / "conf"), version_base="1.3"):
        return OmegaConf.to_container(compose("evaluate", overrides=list(overrides)), resolve=True)  # type: ignore


@pytest.fixture(scope="module")
def run(quick, tmp_path_factory) -> Path:
    """A short training of PE1."""
    folder = tmp_path_factory.mktemp("run")
    quick(folder, "model=pe1")
    return folder


@pytest.fixture(scope="module")
def result(run) -> dict:
    return evaluate(configuration(f"run={run}", "seeds=[0,1,2]", *BRIEF))


def test_a_run_is_rebuilt_from_its_folder(run):
    cfg, system, model = load_run(run)
    assert cfg["model"]["name"] == "pe1" and system.name == "pob" and not model.training
    saved = load_checkpoint(run / "checkpoints" / "best.ckpt", "run")["state_dict"]
    assert all((value == saved[name]).all() for name, value in model.state_dict().items())


def test_an_evaluation_leaves_its_result_figures_and_one_page(run, result):
    folder = run / "evaluation"
    written = json.loads((folder / "result.json").read_text())
    assert written == json.loads(json.dumps(result))
    assert set(written["figures"]) == {f"figures/{n}.png" for n in ("errors", "trajectory_1", "characteristics")}
    page = (folder / "report.html").read_text()
    assert_reads_everywhere(page)
    assert page.count("data:image/png;base64,") == 3 and 'src="http' not in page
    assert f"{written['errors']['Traj. 1']['model']['online']['force_mse']['value']:.3g}" in page
    assert not list(folder.glob("*.tmp"))


def test_every_error_has_its_unit_and_the_online_one_is_the_median_over_seeds(result):
    errors = result["errors"]["Traj. 1"]
    assert list(errors) == [
        "model", "law", "force_balance", "coulomb", "coulomb_viscous", "network_observer", "observer", "observer_truth",
    ]  # fmt: skip
    online = errors["model"]["online"]["force_mse"]
    assert online["unit"] == "N^2" and set(online["by_seed"]) == {"0", "1", "2"}
    assert online["value"] == np.median(list(online["by_seed"].values()))
    simulated = errors["coulomb_viscous"]["in_simulation"]
    assert simulated["force_mse"]["value"] > 0
    assert simulated["position_rms"]["x"]["unit"] == "m" and simulated["velocity_rms"]["v"]["unit"] == "m/s"
    assert "in_simulation" not in errors["force_balance"] and "online" not in errors["law"]


def test_published_figures_stand_beside_those_of_the_same_model_and_trajectory(result):
    table = published()["force_mse"]["Traj. 1"]
    model = result["errors"]["Traj. 1"]["model"]
    for kind in ("online", "in_simulation"):
        assert model[kind]["force_mse"]["published"] == table[kind]["pe1"]
    assert "published" not in result["errors"]["Traj. 1"]["coulomb"]["online"]["force_mse"]


def test_a_perfect_law_has_no_error_in_simulation(run):
    from frictionpinn.evaluate.trajectory import simulate, simulation_error
    from frictionpinn.evaluate.yardsticks import Candidate, simulated_law
    from frictionpinn.workflow.trajectories import build_trajectories, transferred

    cfg, system, _ = load_run(run)
    options = configuration(f"run={run}", *BRIEF)
    (trajectory,) = build_trajectories(
        transferred(cfg, None, options["trajectories"]), system, build_data(cfg, system), options
    )
    truth = Candidate("truth", simulate=simulated_law(system, "lugre", cfg["data"]["truth"]))
    error = simulation_error(simulate(truth, trajectory), trajectory)
    assert error["force_mse"]["value"] < 1e-6 and error["position_rms"]["x"]["value"] < 1e-6


def test_effects_of_the_simulated_mechanism_act_on_the_trajectories_too_but_not_on_another_system(run):
    from frictionpinn.workflow.trajectories import build_trajectories, transferred

    cfg, system, _ = load_run(run)
    cfg["data"] = cfg["data"] | {"effects": {"drag": {"drag": 5.0}}}
    own, data = transferred(cfg, None, None), build_data(cfg, system)
    (trajectory,) = build_trajectories(own, system, data, {"seeds": [0]})
    recorded = data.by_name["2"].truth["friction_force"]  # held out, and what its trajectory is
    assert np.allclose(trajectory.force, recorded) and "drag" in data.recording.source
    other = configuration(f"run={run}", "system=sdob")["system"]
    assert transferred(cfg, other, None)["data"]["effects"] is None


def test_a_model_is_transferred_to_another_system_and_its_own_trials(run):
    cfg = configuration(f"run={run}", "system=sdob", *BRIEF)
    cfg["system"]["simulate"]["trials"] = [{**trial, "duration": 0.4} for trial in cfg["system"]["simulate"]["trials"]]
    result = evaluate(cfg)
    assert result["system"] == "sdob" and result["trained_on"] == "pob"
    (errors,) = result["errors"].values()
    assert errors["model"]["online"]["force_mse"]["value"] > 0
    assert "published" not in json.dumps(errors)
    assert (run / "evaluation_sdob" / "report.html").is_file()


def test_other_values_of_the_run_s_own_system_are_refused_since_its_own_are_simulated(run):
    with pytest.raises(UserError, match=r"system.parameters.m_b is 2.0; allowed: 0.5, as in the run"):
        evaluate(configuration(f"run={run}", "system=pob", "system.parameters.m_b=2.0", *BRIEF))


def test_a_model_of_one_contact_is_of_no_system_with_several(run):
    with pytest.raises(UserError, match=r"a model of one contact .*: system is two_mass; allowed: a system with one"):
        evaluate(configuration(f"run={run}", "system=two_mass", *BRIEF))


def test_a_simulation_that_ends_early_is_told_and_the_others_go_on(run, monkeypatch):
    from frictionpinn.evaluate import yardsticks
    from frictionpinn.numerics.simulation import SimulationFailed

    def fail(*_):
        raise SimulationFailed(0.1, "no force", "")

    monkeypatch.setattr(yardsticks, "simulate_model", fail)
    errors = evaluate(configuration(f"run={run}", *BRIEF))["errors"]["Traj. 1"]
    assert "simulation failed at t = 0.1000 s" in errors["model"]["in_simulation"]["failed"]
    assert errors["coulomb"]["in_simulation"]["force_mse"]["value"] > 0


@pytest.mark.parametrize(
    ("expected", "spoil"),
    [
        ("no such folder", lambda folder: folder.rename(folder.with_name("other"))),
        ("did you mean", lambda folder: folder.rename(folder.with_name("runs"))),
        ("not a finished training run", lambda folder: (folder / "result.json").unlink()),
        ("unreadable result of a run", lambda folder: (folder / "result.json").write_text("{")),
        ("no such checkpoint", lambda folder: (folder / "checkpoints" / "best.ckpt").unlink()),
        ("unreadable checkpoint", lambda folder: (folder / "checkpoints" / "best.ckpt").write_bytes(b"PK")),
    ],
)
def test_a_folder_that_is_no_run_is_named_in_one_line(run, tmp_path, expected, spoil):
    folder = tmp_path / "run"
    shutil.copytree(run, folder)
    spoil(folder)
    with pytest.raises(UserError, match=expected) as caught:
        load_run(folder)
    assert "\n" not in str(caught.value) and str(folder) in str(caught.value)


def test_a_measurement_is_compared_with_its_force_balance(quick, csv, tmp_path):
    folder = tmp_path / "run"
    quick(folder, "data=csv", f"data.path={csv()}", "model=pe1", epochs=20)
    result = evaluate(configuration(f"run={folder}", *BRIEF))
    assert result["truth"]["friction"] is None and result["reference"] == "force balance, smoothed"
    errors = result["errors"]["trial 2"]
    assert list(errors) == ["model", "law", "coulomb", "coulomb_viscous", "network_observer", "observer"]
    assert 0 < errors["coulomb"]["online"]["force_mse"]["value"] < 1.0
    assert 0 < errors["coulomb_viscous"]["in_simulation"]["position_rms"]["x"]["value"] < 0.02
    assert set(result["characteristics"]["difference_rms"].values()) == {None}
    assert "no truth is known" in (folder / "evaluation" / "report.html").read_text()
    with pytest.raises(UserError, match="measured system is not known on another"):
        evaluate(configuration(f"run={folder}", "system=sdob", *BRIEF))


def test_a_recording_that_changed_since_the_training_is_not_evaluated(quick, csv, tmp_path):
    folder = tmp_path / "run"
    quick(folder, "data=csv", f"data.path={csv()}", "model=bb1")
    csv(lambda table: table[table["t"] < 0.4])
    with pytest.raises(UserError, match=r"not the recording that the run was trained on: .*run\.csv"):
        evaluate(configuration(f"run={folder}", *BRIEF))


def test_an_integrator_is_chosen_by_name(run):
    with pytest.raises(UserError, match=r"integrator.*leave integrator=null"):
        evaluate(configuration(f"run={run}", "integrator=dopri5", *BRIEF))
    with pytest.raises(UserError, match="did you mean 'bdf2'"):
        evaluate(configuration(f"run={run}", "integrator=bdf3", *BRIEF))


def test_characteristics_of_further_runs_stand_beside(run):
    result = evaluate(configuration(f"run={run}", f"beside=[{run}]", *BRIEF))
    assert list(result["characteristics"]["difference_rms"]) == ["PE1", f"PE1, {run.name}"]


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        ("thetta: 'sin(t)'", r"trajectories.pob\[0\].thetta .* did you mean 'theta'"),
        ("theta: '60*deg*cos(12*t)'", "contact lost at t = .* trajectories.pob"),
    ],
)
def test_a_trajectory_that_cannot_be_simulated_is_named(run, wrong, told):
    with pytest.raises(UserError, match=told):
        evaluate(configuration(f"run={run}", f"trajectories.pob=[{{duration: 0.4, {wrong}}}]"))


@pytest.mark.parametrize("wrong", ["seeds=[]", "seeds=[-1]", "substeps=0", "grid=1"])
def test_impossible_options_are_refused(run, wrong):
    with pytest.raises(UserError, match=wrong.partition("=")[0]):
        evaluate(configuration(f"run={run}", *BRIEF, wrong))


@pytest.mark.parametrize(("wrong", "told"), [([], "add run="), (["run=a", "system=sdop"], "did you mean 'sdob'")])
def test_a_mistake_on_the_command_line_is_explained(wrong, told):
    with pytest.raises(UserError, match=told):
        cli.check_command_line(ROOT / "conf", "evaluate", wrong)


def test_the_command_prints_the_table_and_leaves_nothing_else_behind(run, tmp_path):
    process = call("evaluate.py", f"run={run}", *BRIEF, cwd=tmp_path)
    assert process.returncode == 0, process.stderr
    assert "PE1" in process.stdout and "Coulomb + viscous fit" in process.stdout
    assert process.stdout.splitlines()[-2].endswith(str(run / "evaluation"))
    assert "Warning" not in process.stderr and not list(tmp_path.iterdir())
