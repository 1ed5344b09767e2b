"""Ways to train as a user does: the configuration composed and trained in-process, or train.py in its own process."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from commands import call
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf

from frictionpinn.data.noise import GaussianNoise
from frictionpinn.data.simulated import simulate_recording
from frictionpinn.physics import SYSTEMS
from frictionpinn.workflow import cli
from frictionpinn.workflow.train import train

ROOT = Path(__file__).resolve().parents[2]
TRUTH = {"sigma_0": 1e5, "sigma_1": 316.23, "sigma_2": 0.4, "mu_c": 0.3, "mu_s": 0.6, "v_s": 1e-3}
SMALL = ["trainer.threads=1", "trainer.progress_bar=false", "model.network.width=16", "trainer.accelerator=cpu"]
SHORT = ["data.trials=[{duration: 1.0, theta: '50*deg*sin(2*pi*t)'}, {duration: 0.5, theta: '60*deg*sin(2*pi*t)'}]"]
COARSE = ["data.rate_hz=100"]
SHORT += ["data.held_out=[2]", "data.rate_hz=200"]


@pytest.fixture(scope="session")
def configure() -> Callable[..., dict]:
    """Compose train.yaml with overrides: ``configure("model=bb1", "seed=1")``; plain values."""

    def build(*overrides: str) -> dict:
        with initialize_config_dir(str(ROOT / "conf"), version_base="1.3"):
            return OmegaConf.to_container(compose("train", overrides=list(overrides)), resolve=True)  # type: ignore

    return build


@pytest.fixture(scope="session")
def quick(configure) -> Callable[..., dict]:
    """Train a small network in-process: ``quick(folder, "model=pe2")``; two short trials unless data= is given."""

    def run(folder: Path, *overrides: str, epochs: int = 3) -> dict:
        short = [] if any(item.startswith("data=") for item in overrides) else SHORT
        return train(configure(*SMALL, f"trainer.max_epochs={epochs}", *short, *overrides), folder)

    return run


@pytest.fixture
def check(configure) -> Callable[..., None]:
    """What train.py does before it trains, then the training; user errors are raised."""

    def run(folder: Path, *overrides: str) -> None:
        cli.check_command_line(ROOT / "conf", "train", list(overrides))
        coarse = [] if any(item.startswith(("data=", "data.rate_hz", "data.trials")) for item in overrides) else COARSE
        train(configure(*SMALL, "trainer.max_epochs=1", *coarse, *overrides), folder)

    return run


@pytest.fixture(scope="session")
def command() -> Callable[..., subprocess.CompletedProcess]:
    """Call ``python train.py ...`` in a folder, in its own process."""

    def run(folder: Path, *overrides: str, **variables: str) -> subprocess.CompletedProcess:
        return call("train.py", *overrides, cwd=folder, **variables)

    return run


@pytest.fixture(scope="session")
def measured_table() -> pd.DataFrame:
    """A recording of a pendulum-on-a-box: trial, t, x, v, a, theta, omega, alpha in SI units, 1 % noise."""
    swings = [{"duration": 0.6, "theta": f"{angle}*deg*sin(2*pi*t)"} for angle in (50, 60)]
    clean = simulate_recording(SYSTEMS["pob"](), "lugre", TRUTH, swings, 200.0)
    parts = []
    for trial in GaussianNoise(level=0.01)(clean, 3).trials:
        names = [name for name in ("x", "v", "a", "theta", "omega", "alpha") if name in trial.signals]
        columns = {name: trial.signals[name] for name in names}
        parts.append(pd.DataFrame({"trial": int(trial.name), "t": trial.t, **columns}))
    return pd.concat(parts, ignore_index=True).astype(dict.fromkeys(["t"], np.float64))


@pytest.fixture
def csv(measured_table: pd.DataFrame, tmp_path: Path) -> Callable[..., Path]:
    """Write the table, changed by a function, as run.csv of the test's folder."""

    def write(change: Callable[[pd.DataFrame], pd.DataFrame | None] = lambda table: table) -> Path:
        table = measured_table.copy()
        changed = change(table)
        path = tmp_path / "run.csv"
        (table if changed is None else changed).to_csv(path, index=False)
        return path

    return write
