"""A short real training learns something: better than the customary fit, parameters nearer to the truth."""

from __future__ import annotations

import pytest

from frictionpinn.workflow.train import train


@pytest.fixture(scope="module")
def trained(configure, tmp_path_factory):
    """The default experiment, 250 epochs long, by model name."""
    results = {}

    def run(model):
        if model not in results:
            options = ["trainer.max_epochs=250", "trainer.threads=1", "trainer.progress_bar=false"]
            cfg = configure(f"model={model}", "data.rate_hz=200", "trainer.accelerator=cpu", *options)
            results[model] = train(cfg, tmp_path_factory.mktemp(model))
        return results[model]

    return run


@pytest.mark.parametrize("model", ["bb2", "pe2"])
def test_it_beats_the_coulomb_and_viscous_fit_on_the_held_out_swing(trained, model):
    error = trained(model)["force_error"]
    assert error["model"]["rmse"] < 0.5 * error["coulomb_viscous"]["rmse"]
    assert error["model"]["relative"] < 0.25


def test_the_acceleration_helps(trained):
    assert trained("bb2")["force_error"]["model"]["rmse"] < trained("bb1")["force_error"]["model"]["rmse"]


def test_pe2_finds_the_coulomb_coefficient(trained):
    entry = trained("pe2")["parameters"]["mu_c"]
    assert entry["value"] == pytest.approx(entry["truth"], rel=0.1)


def test_a_start_twice_off_is_left_behind(configure, tmp_path):
    options = ["friction.start={mu_c: 0.15, mu_s: 0.3}", "trainer.max_epochs=250", "data.rate_hz=200"]
    cfg = configure("model=pe2", *options, "trainer.threads=1", "trainer.progress_bar=false", "trainer.accelerator=cpu")
    entry = train(cfg, tmp_path)["parameters"]["mu_c"]
    assert entry["start"] == 0.15
    assert abs(entry["value"] - entry["truth"]) < 0.5 * abs(entry["start"] - entry["truth"])
