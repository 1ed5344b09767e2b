"""Networks of several contacts from the configuration: trained at once, told and evaluated at each contact."""

from __future__ import annotations

import json

import numpy as np
import pytest
import torch

from frictionpinn.errors import UserError
from frictionpinn.evaluate.force import force_errors
from frictionpinn.models.several import SeveralContacts
from frictionpinn.physics import SYSTEMS
from frictionpinn.physics.contacts import law_named
from frictionpinn.physics.force_balance import untold
from frictionpinn.physics.mechanism import Mechanism
from frictionpinn.workflow.build import build_recording, build_system
from frictionpinn.workflow.estimate import estimate
from frictionpinn.workflow.evaluate import evaluate
from frictionpinn.workflow.experiment import build_data, build_model
from frictionpinn.workflow.export import export
from frictionpinn.workflow.load import load_run
from frictionpinn.workflow.options import composed
from frictionpinn.workflow.train import train

SMALL = ["trainer.threads=1", "trainer.progress_bar=false", "model.network.width=8", "model.network.depth=2"]
SMALL += ["data.rate_hz=100", "data.training_trials=2"]


def built(*options: str):
    """Configuration, data and model as a training has them."""
    cfg = composed("train", [*SMALL, *options])
    system = build_system(cfg["system"])
    data = build_data(cfg, system)
    torch.manual_seed(0)
    model = build_model(cfg, system, data)
    data.prepare_for(model)
    return data, model


def trained(folder, *options: str):
    """Folder and result of a short training on both contacts of the pendulum on a box."""
    given = [*SMALL, "system=pob_hinge", "model=pe2", "trainer.max_epochs=3"]
    return folder, train(composed("train", [*given, *options]), folder)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return trained(tmp_path_factory.mktemp("hinge"), "friction.fixed.hinge.v_s=0.3")


def test_a_training_tells_parameters_and_errors_of_every_contact(run):
    folder, result = run
    table = result["parameters"]
    assert table["hinge.mu_c"]["truth"] == 0.1 and table["box.sigma_0"]["truth"] == 2e4
    assert table["box.sigma_0"]["unit"] == "N/m" and table["hinge.sigma_0"]["unit"] == "N*m/rad"
    assert table["hinge.v_s"]["value"] == pytest.approx(0.3) and not table["hinge.v_s"]["trained"]
    assert table["box.v_s"]["trained"]
    error = result["force_error"]
    assert error["contacts"]["box"]["unit"]["rmse"] == "N" and error["contacts"]["hinge"]["unit"]["rmse"] == "N*m"
    shares = [error["contacts"][name]["model"]["relative"] for name in ("box", "hinge")]
    assert error["model"]["rmse"] == pytest.approx(np.sqrt(np.mean(np.square(shares))))
    drawn = {path.name for path in (folder / "figures").iterdir()}
    assert {"force_over_time_box.png", "force_over_time_hinge.png", "characteristics_hinge.png"} <= drawn


def test_a_checkpoint_gives_the_same_forces_back(run):
    folder, result = run
    _, _, model = load_run(folder)
    assert isinstance(model, SeveralContacts) and model.contacts == ("box", "hinge")
    data = build_data(result["config"], SYSTEMS["pob_hinge"]())
    for contact in model.contacts:
        scored = [trial.at(contact) for trial in data.select("held_out")]
        told = result["force_error"]["contacts"][contact]["model"]["rmse"]
        assert force_errors(model.map_of(contact), scored)["rmse"] == pytest.approx(told, rel=1e-5)


def test_an_evaluation_compares_the_methods_at_every_contact(run):
    folder, _ = run
    result = evaluate(composed("evaluate", [f"run={folder}", "identify=false", "grid=5"]))
    assert list(result["errors"]) == ["trial 6, box", "trial 6, hinge"]
    for name, unit in (("box", "N^2"), ("hinge", "(N*m)^2")):
        methods = result["errors"][f"trial 6, {name}"]
        assert methods["model"]["online"]["force_mse"]["unit"] == unit
        knows = methods["observer_truth"]["online"]["force_mse"]["value"]
        assert knows < 0.2 * methods["coulomb_viscous"]["online"]["force_mse"]["value"]
        assert methods["law"]["in_simulation"]["force_mse"]["value"] > 0
    page = (folder / "evaluation" / "report.html").read_text()
    assert "trial 6, hinge" in page and "(N m)²" in page
    assert (folder / "evaluation" / "figures" / "trajectory_1_hinge.png").is_file()
    assert json.loads((folder / "evaluation" / "result.json").read_text())["characteristics"]["hinge"]["unit"] == "N*m"


@pytest.mark.parametrize("variant", ["bb1", "bb2", "pe1", "pe2"])
def test_the_loss_is_that_of_the_maps_where_each_force_has_an_equation_of_its_own(variant):
    data, model = built(f"model={variant}", "system=two_mass")
    batch = data.batches["train"]
    alone = sum(model.map_of(name).losses(model.of_contact(batch, name))["loss"] for name in model.contacts)
    torch.testing.assert_close(model.losses(batch)["loss"], alone, rtol=1e-4, atol=0.0)


def test_the_implied_forces_have_no_loss_whatever_moves_both_contacts():
    data, model = built("model=bb1", "system=double_pendulum")
    batch = dict(data.batches["train"])
    predicted = {f"{name}.force": batch[f"{name}.target"] for name in model.contacts}
    model.predict = lambda _: predicted
    assert float(model.losses(batch)["force"]) == 0.0
    batch["slopes"] = batch["slopes"] @ torch.tensor([[1.0, 1.0], [0.0, 1.0]])
    predicted["elbow.force"] = predicted["elbow.force"] + 1.0
    assert float(model.losses(batch)["force"]) == pytest.approx(
        sum(1 / s**2 for s in model.hparams["balance"]), rel=1e-4
    )


def test_shared_networks_have_the_same_weights_and_scales_of_their_own():
    _, model = built("model=pe2", "system=pob_hinge", "model.share=true")
    box, hinge = (model.map_of(name) for name in model.contacts)
    assert box.network.layers[0].weight is hinge.network.layers[0].weight
    assert not torch.equal(box.network.scale, hinge.network.scale)
    apart = built("model=pe2", "system=pob_hinge")[1]
    shared, own = (sum(p.numel() for p in item.parameters()) for item in (model, apart))
    assert own - shared == sum(p.numel() for p in box.network.parameters())


def test_shared_networks_are_refused_of_one_contact():
    with pytest.raises(UserError, match=r"model.share is true; allowed: with several contacts"):
        built("model=bb1", "model.share=true")


def test_a_contact_declared_without_friction_has_no_map():
    options = ["model=pe1", "system=pob_hinge", "friction.hinge=none", "data.friction={box: lugre, hinge: none}"]
    cfg = composed("train", [*SMALL, *options])
    cfg["data"]["truth"].pop("hinge")
    data = build_data(cfg, build_system(cfg["system"]))
    model = build_model(cfg, build_system(cfg["system"]), data)
    assert model.contacts == ("box",) and all(name.startswith("box.") for name in model.physical())


def test_forces_that_the_balance_does_not_tell_apart_are_named_at_the_start():
    assert untold(SYSTEMS["pob_hinge"](driven=("theta",)), ["box", "hinge"]) == ["hinge"]
    assert untold(SYSTEMS["pob_hinge"](driven=("theta",)), ["box"]) == []
    assert untold(SYSTEMS["two_mass"](), ["motor", "load"]) == []
    with pytest.raises(UserError) as error:
        built("model=pe2", "system=pob_hinge", "system.driven=[theta]")
    told = str(error.value)
    assert "pob_hinge: hinge, 1 free of 2 coordinates" in told and "friction.hinge=none" in told and "\n" not in told


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["ensemble=2"], "an ensemble is of one contact"),
        (["rollout=true", "model=bb1"], "a friction at rest is fitted on a system with one contact"),
        (["model.share=2"], "model.share is 2; allowed: true or false"),
        (["model.loss.force=plain"], "equations of motion in different units cannot be added"),
        (["friction=coulomb"], "a parameter estimator needs a friction law with a bristle state"),
        (["friction.box=none", "friction.hinge=none"], "no contact with friction"),
    ],
)
def test_what_several_contacts_have_not_is_told_in_one_line(tmp_path, options, words):
    system = "pob_hinge" if "friction.box=none" in options else "two_mass"
    with pytest.raises(UserError) as error:
        train(composed("train", [*SMALL, f"system={system}", "trainer.max_epochs=1", *options]), tmp_path)
    assert words in str(error.value) and "\n" not in str(error.value)


def test_a_prescribed_swing_leaves_the_friction_of_the_box_to_learn(tmp_path):
    swings = [{"duration": 1.0, "theta": f"{angle}*deg*sin(2*pi*t)"} for angle in (50, 60)]
    options = ["model=bb1", "system=pob_hinge", "system.driven=[theta]", "friction.hinge=none", "trainer.max_epochs=2"]
    cfg = composed("train", [*SMALL, *options])
    cfg["data"] |= {"trials": swings, "held_out": ["2"], "training_trials": None}
    result = train(cfg, tmp_path)
    assert list(result["force_error"]["contacts"]) == ["box"]


def test_networks_are_an_estimator_of_the_parameters_of_all_contacts():
    cfg = composed("train", [*SMALL, "system=cartpole", "data.training_trials=null"])
    mechanism = Mechanism(SYSTEMS["cartpole"](), law_named({"rail": "lugre", "bearing": "dahl"}, "friction"))
    recording = build_recording(cfg["data"], mechanism.system)
    found = estimate("pe1", mechanism, recording.select(["1", "2"]), seed=0, epochs=2)
    assert {"rail.mu_s", "rail.mu_c", "bearing.mu_c"} <= set(found.names) and "bearing.mu_s" not in found.names
    assert found.units["bearing.sigma_0"] == "N*m/rad"


@pytest.fixture(scope="module")
def remembered(tmp_path_factory):
    return trained(tmp_path_factory.mktemp("memory"), "experiment=memory")


def test_networks_with_memory_are_trained_on_the_balance_of_every_contact(remembered):
    folder, result = remembered
    _, system, model = load_run(folder)
    assert [type(model.map_of(name)).__name__ for name in model.contacts] == ["StateModel"] * 2
    assert {"box.sigma_0", "hinge.mu_c"} <= set(result["parameters"])
    (trial,) = build_data(result["config"], system).select("held_out")
    for contact in model.contacts:
        told = result["force_error"]["contacts"][contact]["model"]["rmse"]
        assert force_errors(model.map_of(contact), [trial.at(contact)])["rmse"] == pytest.approx(told, rel=1e-5)


@pytest.mark.parametrize("variant", ["bb2", "pe2"])
def test_a_training_with_memory_lowers_the_loss_of_the_balance_of_all_contacts(variant):
    data, model = built("experiment=memory", f"model={variant}", "system=two_mass")
    batch = data.batches["train"]
    optimizer = torch.optim.Adam(model.parameters(), lr=1e-2)
    losses = []
    for _ in range(60):
        optimizer.zero_grad()
        losses.append(model.losses(batch)["loss"])
        losses[-1].backward()
        optimizer.step()
    assert float(losses[-1].detach()) < 0.9 * float(losses[0].detach())
    assert all(p.grad is not None for p in model.parameters())


def test_networks_with_memory_of_several_contacts_may_have_the_same_weights():
    _, model = built("experiment=memory", "model=bb1", "system=two_mass", "model.share=true")
    first, second = (model.map_of(name) for name in model.contacts)
    assert first.network is second.network and first.stiffness is not second.stiffness


def test_networks_with_memory_of_several_contacts_are_handed_on_one_by_one(remembered):
    folder, _ = remembered
    cfg = composed("evaluate", [f"run={folder}", "export=[c]"])
    assert set(export(cfg)) == {"box.c", "hinge.c"}
    assert list((folder / "export" / "c" / "hinge").glob("*.h"))
