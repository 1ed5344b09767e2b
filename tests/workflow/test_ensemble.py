"""train.py ensemble=N: members as their own runs, an interval that is scored, checkpoints that evaluate.py loads."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf

from frictionpinn.errors import UserError
from frictionpinn.models import FrictionEnsemble
from frictionpinn.workflow.evaluate import evaluate
from frictionpinn.workflow.load import load_run

ROOT = Path(__file__).resolve().parents[2]
BRIEF = ["grid=11", "substeps=1", "trajectories.pob=[{name: Traj. 1, duration: 0.4, theta: '45*deg*sin(2*pi*t)'}]"]


def evaluated(folder: Path) -> list[float]:
    """Mean square errors of a run's force, online and in simulation, on a brief trajectory."""
    with initialize_config_dir(str(ROOT / "conf"), version_base="1.3"):
        cfg = OmegaConf.to_container(compose("evaluate", overrides=[f"run={folder}", *BRIEF]), resolve=True)
    errors = evaluate(cfg)["errors"]["Traj. 1"]["model"]
    return [errors[way]["force_mse"]["value"] for way in ("online", "in_simulation")]


def test_what_an_ensemble_is_over_is_refused_of_a_single_model(quick, tmp_path):
    with pytest.raises(UserError, match="ensemble_over is noise; allowed: with ensemble from 2"):
        quick(tmp_path, "model=bb1", "ensemble_over=noise")


@pytest.fixture(scope="module")
def run(quick, tmp_path_factory):
    """Three members over noise, with a checkpoint at every second epoch."""
    folder = tmp_path_factory.mktemp("ensemble")
    options = ["model=bb1", "ensemble=3", "ensemble_over=noise", "trainer.checkpoint_every_n_epochs=2"]
    return folder, quick(folder, *options, epochs=6)


def test_a_member_is_the_run_of_its_seed(run, quick, tmp_path):
    folder, _ = run
    quick(tmp_path, "model=bb1", "seed=2", "trainer.checkpoint_every_n_epochs=2", epochs=6)
    (_, _, together), (_, _, alone) = load_run(folder), load_run(tmp_path)
    assert isinstance(together, FrictionEnsemble)
    member = together.members()[2].state_dict()
    for key, value in alone.state_dict().items():
        assert torch.allclose(member[key], value, rtol=1e-4, atol=1e-6), key


def test_the_interval_and_its_coverage_stand_in_the_result(run):
    folder, result = run
    told = json.loads((folder / "result.json").read_text())["ensemble"]
    assert told == json.loads(json.dumps(result["ensemble"]))
    assert told["members"] == 3 and told["over"] == "noise" and told["force_std_rms"] > 0
    assert 0 <= told["coverage"]["spread_alone"] <= told["coverage"]["interval"] <= 1
    assert (folder / "figures" / "force_over_time.png").is_file()


def test_an_ensemble_is_evaluated_like_a_single_network(run):
    folder, _ = run
    assert all(error > 0 for error in evaluated(folder))


def test_parameters_of_an_estimator_have_their_spread_and_training_resumes(quick, tmp_path):
    options = ["model=pe1", "ensemble=2", "trainer.checkpoint_every_n_epochs=2"]
    quick(tmp_path / "first", *options, epochs=2)
    last = tmp_path / "first" / "checkpoints" / "last.ckpt"
    result = quick(tmp_path / "second", *options, f"ckpt_path={last}", epochs=4)
    assert result["training"]["epochs"] == 4
    assert 0 < result["parameters"]["mu_c"]["spread"] < result["parameters"]["mu_c"]["value"]
    with pytest.raises(UserError, match="checkpoint of another model"):
        quick(tmp_path / "third", "model=pe1", "ensemble=3", f"ckpt_path={last}", epochs=4)


@pytest.mark.parametrize("wrong", ["ensemble=0", "ensemble=1.5", "ensemble_over=seeds"])
def test_impossible_ensembles_are_refused(quick, tmp_path, wrong):
    with pytest.raises(UserError, match="ensemble"):
        quick(tmp_path, "model=bb1", wrong)


@pytest.fixture(scope="module")
def remembering(quick, tmp_path_factory):
    """Two networks with memory."""
    folder = tmp_path_factory.mktemp("remembering")
    options = ["experiment=memory", "model=pe2", "ensemble=2", "trainer.checkpoint_every_n_epochs=2"]
    return folder, quick(folder, *options, epochs=4)


def test_the_mean_of_members_with_memory_is_one_network_with_the_bristles_of_all(remembering):
    folder, _ = remembering
    _, _, together = load_run(folder)
    whole, parts = together.friction(), [member.friction() for member in together.members()]
    z = np.array([2e-5, -1e-5])
    for v, N in ((3e-2, 12.0), (-2e-3, 15.0), (0.0, 13.0)):
        forces, rates = zip(*((own.rates(v, N, z[k : k + 1])) for k, own in enumerate(parts)), strict=True)
        found = whole.rates(v, N, z)
        assert found[0] == pytest.approx(np.mean(forces)) and found[1:] == pytest.approx(rates)


def test_networks_with_memory_are_evaluated_together(remembering):
    folder, result = remembering
    assert all(error > 0 for error in evaluated(folder))
    assert load_run(folder)[2].physical_of_members()["mu_c"] == pytest.approx([0.3, 0.3], rel=0.1)
    assert result["ensemble"]["members"] == 2


def test_networks_with_memory_over_noise_are_refused(quick, tmp_path):
    with pytest.raises(UserError, match="the same samples"):
        quick(tmp_path, "experiment=memory", "model=pe2", "ensemble=2", "ensemble_over=noise")
