"""A small noisy recording of the pendulum-on-a-box, and every variant of conf/model built for it."""

from __future__ import annotations

import copy
from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from omegaconf import OmegaConf

from frictionpinn.data.contact import contact_trials
from frictionpinn.data.module import TrajectoryData
from frictionpinn.data.noise import GaussianNoise
from frictionpinn.data.simulated import simulate_recording
from frictionpinn.data.split import split_trials
from frictionpinn.models import FrictionModel
from frictionpinn.numerics.kalman import KalmanFilter, KalmanSmoother
from frictionpinn.physics import SYSTEMS
from frictionpinn.workflow.experiment import build_model

CONF = Path(__file__).resolve().parents[2] / "conf"
TRUTH = {"sigma_0": 1e5, "sigma_1": 316.23, "sigma_2": 0.4, "mu_c": 0.3, "mu_s": 0.6, "v_s": 1e-3}


def load(group: str, name: str) -> dict:
    """One option of a config group as plain values."""
    return OmegaConf.to_container(OmegaConf.load(CONF / group / f"{name}.yaml"))  # type: ignore[return-value]


def merge(config: dict, changes: dict) -> dict:
    """A copy of ``config`` with nested ``changes``."""
    config = copy.deepcopy(config)
    for key, value in changes.items():
        config[key] = merge(config.get(key) or {}, value) if isinstance(value, dict) else value
    return config


@pytest.fixture(scope="session")
def data() -> TrajectoryData:
    """Two swings of 1 s at 200 Hz with 5 % noise; the second is held out."""
    system = SYSTEMS["pob"]()
    swings = [{"duration": 1.0, "theta": f"{angle}*deg*sin(2*pi*t)"} for angle in (50, 60)]
    clean = simulate_recording(system, "lugre", TRUTH, swings, 200.0)
    noisy = GaussianNoise(level=0.05)(clean, 0)
    splits = split_trials(clean.names, None)
    return TrajectoryData(noisy, contact_trials(noisy, system, KalmanSmoother(), KalmanFilter(), ["1"]), splits)


@pytest.fixture(scope="session")
def make(data: TrajectoryData) -> Callable[..., FrictionModel]:
    """Build a variant: ``make("pe2", odd=True, bristle="steady", friction={"tie_sigma1": True}, ...)``."""

    def build(name: str, *, odd: bool = True, optimizer: str = "adam", friction=None, law="lugre", **changes):
        torch.manual_seed(1)
        config = merge(load("model", name), {"network": {"odd": odd, "width": 16, "depth": 2}} | changes)
        cfg = {
            "model": config,
            "friction": merge(load("friction", law), friction or {}),
            "optimizer": load("optimizer", optimizer),
            "system": {"name": "pob"},
            "smoothing": load("smoothing", "kalman"),
        }
        model = build_model(cfg, SYSTEMS["pob"](), data)
        data.prepare_for(model)
        return model

    return build


@pytest.fixture
def started(make):
    """A variant with a state."""
    return lambda name, **changes: make(name, memory="state", **changes)


@pytest.fixture
def stateful(started, monkeypatch):
    """The same without the search for a start, which takes seconds."""
    monkeypatch.setattr("frictionpinn.models.state.find_start", lambda model, batch: None)
    monkeypatch.setattr("frictionpinn.models.black_box_start.start_as_law", lambda model, batch: None)
    return started


@pytest.fixture
def batch(data: TrajectoryData) -> Callable[[FrictionModel], dict[str, torch.Tensor]]:
    """The full training batch of a model."""

    def full(model: FrictionModel) -> dict[str, torch.Tensor]:
        data.prepare_for(model)
        return data.train_dataloader().batch

    return full
