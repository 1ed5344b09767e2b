"""Networks for the joints of a robot: trained on the balance of all torques at once, beside the identification."""

import json

import numpy as np
import pandas as pd
import pytest
import torch
from arms import urdf

pytest.importorskip("pinocchio")

from test_robot_balance import ready, recorded

from frictionpinn.errors import UserError
from frictionpinn.models import JointNetworks, rebuilt
from frictionpinn.physics import LAWS
from frictionpinn.physics.robot import Robot
from frictionpinn.robots.identify import declare
from frictionpinn.robots.networks import Trained, joint_trials, kernel_of, start, weights
from frictionpinn.workflow.checkpoints import load_checkpoint
from frictionpinn.workflow.load import load_run
from frictionpinn.workflow.options import composed
from frictionpinn.workflow.robot_networks import _networks
from frictionpinn.workflow.train import train

SMALL = ["model.network.width=12", "model.network.depth=2", "trainer.threads=1", "trainer.progress_bar=false"]


def thinning(q, v, load, friction):
    """Dry friction, and viscous friction that thins: none of Coulomb and viscous friction's shape."""
    return np.sign(v) * np.array([6.0, 8.0, 4.0]) + np.array([30.0, 50.0, 20.0]) * v / (1 + 2 * np.abs(v))


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    return Robot.read(urdf(tmp_path_factory.mktemp("arm")), locked={"finger": 0.0})


def built(robot, name, law):
    """Start of the identification, prepared trial, model and batch of a variant."""
    base, trials = ready(robot, recorded(robot, change=thinning))
    solution = start(declare(robot, base, LAWS[law](), ["constant_force"]), trials)
    splits = {"train": ["run"], "validation": [], "held_out": []}
    cfg = composed("train", ["system=robot", "robot.file=arm.urdf", "robot.torque=motor", f"friction={law}", "data=csv",
                             "data.path=log.csv", f"model={name}", *SMALL])  # fmt: skip
    own = joint_trials(solution, trials, splits, name.startswith("pe"))
    torch.manual_seed(0)
    model = _networks(cfg, solution, own, name.startswith("pe"))
    batch = {key: torch.from_numpy(values) for key, values in model.arrays(own[0], "offline").items()}
    model.fit_scales(batch)
    return solution, trials[0], model, batch


def test_the_loss_is_blind_to_what_bodies_offsets_and_a_lag_explain(robot):
    _, _, model, batch = built(robot, "bb1", "coulomb_viscous")
    model.requires_grad_(False)
    plain = float(model.losses(batch)["force"])
    moved = batch["left"] + 3.0 * torch.as_tensor(model.hparams["balance"]) * batch["unknown"][..., :4].sum(-1)
    assert float(model.losses({**batch, "left": moved})["force"]) == pytest.approx(plain, rel=1e-3)
    other = batch["left"] + torch.sign(batch["joint_1.v"]) * batch["compared"][:, None]
    assert float(model.losses({**batch, "left": other})["force"]) > 1.5 * plain


def test_networks_are_compared_behind_the_low_pass_of_the_balance(robot):
    solution, trial, _, _ = built(robot, "bb1", "coulomb_viscous")
    steps = np.sign(trial.v[:, 0])
    passed = np.convolve(steps, kernel_of(trial), "same")[trial.keep]
    assert np.abs(passed - trial.filtered(steps)).max() < 0.01
    scale = weights(solution, [trial])
    assert scale / solution.sigmas == pytest.approx(np.full(3, scale[0] / solution.sigmas[0]))


def test_a_parameter_estimator_starts_at_the_identified_bristle(robot):
    solution, trial, model, _ = built(robot, "pe1", "lugre")
    for joint in model.contacts:
        torch.nn.init.zeros_(model.map_of(joint).network.layers[-1].weight)
    assert model.physical()["joint_2.sigma_0"] == pytest.approx(solution.model.values["joint_2.sigma_0"], rel=0.01)
    own, identified = Trained(solution, model, {}).friction(trial), solution.model.torques(trial)[1]
    off = np.sqrt(np.mean((own - identified) ** 2, axis=0) / np.mean(identified**2, axis=0))
    assert np.all(off < 0.03)


@pytest.fixture(scope="module")
def folder(robot, tmp_path_factory):
    folder = tmp_path_factory.mktemp("log")
    urdf(folder)
    (trial,) = recorded(robot, change=thinning).trials
    pd.DataFrame({"t": trial.t, **trial.signals}).to_csv(folder / "log.csv", index=False, float_format="%.8g")
    return folder


def options(folder, *more):
    return ["system=robot", f"robot.file={folder / 'arm.urdf'}", "robot.torque=motor", "robot.locked.finger=0.0",
            "friction=coulomb_viscous", "data=csv", f"data.path={folder / 'log.csv'}", *SMALL, *more]  # fmt: skip


def test_a_training_tells_torque_errors_of_every_joint_beside_coulomb_and_viscous_friction(folder):
    run = folder / "run"
    run.mkdir()
    result = train(composed("train", options(folder, "model=bb1", "trainer.max_epochs=150", "optimizer.lr=1e-2")), run)
    held = result["torque_error"]["log (end)"]
    assert np.mean(held["model"]) < 0.8 * np.mean(held["coulomb_viscous"])
    assert result["force_error"]["model"]["rmse"] == pytest.approx(np.mean(held["model"]))
    assert set(result["force_error"]["contacts"]) == {"joint_1", "joint_2", "joint_3"}
    assert json.loads((run / "result.json").read_text())["identified"]["values"]["joint_1.mu_c"] > 0
    assert (run / "figures" / "torques.png").stat().st_size > 1000
    checkpoint = load_checkpoint(run / "checkpoints" / "best.ckpt", "run")
    model = rebuilt(checkpoint["hyper_parameters"])
    model.load_state_dict(checkpoint["state_dict"])
    assert isinstance(model, JointNetworks) and model.contacts == ("joint_1", "joint_2", "joint_3")
    with pytest.raises(UserError, match="robot"):  # evaluations of one system know no robot
        load_run(run)


def test_the_experiment_on_a_measured_arm_composes_with_every_variant():
    for name in ("bb1", "bb2", "pe1", "pe2"):
        cfg = composed("train", ["experiment=ur10e", f"model={name}"])
        assert cfg["system"]["name"] == "robot" and cfg["data"]["name"] == "ur10e" and cfg["model"]["name"] == name


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (["model=bb1", "model.memory=state"], "model.memory"),
        (["model=pe1"], "friction"),
        (["model=bb1", "ensemble=3"], "ensemble"),
        (["model=bb1", "data.training_trials=1"], "data.training_trials"),
    ],
)
def test_what_networks_of_joints_cannot_be_is_refused(folder, tmp_path, more, said):
    with pytest.raises(UserError) as refused:
        train(composed("train", options(folder, *more)), tmp_path)
    assert said in str(refused.value)
