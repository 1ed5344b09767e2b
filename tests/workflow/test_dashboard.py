"""What TensorBoard gets to show, read back from the event files of a run."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from tensorboard.plugins.custom_scalar import layout_pb2
from tensorboard.plugins.hparams import metadata

from frictionpinn.workflow.dashboard import hyper_parameters, layout
from frictionpinn.workflow.manifest import Job, write_manifest

TRUTH = {"sigma_0": 1e5, "sigma_1": 316.23, "sigma_2": 0.4, "mu_c": 0.3, "mu_s": 0.6, "v_s": 1e-3}
FIGURES = {"force_over_time", "force_over_velocity", "residuals", "characteristics"}


@pytest.fixture(scope="module")
def run(quick, tmp_path_factory):
    """The result of a short pe2 and the events that it wrote."""
    folder = tmp_path_factory.mktemp("run")
    result = quick(folder, "model=pe2", "trainer.log_every_n_steps=1", epochs=3)
    events = EventAccumulator(str(folder / "tensorboard"))
    events.Reload()
    return folder, result, events


def test_losses_and_parameters_are_scalars_at_every_logged_step(run):
    _, result, events = run
    for tag in ("loss/loss", "loss/force", "loss/consistency", "learning_rate/network", "learning_rate/physical"):
        assert [item.step for item in events.Scalars(tag)] == [1, 2, 3]
        assert all(math.isfinite(item.value) for item in events.Scalars(tag))
    assert events.Scalars("parameter/mu_c")[-1].value == pytest.approx(result["parameters"]["mu_c"]["value"], rel=0.1)


def test_every_known_truth_is_a_line_with_as_many_points_as_its_estimate(run):
    events = run[2]
    for name, value in TRUTH.items():
        points = events.Scalars(f"truth/{name}")
        assert [item.value for item in points] == pytest.approx([value] * 4)
        assert [item.step for item in points] == [0, 1, 2, 3]


def test_the_layout_puts_losses_together_and_each_parameter_beside_its_truth(run):
    (event,) = run[2].Tensors("custom_scalars__config__")
    told = layout_pb2.Layout.FromString(event.tensor_proto.string_val[0])
    charts = {chart.title: list(chart.multiline.tag) for category in told.category for chart in category.chart}
    assert charts["losses"] == ["^loss/"]
    assert charts["sigma_0 (N/m)"] == ["^parameter/sigma_0$", "^truth/sigma_0$"] and "mu_c" in charts


def test_a_black_box_has_no_charts_of_parameters():
    assert list(layout({})) == ["training"]


def test_figures_are_shown_and_lie_in_the_folder(run):
    folder, _, events = run
    assert set(events.Tags()["images"]) == FIGURES
    assert {path.stem for path in (folder / "figures").glob("*.png")} == FIGURES
    for name in FIGURES:
        (image,) = events.Images(name)
        assert image.width > 400 and image.encoded_image_string.startswith(b"\x89PNG")


def test_hyper_parameters_and_what_they_reached_are_recorded(run):
    _, result, events = run
    content = events.SummaryMetadata(metadata.SESSION_START_INFO_TAG).plugin_data.content
    session = metadata.parse_session_start_info_plugin_data(content)
    told = {key: value.string_value or value.number_value for key, value in session.hparams.items()}
    assert told["model.name"] == "pe2" and told["noise.level"] == 0.05 and told["model.network.width"] == 16
    (error,) = events.Scalars("final/force_error")
    assert error.value == pytest.approx(result["force_error"]["model"]["rmse"])
    (off,) = events.Scalars("final/mu_c_off")
    assert off.value == pytest.approx(abs(result["parameters"]["mu_c"]["value"] / 0.3 - 1), rel=1e-5)


def test_options_that_a_sweep_varies_are_among_the_hyper_parameters(tmp_path, configure):
    cfg = configure("model.network.activation=tanh", "data.rate_hz=100", "system.parameters.d=0.3")
    swept = {"data.rate_hz": "100", "model": "pe2", "experiment": "paper", "system.parameters.d": "0.3"}
    write_manifest(tmp_path, "train", [], [], [Job(0, "0_job", "", swept, [])])
    told = hyper_parameters(cfg, tmp_path / "0_job")
    assert told["data.rate_hz"] == 100 and told["experiment"] == "paper" and told["system.parameters.d"] == 0.3
    assert "model" not in told and told["model.name"] == "pe2"
    assert "data.rate_hz" not in hyper_parameters(cfg, Path("elsewhere") / "0_job")
