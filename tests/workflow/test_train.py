"""What one training leaves: result.json, checkpoints, TensorBoard files, figures."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import torch
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from frictionpinn.models import ParameterEstimator
from frictionpinn.workflow.build import build_system
from frictionpinn.workflow.experiment import build_data

LUGRE = {"sigma_0": "N/m", "sigma_1": "N*s/m", "sigma_2": "N*s/m", "mu_c": "1", "mu_s": "1", "v_s": "m/s", "alpha": "1"}


@pytest.fixture(scope="module")
def run(quick, tmp_path_factory) -> tuple[Path, dict]:
    """A pe2 of 60 epochs with a validation trial."""
    folder = tmp_path_factory.mktemp("run")
    trials = "data.trials=[{duration: 0.6, theta: '50*deg*sin(2*pi*t)'}, {duration: 0.6, theta: '55*deg*sin(2*pi*t)'}, "
    trials += "{duration: 0.6, theta: '60*deg*sin(2*pi*t)'}]"
    options = ["trainer.checkpoint_every_n_epochs=20", "trainer.log_every_n_steps=10"]
    quick(folder, "model=pe2", trials, "data.held_out=[3]", "data.validation=[2]", *options, epochs=60)
    return folder, json.loads((folder / "result.json").read_text())


@pytest.fixture(scope="module")
def events(run) -> EventAccumulator:
    accumulator = EventAccumulator(str(run[0] / "tensorboard"))
    accumulator.Reload()
    return accumulator


def test_result_gives_parameters_with_unit_start_and_truth(run):
    table = run[1]["parameters"]
    assert {name: entry["unit"] for name, entry in table.items()} == LUGRE
    for name, entry in table.items():
        assert entry["trained"] == (name != "alpha") and entry["value"] > 0 and entry["text"]
        if entry["trained"]:
            assert entry["start"] > 0 and entry["start"] != entry["value"]
    assert table["mu_c"]["truth"] == 0.3 and table["sigma_0"]["truth"] == 1e5


def test_result_gives_the_held_out_error_with_unit_beside_the_baseline(run):
    error = run[1]["force_error"]
    assert error["on"] == "held-out trials" and error["unit"] == {"rmse": "N", "mse": "N^2", "relative": "1"}
    for key in ("model", "coulomb_viscous"):
        item = error[key]
        assert item["mse"] == pytest.approx(item["rmse"] ** 2) and item["reference"] == "true friction force"
        assert item["relative"] == pytest.approx(item["rmse"] / item["reference_rms"])
        assert list(item["by_trial"]) == ["3"]
    assert set(error["coulomb_viscous"]["parameters"]) == {"mu_c", "sigma_2", "v_t"}


def test_result_says_on_what_with_what_and_how_long(run):
    _, result = run
    assert result["data"]["samples"] == {"train": 120, "validation": 120, "held_out": 120}
    assert result["data"]["trials"] == {"train": ["1"], "validation": ["2"], "held_out": ["3"]}
    assert len(result["data"]["sha256"]) == 64
    assert result["training"]["epochs"] == 60 and result["training"]["seconds"]["training"] > 0
    assert result["training"]["seconds"]["training"] < result["training"]["seconds"]["total"]
    assert {"frictionpinn", "python", "torch", "lightning", "numpy"} <= set(result["versions"])
    assert result["commit"] is None or len(result["commit"].removesuffix("+changes")) == 40
    config = result["config"]
    assert config["model"]["name"] == "pe2" and config["data"]["truth"]["mu_c"] == 0.3 and config["seed"] == 0


@pytest.mark.parametrize("name", ["best", "last"])
def test_checkpoints_load_without_running_code(run, configure, name):
    folder, result = run
    path = folder / "checkpoints" / f"{name}.ckpt"
    checkpoint = torch.load(path, weights_only=True)
    assert checkpoint["hyper_parameters"]["name"] == "pe2"
    model = ParameterEstimator.load_from_checkpoint(path, weights_only=True)
    if name == "best":
        assert model.physical()["mu_c"] == pytest.approx(result["parameters"]["mu_c"]["value"], rel=1e-6)
        system = build_system(result["config"]["system"])
        trial = build_data(result["config"], system).select("held_out")[0]
        error = model.predict_trial(trial)["force"] - trial.truth["friction_force"]
        assert (error**2).mean() == pytest.approx(result["force_error"]["model"]["mse"], rel=1e-4)


def test_tensorboard_holds_losses_parameters_and_step_sizes(run, events):
    tags = set(events.Tags()["scalars"])
    assert {f"parameter/{name}" for name in LUGRE} <= tags
    assert {"loss/loss", "loss/force", "loss/consistency", "loss/validation"} <= tags
    assert {"learning_rate/network", "learning_rate/physical"} <= tags
    assert [item.step for item in events.Scalars("parameter/mu_c")] == [10, 20, 30, 40, 50, 60]
    final = events.Scalars("loss/force")
    assert final[-1].value < final[0].value


def test_both_figures_are_in_tensorboard_and_png_files(run, events):
    assert {"force_over_time", "force_over_velocity"} <= set(events.Tags()["images"])
    files = sorted((run[0] / "figures").glob("*.png"))
    assert {"force_over_time", "force_over_velocity"} <= {file.stem for file in files}
    for file in files:
        assert file.read_bytes().startswith(b"\x89PNG\r\n\x1a\n") and file.stat().st_size > 10_000


def test_one_seed_gives_one_result_and_another_seed_another(quick, tmp_path):
    runs = [quick(tmp_path / str(k), "model=pe1", f"seed={seed}", epochs=10) for k, seed in enumerate((1, 1, 2))]
    errors = [item["force_error"]["model"]["mse"] for item in runs]
    assert errors[0] == errors[1] != errors[2]
    assert runs[0]["parameters"] == runs[1]["parameters"]


def test_a_black_box_has_no_parameters_to_report(quick, tmp_path):
    result = quick(tmp_path, "model=bb2")
    assert result["parameters"] == {} and result["force_error"]["model"]["rmse"] > 0


def test_a_torque_is_reported_in_its_own_unit(quick, tmp_path):
    trials = "data.trials=[{duration: 1.0, initial: {theta: 1.6}}, {duration: 1.0, initial: {theta: 2.2}}]"
    result = quick(tmp_path, "system=pendulum", "model=pe1", trials)
    assert result["force_error"]["unit"] == {"rmse": "N*m", "mse": "(N*m)^2", "relative": "1"}
    assert result["parameters"]["sigma_0"]["unit"] == "N*m/rad"


def test_a_single_trial_trains_and_says_that_its_errors_are_those_of_training(quick, tmp_path, caplog):
    caplog.set_level("INFO", logger="frictionpinn.workflow")
    trials = "data.trials=[{duration: 1.0, theta: '50*deg*sin(2*pi*t)'}]"
    result = quick(tmp_path, "model=bb1", trials, "data.held_out=null")
    assert result["data"]["trials"] == {"train": ["1"], "validation": [], "held_out": []}
    assert result["force_error"]["on"] == "training trials (none held out)"
    assert "held out: none: errors are those of the training trials" in caplog.text


def test_training_stops_early_where_nothing_improves(quick, tmp_path):
    stopping = "trainer.early_stopping={patience: 4, min_delta: 1000.0}"
    result = quick(tmp_path, "model=bb1", stopping, "trainer.checkpoint_every_n_epochs=2", epochs=40)
    assert result["training"]["epochs"] < 12


def test_several_steps_per_epoch_are_counted(quick, tmp_path):
    quick(tmp_path, "model=bb1", "data.steps_per_epoch=4", epochs=5)
    assert torch.load(tmp_path / "checkpoints" / "last.ckpt", weights_only=True)["global_step"] == 20


def test_tied_damping_is_reported_as_not_trained(quick, tmp_path):
    table = quick(tmp_path, "model=pe1", "friction.tie_sigma1=true", epochs=5)["parameters"]
    assert table["sigma_1"]["value"] == pytest.approx(table["sigma_0"]["value"] ** 0.5, rel=1e-5)
    assert not table["sigma_1"]["trained"] and table["sigma_0"]["trained"]
