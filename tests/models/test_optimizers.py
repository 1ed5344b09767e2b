"""Optimizers: each learns, schedules do what they say, a saved state continues where it stopped."""

from __future__ import annotations

import copy
import itertools
from pathlib import Path

import pytest
import torch
from omegaconf import OmegaConf

from frictionpinn.errors import UserError
from frictionpinn.models.optimizers import OPTIMIZERS, AdamThenLBFGS, build_optimizer, one_cycle

FILES = sorted((Path(__file__).resolve().parents[2] / "conf" / "optimizer").glob("*.yaml"))
STEPS = 60


def unpack(built):
    """(optimizer, schedule or None, whether the schedule moves each step)."""
    if isinstance(built, dict):
        return built["optimizer"], built["lr_scheduler"]["scheduler"], built["lr_scheduler"]["interval"] == "step"
    return built, None, False


def train(model, batch, config, steps):
    """Train by hand; the losses of every step."""
    physical = [p for name, p in model.named_parameters() if name.startswith("law_parameters")]
    weights = [p for name, p in model.named_parameters() if not name.startswith("law_parameters")]
    optimizer, schedule, each = unpack(build_optimizer(config, weights, physical, steps))
    losses = []

    def closure():
        optimizer.zero_grad()
        loss = model.losses(batch)["loss"]
        loss.backward()
        losses.append(float(loss.detach()))
        return loss

    for _ in range(steps):
        optimizer.step(closure)
        if schedule is not None:
            schedule.step() if each else schedule.step(losses[-1])
    return losses, optimizer


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
@pytest.mark.parametrize("name", ["bb1", "pe2"])
def test_it_reduces_the_loss(make, batch, path, name):
    model = make(name)
    config = OmegaConf.to_container(OmegaConf.load(path)) | {"lr": 3e-3}
    start = {k: p.clone() for k, p in model.named_parameters()}
    losses, _ = train(model, batch(model), config, STEPS)
    assert losses[-1] < 0.7 * losses[0]
    still = [k for k, p in model.named_parameters() if torch.equal(start[k], p)]
    assert len(still) <= 1, still  # an odd network has no use for its last bias


def test_every_optimizer_has_its_file():
    assert {OmegaConf.load(path).name for path in FILES} == set(OPTIMIZERS) == {path.stem for path in FILES}


def bowl():
    """Two parameters, a loss with a curved valley, and an optimizer that changes method after 5 steps."""
    p = torch.nn.Parameter(torch.tensor([-1.0, 1.5]))
    optimizer = AdamThenLBFGS([{"params": [p], "lr": 0.05}], adam_steps=5, history_size=4, max_iter=2)

    def step():
        def closure():
            optimizer.zero_grad()
            loss = (1 - p[0]) ** 2 + 10 * (p[1] - p[0] ** 2) ** 2
            loss.backward()
            return loss

        return float(optimizer.step(closure).detach())

    return p, optimizer, step


@pytest.mark.parametrize("stop", [2, 5, 8])
def test_adam_then_lbfgs_continues_from_its_saved_state(stop):
    p, optimizer, step = bowl()
    for _ in range(stop):
        step()
    q, other, other_step = bowl()
    other.load_state_dict(copy.deepcopy(optimizer.state_dict()))
    with torch.no_grad():
        q.copy_(p)
    for _ in range(6):
        assert step() == pytest.approx(other_step(), rel=1e-6, abs=1e-12)
    torch.testing.assert_close(p, q)
    assert other.count == stop + 6


def test_lbfgs_takes_over_after_its_share_of_adam():
    _, optimizer, step = bowl()
    for _ in range(5):
        step()
    assert optimizer.active is optimizer.adam
    assert optimizer.adam.state and not optimizer.state[optimizer._params[0]]
    losses = [step() for _ in range(60)]
    assert optimizer.state[optimizer._params[0]]["n_iter"] > 0
    assert optimizer.active is optimizer
    assert losses[-1] < 1e-3 * losses[0]


def test_one_cycle_rises_then_falls_and_stays_above_zero():
    shares = [one_cycle(step, 100, 0.3) for step in range(101)]
    assert max(shares) == shares[30] == pytest.approx(1.0)
    assert shares[0] == pytest.approx(0.04) and shares[100] == pytest.approx(1e-4)
    assert all(a <= b for a, b in itertools.pairwise(shares[:31]))
    assert all(a >= b for a, b in itertools.pairwise(shares[30:]))
    assert one_cycle(150, 100, 0.3) == pytest.approx(1e-4) and one_cycle(3, 3, 0.0) > 0


def test_plateau_halves_the_step_down_to_its_least():
    weight = torch.nn.Parameter(torch.zeros(1))
    config = {"name": "adam_plateau", "lr": 1e-3, "factor": 0.5, "patience": 1, "min_lr": 1e-5}
    optimizer, schedule, _ = unpack(build_optimizer(config, [weight], [], 100))
    rates = []
    for _ in range(40):
        schedule.step(1.0)
        rates.append(optimizer.param_groups[0]["lr"])
    assert 5e-4 in rates and rates[-1] == pytest.approx(1e-5)


def test_physical_parameters_have_their_own_step_size(make):
    model = make("pe1", optimizer="adam")
    groups = unpack(model.configure_optimizers())[0].param_groups
    assert [len(groups[1]["params"]), groups[1]["lr"]] == [6, 1e-2] and groups[0]["lr"] == 1e-3
    config = {"name": "adam", "lr": 1e-4, "lr_physical": None}
    same = build_optimizer(config, [torch.nn.Parameter(torch.zeros(1))], [torch.nn.Parameter(torch.zeros(1))], 10)
    assert [group["lr"] for group in same.param_groups] == [1e-4, 1e-4]


@pytest.mark.parametrize(
    ("config", "message"),
    [
        ({"name": "adamm", "lr": 1e-3}, "optimizer is 'adamm'.*did you mean 'adam'"),
        ({"name": "adam", "lr": 0.0}, "step size must be positive: optimizer.lr is 0.0"),
        ({"name": "adam", "lr": 1e-3, "lr_physical": -1.0}, "optimizer.lr_physical is -1.0"),
    ],
)
def test_impossible_settings_are_named(config, message):
    with pytest.raises(UserError, match=message):
        build_optimizer(config, [torch.nn.Parameter(torch.zeros(1))], [], 10)
