"""An ensemble is its members: the same losses, steps, best weights and predictions as each alone."""

from __future__ import annotations

import copy

import pytest
import torch

from frictionpinn.errors import UserError
from frictionpinn.models import FrictionEnsemble, ensemble_of
from frictionpinn.models.network import ACTIVATIONS


def members(make, name: str, count: int = 3, **options) -> list:
    """Members with start weights of their own."""
    made = [make(name, **options) for _ in range(count)]
    for k, model in enumerate(made):
        torch.manual_seed(k)
        for layer in model.network.modules():
            if hasattr(layer, "reset_parameters"):
                layer.reset_parameters()
    return made


def steps(model, data, count: int) -> None:
    """Optimizer steps in a plain loop."""
    made = model.configure_optimizers()
    optimizer, schedule = made["optimizer"], made["lr_scheduler"]["scheduler"]
    for _ in range(count):
        optimizer.zero_grad()
        model.backward(model.training_step(data, 0))
        optimizer.step()
        schedule.step()


@pytest.mark.parametrize("name", ["bb2", "pe2"])
@pytest.mark.parametrize("over", ["seed", "noise"])
def test_every_member_takes_the_steps_that_it_would_take_alone(make, batch, name, over):
    alone = members(make, name, optimizer="adam_onecycle")
    data = [batch(alone[0])] * 3
    if over == "noise":  # other data, other standardisation
        data = [{key: value * (1 + 0.1 * k) for key, value in data[0].items()} for k in range(3)]
        for model, own in zip(alone, data, strict=True):
            model.fit_scales(own)
            model.scales["force"] *= 1 + 0.1 * float(own["x"].mean() > 0)
    together = FrictionEnsemble(copy.deepcopy(alone))
    stacked = data[0] if over == "seed" else {key: torch.stack([own[key] for own in data]) for key in data[0]}
    steps(together, stacked, 5)
    for model, own in zip(alone, data, strict=True):
        steps(model, own, 5)
    for model, member in zip(alone, together.members(), strict=True):
        for key, value in model.state_dict().items():
            assert torch.allclose(member.state_dict()[key], value, rtol=1e-4, atol=1e-6), key


@pytest.mark.parametrize("name", ["bb2", "pe1", "pe2"])
def test_every_member_with_memory_takes_the_steps_that_it_would_take_alone(make, batch, name, monkeypatch):
    monkeypatch.setattr("frictionpinn.models.state.find_start", lambda model, batch: None)
    monkeypatch.setattr("frictionpinn.models.black_box_start.start_as_law", lambda model, batch: None)
    alone = members(make, name, optimizer="adam_onecycle", memory="state")
    data, together = batch(alone[0]), ensemble_of(copy.deepcopy(alone))
    start = copy.deepcopy(alone[1].state_dict())
    for model in (together, *alone):
        steps(model, data, 5)
    for model, member in zip(alone, together.members(), strict=True):
        for key, value in model.state_dict().items():
            assert torch.allclose(member.state_dict()[key], value, rtol=1e-6, atol=1e-9), key
    assert not all(torch.equal(start[key], value) for key, value in alone[1].state_dict().items())


@pytest.mark.parametrize("activation", list(ACTIVATIONS))
@pytest.mark.parametrize("name", ["bb2", "pe2"])
def test_gradients_by_hand_are_those_of_autograd(make, batch, name, activation):
    network = {"width": 12, "depth": 3, "activation": activation, "odd": name == "pe2"}
    together = FrictionEnsemble(members(make, name, network=network))
    data = batch(together.members()[0])
    tables = [{k: v.detach() for k, v in together._table(kind).items()} for kind in ("weight", "buffer", "number")]
    (by_hand, losses), (found, same) = together._one_by_one(*tables, data), together._together(*tables, data)
    for key, value in found.items():
        assert torch.allclose(by_hand[key], value, rtol=1e-4, atol=1e-5 * float(value.abs().max()) + 1e-9), key
    assert torch.allclose(losses["loss"], same["loss"], rtol=1e-5)


def test_the_number_of_threads_does_not_change_the_gradients(make, batch):
    together = FrictionEnsemble(members(make, "pe2", 5))
    data, before, found = batch(together.members()[0]), torch.get_num_threads(), []
    try:
        for threads in (1, 3):
            torch.set_num_threads(threads)
            together.backward(together.training_step(data, 0))
            found.append([value.grad.clone() for value in together.parameters()])
    finally:
        torch.set_num_threads(before)
    assert all(torch.equal(a, b) for a, b in zip(*found, strict=True))


def test_its_prediction_is_the_mean_of_its_members_with_their_spread(make, data):
    alone = members(make, "pe1")
    together = FrictionEnsemble(copy.deepcopy(alone))
    trial = data.select("held_out")[0]
    forces = torch.stack([torch.as_tensor(model.predict_trial(trial)["force"]) for model in alone])
    found = together.predict_trial(trial)
    assert found["force"] == pytest.approx(forces.mean(0).numpy(), rel=1e-4, abs=1e-5)
    assert found["force_std"] == pytest.approx(forces.std(0).numpy(), rel=1e-3, abs=1e-5)
    values = [model.physical()["mu_c"] for model in alone]
    assert together.physical_of_members()["mu_c"] == pytest.approx(values)


def test_each_member_keeps_its_own_best_and_stops_by_itself(make):
    together = FrictionEnsemble(members(make, "bb1"))
    (name, weight) = next(iter(together.named_parameters()))
    for losses, value in (((3.0, 3.0, 3.0), 1.0), ((2.0, 4.0, 4.0), 2.0), ((5.0, 2.0, 5.0), 3.0)):
        with torch.no_grad():
            weight.fill_(value)
        going_on = together.keep_best(torch.tensor(losses), patience=2)
    assert going_on and together.keep_best(torch.tensor([9.0, 9.0, 0.0]), patience=2)  # the third had stopped: too late
    together.restore_best()
    assert [row.flatten()[0].item() for row in dict(together.named_parameters())[name]] == [2.0, 3.0, 1.0]
    assert not together.keep_best(torch.tensor([9.0, 9.0, 9.0]), patience=2)


def test_an_optimizer_that_follows_one_loss_is_refused(make):
    with pytest.raises(UserError, match="adam_lbfgs; allowed: adam, adam_onecycle"):
        FrictionEnsemble(members(make, "bb1", optimizer="adam_lbfgs"))
