"""Two small trained runs of the pendulum on a box, exported by the command as a user does."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from commands import call
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf

from frictionpinn.data.contact import ContactTrial
from frictionpinn.export.portable import PortableModel
from frictionpinn.models import FrictionModel
from frictionpinn.numerics.paths import InputPath
from frictionpinn.physics import System
from frictionpinn.physics.mechanism import Mechanism
from frictionpinn.workflow.experiment import build_data
from frictionpinn.workflow.load import load_run
from frictionpinn.workflow.train import train

ROOT = Path(__file__).resolve().parents[2]
OPTIONS = ["trainer.threads=1", "trainer.progress_bar=false", "trainer.accelerator=cpu", "trainer.max_epochs=150"]
OPTIONS += ["model.network.width=16", "data.rate_hz=200", "data.held_out=[2]"]
OPTIONS += ["data.trials=[{duration: 1.0, theta: '50*deg*sin(2*pi*t)'}, {duration: 0.5, theta: '60*deg*sin(2*pi*t)'}]"]


@dataclass(frozen=True)
class Exported:
    """A run, its model, and where its exports are."""

    folder: Path
    told: str
    system: System
    model: FrictionModel
    portable: PortableModel
    trial: ContactTrial

    def file(self, form: str, name: str) -> Path:
        return self.folder / "export" / form / name

    def force_error(self, force: np.ndarray, own: np.ndarray) -> float:
        """Root mean square difference over the force's root mean square."""
        return float(np.sqrt(np.mean((force - own) ** 2) / np.mean(own**2)))


@pytest.fixture(scope="session")
def exported(tmp_path_factory) -> Callable[[str], Exported]:
    """``exported("pe2")``: trained and exported once."""
    made: dict[str, Exported] = {}

    def make(name: str) -> Exported:
        if name not in made:
            made[name] = _make(name, tmp_path_factory.mktemp(name))
        return made[name]

    return make


def _make(name: str, folder: Path) -> Exported:
    with initialize_config_dir(str(ROOT / "conf"), version_base="1.3"):
        cfg = OmegaConf.to_container(compose("train", overrides=[f"model={name}", *OPTIONS]), resolve=True)
    train(cfg, folder)  # type: ignore[arg-type]
    forms = [form for form, package in (("onnx", "onnxruntime"), ("mujoco", "mujoco"), ("c", "")) if _has(package)]
    told = call("evaluate.py", f"run={folder}", f"export=[{','.join(forms)}]")
    assert told.returncode == 0, told.stderr
    trained, system, model = load_run(folder)
    portable = PortableModel.of(model, system, 1 / 200)
    return Exported(folder, told.stdout, system, model, portable, build_data(trained, system).select("held_out")[0])


def _has(package: str) -> bool:
    import importlib.util

    return not package or importlib.util.find_spec(package) is not None


@pytest.fixture(scope="session")
def swing() -> Callable[..., InputPath]:
    """A swing of 0.5 s that no training saw, at the samples of the training."""
    from frictionpinn.data.excitation import parse_expression
    from frictionpinn.physics import LAWS

    def path(system: System, theta: str = "45*deg*sin(2*pi*t)") -> InputPath:
        expression = parse_expression(theta, "theta", {})
        mechanism = Mechanism(system, LAWS["coulomb"]())
        return InputPath.from_expressions(mechanism, np.arange(101) / 200, {"theta": expression})

    return path
