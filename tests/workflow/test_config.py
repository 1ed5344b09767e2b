"""Every option of every group composes and builds what it names; a new file in conf/ is tested by itself."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
import torch

from frictionpinn.data.public import DATASETS
from frictionpinn.errors import UserError
from frictionpinn.models import MODELS
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.workflow.build import NOISE, SMOOTHING, build_system, check_pairing
from frictionpinn.workflow.experiment import build_data, build_model
from frictionpinn.workflow.train import accelerator_of, build_trainer

CONF = Path(__file__).resolve().parents[2] / "conf"
MEASURED = Path(os.environ.get("FRICTIONPINN_DATA", "missing"))
FEW = ["data.rate_hz=100"]


ROBOT = "robot"  # in a file: it is no system with energies


def options(group: str) -> list[str]:
    return sorted(path.stem for path in (CONF / group).glob("*.yaml"))


def build(cfg: dict):
    """Everything that a training needs, without the training."""
    check_pairing(cfg)
    system = build_system(cfg["system"])
    data = build_data(cfg, system)
    model = build_model(cfg, system, data)
    data.prepare_for(model)
    return data, model


def learns(data, model) -> bool:
    """Whether a step can be made: a finite loss with finite gradients."""
    loss = model.losses(data.train_dataloader().batch)["loss"]
    loss.backward()
    return bool(torch.isfinite(loss)) and all(torch.isfinite(p.grad).all() for p in model.parameters())


def test_every_table_of_the_package_has_its_files():
    assert set(options("system")) == {*SYSTEMS, ROBOT} and set(options("friction")) == set(LAWS)
    assert set(options("noise")) == set(NOISE) and set(options("smoothing")) == set(SMOOTHING)
    assert set(options("model")) == set(MODELS)
    assert set(options("data")) == {"simulated", "csv", *DATASETS}


@pytest.mark.parametrize("name", sorted(SYSTEMS))
def test_system_is_simulated_and_learned_from(configure, name):
    data, model = build(configure(f"system={name}", "model=pe2", *FEW))
    assert data.splits["held_out"] and len(data.splits["train"]) >= 2
    assert learns(data, model)


@pytest.mark.parametrize("name", options("friction"))
def test_friction_law_is_simulated_on_a_system_and_estimated_where_it_has_a_bristle(configure, name):
    values = {par.name: par.value for par in LAWS[name].parameters}
    typical = {"sigma_0": 1e4, "sigma_1": 100.0, "sigma_2": 0.4, "mu_c": 0.3, "mu_s": 0.5, "v_s": 0.01, "v_t": 0.01}
    truth = {key: typical.get(key, value) for key, value in values.items()}
    simulate = ["system=drive", f"data.friction={name}", f"data.truth={{{_inline(truth)}}}", *FEW]
    black_box = build(configure("model=bb1", f"friction={name}", *simulate))
    assert learns(*black_box)
    if LAWS[name].memory:
        data, model = build(configure("model=pe1", f"friction={name}", *simulate))
        assert learns(data, model) and set(model.physical()) == set(values)
    else:
        with pytest.raises(UserError, match="needs a friction law with a bristle state"):
            build(configure("model=pe1", f"friction={name}", *simulate))


def _inline(values: dict[str, float]) -> str:
    return ", ".join(f"{key}: {value}" for key, value in values.items())


@pytest.mark.parametrize(
    ("group", "name"), [(group, name) for group in ("noise", "smoothing", "model") for name in options(group)]
)
def test_option_builds_a_model_that_can_learn(configure, group, name):
    assert learns(*build(configure(f"{group}={name}", *FEW)))


@pytest.mark.parametrize("name", sorted({*options("data")} - {"ur10e"}))  # a robot's: tests/robots
def test_data_are_read_and_split_by_trial(configure, name, csv):
    overrides = [f"data={name}"]
    if name == "csv":
        overrides.append(f"data.path={csv()}")
    if name in DATASETS:
        if not (MEASURED / DATASETS[name].folder).is_dir():
            pytest.skip(f"no recording {name} in {MEASURED}: set FRICTIONPINN_DATA to the folder of the public sets")
        system = {"emps": "drive", "brfd": "damper", "multiarm_pendulum": "pendulum"}[name]
        overrides.append(f"system={system}")
    data, model = build(configure("model=bb1", *overrides))
    assert data.splits["held_out"] and len(data.recording.checksum) == 64
    assert learns(data, model)


@pytest.mark.parametrize("name", options("optimizer"))
def test_optimizer_is_what_the_model_gives_to_the_trainer(configure, quick, tmp_path, name):
    result = quick(tmp_path, "model=pe1", f"optimizer={name}")
    assert result["training"]["epochs"] == 3 and result["config"]["optimizer"]["name"] == name


@pytest.mark.parametrize("name", options("trainer"))
def test_trainer_is_built(configure, name, tmp_path):
    trainer = build_trainer(configure(f"trainer={name}", "trainer.accelerator=cpu"), tmp_path, validation=False)
    assert trainer.max_epochs >= 1 and trainer.checkpoint_callback is not None


def test_network_with_a_state_trains_on_the_cpu_unless_a_gpu_is_asked_for(configure):
    assert accelerator_of(configure("experiment=memory")) == "cpu"
    assert accelerator_of(configure("experiment=memory", "trainer.accelerator=gpu")) == "gpu"
    assert accelerator_of(configure()) == "auto"


@pytest.mark.skipif(not torch.cuda.is_available(), reason="this machine has no GPU")
@pytest.mark.parametrize("experiment", [[], ["experiment=memory"]])
@pytest.mark.parametrize("model", options("model"))
def test_training_on_a_gpu_is_that_on_the_cpu(configure, quick, tmp_path, model, experiment):
    losses = []
    for accelerator in ("cpu", "gpu"):
        given = [f"model={model}", *experiment, f"trainer.accelerator={accelerator}"]
        losses.append(quick(tmp_path / accelerator, *given)["training"]["loss"]["loss"])
    assert losses[1] == pytest.approx(losses[0], rel=1e-4)


@pytest.mark.parametrize("name", sorted({*options("experiment")} - {"ur10e"}))  # a robot's: tests/robots
@pytest.mark.parametrize("model", options("model"))
def test_experiment_composes_with_every_model(configure, name, model):
    cfg = configure(f"experiment={name}", f"model={model}", *FEW)
    assert cfg["model"]["name"] == model
    assert learns(*build(cfg))


@pytest.mark.parametrize("model", options("model"))
def test_paper_preset_is_the_published_protocol(configure, model):
    cfg = configure("experiment=paper", f"model={model}")
    network = cfg["model"]["network"]
    assert (network["width"], network["depth"], network["activation"], network["odd"]) == (128, 4, "relu", False)
    assert cfg["optimizer"]["name"] == "adam" and cfg["optimizer"]["lr"] == 1e-4
    assert cfg["optimizer"]["lr_physical"] in (None, 1e-4)
    assert cfg["trainer"]["max_epochs"] == 10_000 and not cfg["trainer"]["early_stopping"]
    assert cfg["noise"] == {"name": "gaussian", "level": 0.05} and cfg["smoothing"]["name"] == "none"
    assert cfg["data"]["rate_hz"] == 400 and cfg["data"]["steps_per_epoch"] == 1
    assert set(map(str, cfg["model"]["windows"].values())) == {"[[1, 0]]"}  # one sample, no memory
    assert cfg["model"]["loss"]["weight"] == 1e5 and cfg["model"]["loss"]["force"] == "plain"
    wide = configure("experiment=paper", f"model={model}", "model.network.width=512")
    assert wide["model"]["network"]["width"] == 512


def test_paper_preset_trains_on_all_training_samples_at_once(configure):
    data, model = build(configure("experiment=paper", "model=pe2"))
    loader = data.train_dataloader()
    assert len(loader) == 1
    assert loader.batch["x"].shape == (4000, 3) and model.features.length == 1
    layers = [layer for layer in model.network.layers if isinstance(layer, torch.nn.Linear)]
    assert [layer.out_features for layer in layers] == [128, 128, 128, 128, 1]
    assert not any(isinstance(layer, torch.nn.SiLU) for layer in model.network.layers)


def test_paper_plateau_halves_from_1e_3_down_to_1e_5(configure):
    optimizer = configure("experiment=paper_plateau")["optimizer"]
    assert optimizer["name"] == "adam_plateau"
    assert (optimizer["lr"], optimizer["factor"], optimizer["min_lr"]) == (1e-3, 0.5, 1e-5)
    assert configure("experiment=paper_plateau")["model"]["network"]["depth"] == 4


def test_default_recording_is_the_one_of_the_paper(configure):
    data, _ = build(configure("model=bb1"))
    assert sum(len(trial) for trial in data.by_name.values()) == 5800
    assert data.splits == {"train": ["1", "2", "3", "4", "5"], "validation": [], "held_out": ["6"]}
