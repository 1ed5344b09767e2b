"""A saved friction model is used at once: in training as known forces and loads, from the command line too."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from commands import call

from frictionpinn.errors import UserError
from frictionpinn.export.augmented import folded
from frictionpinn.numerics.torch_functions import contact_signals, motion_feedback
from frictionpinn.physics import SYSTEMS

ROOT = Path(__file__).resolve().parents[2]
LAW = {"sigma_0": 1e5, "sigma_1": 316.0, "sigma_2": 0.4, "mu_c": 0.3, "mu_s": 0.5, "v_s": 2e-3, "alpha": 2.0}
OWN = {"m_b": 0.5, "m_L": 1.0, "d": 0.25, "J_L": 0.042, "g": 9.81}


def saved(folder: Path, effects: dict[str, dict[str, float]], values: dict[str, float] = LAW) -> Path:
    path = folder / "augmented.yaml"
    system = {"name": "pob", "equations": "lagrange", "imposed": False, "parameters": OWN}
    path.write_text(yaml.safe_dump({"name": "lugre", "system": system, "values": values, "effects": effects}))
    return path


def signals(n=50):
    rng = np.random.default_rng(0)
    return {name: rng.normal(size=n) for name in ("x", "v", "a", "theta", "omega", "alpha")}


def test_forces_leave_the_friction_of_the_law_and_loads_change_what_it_sees(tmp_path):
    effects = {"constant_force": {"constant_force": 0.2}, "drag": {"drag": 0.5}, "adhesion": {"adhesion": 1.5}}
    system, values = folded(saved(tmp_path, effects))
    given = signals()
    made, plain = contact_signals(system, given), contact_signals(SYSTEMS["pob"](**OWN), given)
    extra = 0.2 + 0.5 * given["v"] * np.abs(given["v"])
    assert made["friction_force"] == pytest.approx(plain["friction_force"] - extra)
    assert made["normal_force"] == pytest.approx(plain["normal_force"] + 1.5)
    assert values == LAW


@pytest.mark.parametrize("name", ["pob", "pendulum", "joint", "drive"])
def test_what_moves_a_contact_without_friction_follows_where_it_goes_by_the_known_slopes(tmp_path, name):
    kind = SYSTEMS[name](**({"W_cos": 2.0} if name == "joint" else {}))
    path = saved(tmp_path, {"drag": {"drag": 0.5}})
    content = yaml.safe_load(path.read_text())
    content["system"] |= {"name": name, "driven": list(kind.driven), "parameters": kind.values}
    path.write_text(yaml.safe_dump(content))
    system, _ = folded(path)
    (c,) = system.free
    rng, names = np.random.default_rng(0), system.signal_units
    given = {key: rng.normal(size=50) for key in names if key != "t"}
    step, slopes = 1e-6, motion_feedback(system, given)
    for signal, slope in zip(c.signals[:2], slopes.T, strict=True):
        ends = [contact_signals(system, given | {signal: given[signal] + way * step}) for way in (1, -1)]
        difference = (ends[0]["a_frictionless"] - ends[1]["a_frictionless"]) / (2 * step)
        assert slope == pytest.approx(difference, rel=1e-5, abs=1e-6)
    assert slopes[:, 1].any() and slopes[:, 0].any() == (name in ("pendulum", "joint"))


def test_a_payload_takes_part_in_the_inertia(tmp_path):
    system, _ = folded(saved(tmp_path, {"payload": {"payload_m_b": 0.1, "payload_m_L": 0.0}}))
    given = signals()
    heavy = contact_signals(SYSTEMS["pob"](**(OWN | {"m_b": 0.6})), given)
    made = contact_signals(system, given)
    for name in ("friction_force", "normal_force", "a_frictionless"):
        assert made[name] == pytest.approx(heavy[name])


@pytest.mark.parametrize("effect", [{"sensor_delay": {"sensor_delay_x": 0.01}}, {"drift": {"drift": 0.1}},
                                    {"dwell": {"dwell": 0.1}}])  # fmt: skip
def test_what_is_no_force_of_the_moment_is_refused_by_name(tmp_path, effect):
    with pytest.raises(UserError, match=f"effect {next(iter(effect))} cannot be folded"):
        folded(saved(tmp_path, effect))


def test_training_takes_a_saved_model_as_friction(tmp_path):
    path = saved(tmp_path, {"asymmetry": {"asymmetry": 0.04}}, LAW | {"sigma_2": 4e-10})  # next to none was found
    options = ["trainer.max_epochs=2", "trainer.threads=1", "data.rate_hz=100", "hydra.run.dir=run"]
    done = call("train.py", "model=pe1", f"friction={path.name}", *options, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    result = json.loads((tmp_path / "run" / "result.json").read_text())
    assert result["config"]["system"]["augmented"] == str(path)
    assert result["parameters"]["mu_s"]["start"] == pytest.approx(0.5)
    assert result["parameters"]["sigma_2"]["start"] > 1e-3  # from the scale of the data
    refused = call("train.py", "model=pe1", f"friction={path.name}", "system=drive", cwd=tmp_path)
    assert refused.returncode == 2 and "friction model of another system" in refused.stderr
