"""One suite for every variant of conf/model, each way of treating direction and each meaning of the bristle output."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
import torch
from omegaconf import OmegaConf

from frictionpinn.errors import UserError
from frictionpinn.models import MODELS
from frictionpinn.models.base import check_same_model
from frictionpinn.models.parameter_estimator import BRISTLE

FILES = sorted((Path(__file__).resolve().parents[2] / "conf" / "model").glob("*.yaml"))
CASES = [
    pytest.param(path.stem, odd, bristle, id="-".join(filter(None, (path.stem, "odd" if odd else "free", bristle))))
    for path in FILES
    for odd in (True, False)
    for bristle in (BRISTLE if "bristle" in OmegaConf.load(path) else (None,))
]
ESTIMATORS = [path.stem for path in FILES if "bristle" in OmegaConf.load(path)]


@pytest.fixture
def variant(make):
    """Build a case: the bristle option exists for parameter estimators only."""

    def build(name, odd, bristle, **changes):
        return make(name, odd=odd, **({"bristle": bristle} if bristle else {}), **changes)

    return build


def mirrored(model, batch):
    """The batch of the motion in the other direction."""
    signs = torch.as_tensor(model.features.odd, dtype=torch.float32)
    turned = {"x": batch["x"] * signs, "x_rate": batch["x_rate"] * signs}
    return {**batch, **turned, **{name: -batch[name] for name in ("v", "v_rate", "target")}}


@pytest.mark.parametrize(("name", "odd", "bristle"), CASES)
def test_force_is_odd_in_the_motion_exactly_where_it_shall_be(variant, batch, name, odd, bristle):
    model = variant(name, odd, bristle)
    there = batch(model)
    forces = [model.predict(item)["force"].detach() for item in (there, mirrored(model, there))]
    difference = float((forces[0] + forces[1]).abs().max() / forces[0].abs().max())
    assert difference < 1e-4 if odd else difference > 1e-3


@pytest.mark.parametrize(("name", "odd", "bristle"), CASES)
def test_some_rows_are_predicted_as_within_the_whole_batch(variant, batch, name, odd, bristle):
    model = variant(name, odd, bristle)
    whole = batch(model)
    rows = torch.tensor([0, 3, 50, 199])
    full = model.predict(whole)
    picked = model.predict({key: value[rows] for key, value in whole.items()})
    single = [model.predict({key: value[row : row + 1] for key, value in whole.items()}) for row in rows]
    for key, values in full.items():
        tolerance = {"rtol": 1e-4, "atol": 1e-5 * float(values.detach().abs().max())}
        torch.testing.assert_close(picked[key], values[rows], **tolerance)
        torch.testing.assert_close(torch.cat([item[key] for item in single]), values[rows], **tolerance)


@pytest.mark.parametrize(("name", "odd", "bristle"), CASES)
def test_gradients_are_finite_at_rest(variant, batch, name, odd, bristle):
    model = variant(name, odd, bristle)
    resting = {key: value.clone() for key, value in batch(model).items()}
    signs = torch.as_tensor(model.features.odd)
    resting["x"][:, signs < 0] = 0.0
    for key in ("x_rate", "v", "v_rate", "N_rate"):
        resting[key].zero_()
    model.losses(resting)["loss"].backward()
    assert all(torch.isfinite(p.grad).all() for p in model.parameters())
    model.zero_grad()
    model.losses(batch(model))["loss"].backward()
    assert all(torch.isfinite(p.grad).all() and bool(p.grad.any()) for p in model.parameters() if p.numel() > 1)


@pytest.mark.parametrize(("name", "odd", "bristle"), CASES)
def test_saved_and_loaded_it_predicts_the_same(variant, data, name, odd, bristle):
    model = variant(name, odd, bristle)
    file = io.BytesIO()
    torch.save({"state_dict": model.state_dict(), "hyper_parameters": dict(model.hparams)}, file)
    file.seek(0)
    saved = torch.load(file, weights_only=True)
    again = MODELS[name](**saved["hyper_parameters"])
    again.load_state_dict(saved["state_dict"])
    trial = data.select("held_out")[0]
    for source in ("online", "offline"):
        before, after = model.predict_trial(trial, source), again.predict_trial(trial, source)
        assert before.keys() == after.keys()
        assert all(np.array_equal(before[key], after[key]) for key in before)
        assert before["force"].shape == trial.t.shape and np.isfinite(before["force"]).all()
    assert again.physical() == model.physical()


@pytest.mark.parametrize("bristle", BRISTLE)
@pytest.mark.parametrize("name", ESTIMATORS)
def test_bristle_rate_is_the_time_derivative_along_a_smooth_trajectory(variant, batch, name, bristle):
    model = variant(name, False, bristle).double()
    middle = {key: value[100].double() for key, value in batch(model).items()}
    swing = {key: 0.3 * torch.linspace(-1, 1, value.numel(), dtype=torch.float64) for key, value in middle.items()}

    def at(t):
        t = torch.as_tensor(t, dtype=torch.float64)[:, None]
        now = {key: middle[key] * (1 + swing[key] * torch.sin(3 * t + 0.2)) for key in ("x", "v", "N")}
        rates = {f"{key}_rate": middle[key] * swing[key] * 3 * torch.cos(3 * t + 0.2) for key in now}
        now["v"] = middle["v"] * (1 + 0.5 * torch.sin(3 * t))
        return {**now, **rates, "v_rate": 1.5 * middle["v"] * torch.cos(3 * t)}

    t, h = np.linspace(0, 2, 50), 1e-5
    ahead, behind = model.predict(at(t + h))["z"], model.predict(at(t - h))["z"]
    rate = model.predict(at(t))["z_rate"].detach()
    torch.testing.assert_close((ahead - behind) / (2 * h), rate, rtol=1e-5, atol=1e-6 * float(rate.abs().max()))


@pytest.mark.parametrize("name", ESTIMATORS)
@pytest.mark.parametrize("bristle", ["load", "steady"])
def test_bounded_bristle_never_carries_more_than_its_capacity(make, batch, name, bristle):
    model = make(name, bristle=bristle)
    with torch.no_grad():
        for p in model.network.parameters():
            p.mul_(50.0)
        predicted, p, whole = model.predict(batch(model)), model.law_parameters(), batch(model)
        capacity = model.functions.capacity(
            whole["v"] if bristle == "steady" else 0 * whole["v"], whole["N"], *p.values()
        )
    assert (p["sigma_0"] * predicted["z"].abs() <= capacity * (1 + 1e-4)).all()


@pytest.mark.parametrize("name", ESTIMATORS)
def test_every_law_with_a_bristle_trains_and_others_are_refused(make, batch, name):
    dahl = make(name, law="dahl")
    dahl.losses(batch(dahl))["loss"].backward()
    assert set(dahl.physical()) == {"sigma_0", "mu_c"}
    with pytest.raises(UserError, match=r"needs a friction law with a bristle state: friction is coulomb; .*lugre"):
        make(name, law="coulomb")


def test_losses_are_the_published_ones_when_plain(make, batch):
    model = make("pe1", bristle="free", loss={"force": "plain", "consistency": "plain", "weight": 1e5})
    whole = batch(model)
    predicted, parts = model.predict(whole), model.losses(whole)
    torch.testing.assert_close(parts["force"], (predicted["force"] - whole["target"]).square().mean())
    torch.testing.assert_close(parts["consistency"], 1e5 * predicted["residual"].square().mean())
    torch.testing.assert_close(parts["loss"], parts["force"] + parts["consistency"])


def test_only_the_second_variants_see_the_frictionless_acceleration(make):
    seen = {name: make(name).features.inputs for name in MODELS}
    for name, inputs in seen.items():
        assert ("a_frictionless" in inputs) == name.endswith("2")
        assert {"v_slip", "normal_force"} <= set(inputs)


@pytest.mark.parametrize(("saved", "now"), [("bb1", "bb2"), ("bb2", "bb1"), ("pe1", "bb1"), ("bb1", "pe1")])
def test_a_checkpoint_of_another_variant_is_refused_in_one_line(make, saved, now):
    checkpoint = {"hyper_parameters": dict(make(saved).hparams)}
    with pytest.raises(UserError, match=rf"checkpoint of another model: ckpt_path is name = {saved}; .*model={saved}"):
        check_same_model(checkpoint, dict(make(now).hparams))


def test_a_checkpoint_of_another_network_is_refused_and_its_own_accepted(make):
    hparams = dict(make("pe2").hparams)
    check_same_model({"hyper_parameters": hparams}, dict(make("pe2").hparams))
    with pytest.raises(UserError, match=r"another model: .*width"):
        check_same_model({"hyper_parameters": hparams}, dict(make("pe2", network={"width": 8}).hparams))
    with pytest.raises(UserError, match=r"ckpt_path is state.elements = None; allowed: state.elements = 2"):
        remembering = {"elements": 2, "gaps": False, "lr": 1e-2}
        check_same_model({"hyper_parameters": hparams}, {**hparams, "state": remembering})
    shifted = {**hparams, "law": {**hparams["law"], "start": {**hparams["law"]["start"], "mu_c": 1e-3}}}
    with pytest.raises(UserError, match=r"ckpt_path is friction.start.mu_c = 0.001"):
        check_same_model({"hyper_parameters": shifted}, hparams)
    start = {name: value * (1 + 1e-9) for name, value in hparams["law"]["start"].items()}  # another processor
    check_same_model({"hyper_parameters": {**hparams, "law": {**hparams["law"], "start": start}}}, hparams)
    with pytest.raises(UserError, match="not a checkpoint of frictionpinn"):
        check_same_model({"state_dict": {}}, hparams)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"network": {"activation": "rellu"}}, "model.network.activation is 'rellu'.*did you mean 'relu'"),
        ({"inputs": ["v_slipp"]}, "model.inputs is 'v_slipp'.*did you mean 'v_slip'"),
        ({"windows": {"v_slip": [[3, 3]]}}, r"impossible window: model.windows.v_slip is \[3, 3\]"),
        ({"windows": {"v_slip": [[0, 0]]}}, "impossible window"),
        ({"bristle": "stedy"}, "model.bristle is 'stedy'.*load, steady, free"),
    ],
)
def test_impossible_options_are_named(make, changes, message):
    with pytest.raises(UserError, match=message):
        make("pe2", **changes)
