"""A network with memory in C, ONNX and MuJoCo gives what it gives here."""

from __future__ import annotations

import ctypes
import json
import shutil
import subprocess
import sys

import numpy as np
import pytest

from frictionpinn.evaluate.in_motion import simulate_in_motion
from frictionpinn.evaluate.mjcf import pob_mjcf
from frictionpinn.export.portable_state import PortableState
from frictionpinn.export.state_c import write_state_c
from frictionpinn.models.elements import StateFriction
from frictionpinn.physics import SYSTEMS
from frictionpinn.workflow.experiment import build_data
from frictionpinn.workflow.export import export
from frictionpinn.workflow.load import load_run
from frictionpinn.workflow.options import composed
from frictionpinn.workflow.train import train

OPTIONS = ["experiment=memory", "trainer.threads=1", "trainer.progress_bar=false", "trainer.accelerator=cpu"]
OPTIONS += ["trainer.max_epochs=40", "model.network.width=8", "data.rate_hz=200", "data.held_out=[2]"]
OPTIONS += ["data.trials=[{duration: 1.0, theta: '50*deg*sin(2*pi*t)'}, {duration: 0.5, theta: '60*deg*sin(2*pi*t)'}]"]


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """``trained("bb2")``: folder of a short training, made once."""
    made = {}

    def make(name: str):
        if name not in made:
            folder = made[name] = tmp_path_factory.mktemp(name)
            train(composed("train", [f"model={name}", *OPTIONS]), folder)
        return made[name]

    return make


@pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler, cc")
def test_force_and_rates_in_c_are_those_of_the_model(tmp_path):
    rng = np.random.default_rng(0)
    tables = 1e-3 * np.exp(rng.standard_normal((3, 17, 3)))
    rows = np.array([[500.0, 300.0], [50.0, 4.0], [0.0, 0.002], [1.0, 2.3]])
    model = StateFriction(tables, np.array([0.01, -4.0, 0.5, 8.0, 2.0]), rows)
    portable = PortableState("bb2", model, 1e-3, 1.0, 1e-3, 0.05, 4, 1.0, None, {}, {}, SYSTEMS["pob"]())
    assert write_state_c(tmp_path, portable) == ["friction.h", "friction.c"]
    flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-O2", "-shared", "-fPIC", "-o", "friction.so"]
    done = subprocess.run(
        ["cc", *flags, "friction.c", "-lm"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    library, pair = ctypes.CDLL(str(tmp_path / "friction.so")), ctypes.c_double * 2
    for call, kinds in ((library.friction_rates, [ctypes.c_double] * 2 + [pair, pair]),
                        (library.friction_step, [pair] + [ctypes.c_double] * 3)):  # fmt: skip
        call.restype, call.argtypes = ctypes.c_double, kinds
    z, own = np.zeros(2), pair(0.0, 0.0)
    for _ in range(300):
        v, N, rate = float(rng.normal(0, 0.3)), float(rng.uniform(6, 14)), pair()
        expected = model.rates(v, N, np.array(list(own)))
        assert library.friction_rates(v, N, own, rate) == pytest.approx(expected[0], rel=1e-9, abs=1e-12)
        np.testing.assert_allclose(list(rate), expected[1:], rtol=1e-9, atol=1e-12)
        force = library.friction_step(own, v, N, 1e-3)
        z = np.array(list(own))
        assert force == pytest.approx(model.rates(v, N, z)[0], rel=1e-9, abs=1e-12)
    assert np.isnan(library.friction_step(own, np.nan, 10.0, 1e-3)) and list(own) == list(z)
    assert library.friction_step(own, 0.1, np.nan, 1e-3) != 0.0 and np.all(np.isfinite(list(own)))


@pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler, cc")
def test_a_contact_without_a_load_carries_nothing_in_c_and_slides_on_when_it_is_back(tmp_path):
    """Two bristles without a gap: what is left at N = 0 is the viscous rest."""
    rng = np.random.default_rng(0)
    tables, rows = 1e-3 * np.exp(rng.standard_normal((3, 17, 3))), np.array([[500, 300], [50, 4], [0, 0], [1, 2.3]])
    model = StateFriction(tables, np.array([0.01, -4.0, 0.5, 8.0, 2.0]), rows.astype(float))
    portable = PortableState("bb2", model, 1e-3, 1.0, 1e-3, 0.05, 4, 1.0, None, {}, {}, SYSTEMS["pob"]())
    write_state_c(tmp_path, portable)
    flags = ["-std=c99", "-O2", "-shared", "-fPIC", "-o", "friction.so", "friction.c", "-lm"]
    subprocess.run(["cc", *flags], cwd=tmp_path, check=True)
    step, pair = ctypes.CDLL(str(tmp_path / "friction.so")).friction_step, ctypes.c_double * 2
    step.restype, step.argtypes = ctypes.c_double, [pair] + [ctypes.c_double] * 3
    z = pair(0.0, 0.0)
    before = [step(z, 0.05, 10.0, 1e-3) for _ in range(2000)][-1]
    lifted = [step(z, 0.05, 0.0, 1e-3) for _ in range(3)]
    assert all(0.0 < force < 0.01 * before for force in lifted) and list(z) == [0.0, 0.0]
    assert [step(z, 0.05, 10.0, 1e-3) for _ in range(2000)][-1] == pytest.approx(before)
    assert np.abs(z).max() > 0


@pytest.mark.parametrize("name", ["bb2", "pe1"])
def test_the_onnx_graph_stepped_along_a_trial_gives_the_models_force(trained, name):
    pytest.importorskip("onnx", reason="needs the extra: pip install -e '.[export]'")
    onnxruntime = pytest.importorskip("onnxruntime", reason="needs the extra: pip install -e '.[export]'")
    folder = trained(name)
    told = export({"run": str(folder), "export": "onnx"})["onnx"]
    assert 0 < told["check"]["relative"] < 1e-3
    cfg, system, model = load_run(folder)
    trial = build_data(cfg, system).select("held_out")[0]
    own = {key: x[:, 0].astype(float) for key, x in model.arrays(trial).items() if key != "x"}
    seen = {
        "v_slip": own["seen_v"] if name == "bb2" else own["v"],
        "normal_force": own["N"],
        "a_frictionless": own["A"],
    }
    session = onnxruntime.InferenceSession(folder / "export" / "onnx" / "friction.onnx")
    sizes = {item.name: item.shape[1] for item in session.get_inputs()}
    assert sizes["state"] == (2 if name == "bb2" else 1) and ("a_frictionless" in sizes) == (name == "bb2")
    state, force = np.zeros((1, sizes["state"]), np.float32), [0.0]
    state[0, 0] = own["v"][0] if name == "bb2" else 0.0
    for k in range(1, len(trial.t)):
        feed = {key: seen[key][None, k - 1 : k + 1].astype(np.float32) for key in seen if key in sizes}
        feed |= {"dt": np.full((1, 1), trial.t[k] - trial.t[k - 1], np.float32), "state": state}
        now, state = session.run(["force", "state_now"], feed)
        force.append(float(now[0, 0]))
    expected = model.predict_trial(trial)["force"]
    later = slice(len(force) // 2, None)  # the model starts its bristles from the measured force
    scale = np.abs(expected).max()
    assert np.array(force)[later] == pytest.approx(expected[later], abs=2e-3 * scale)


def test_mujoco_with_the_bristles_reproduces_our_simulation(trained, monkeypatch):
    mujoco = pytest.importorskip("mujoco", reason="needs the extra: pip install -e '.[mujoco]'")
    from frictionpinn.data.excitation import parse_expression
    from frictionpinn.numerics.paths import InputPath
    from frictionpinn.physics import LAWS
    from frictionpinn.physics.mechanism import Mechanism

    folder = trained("bb2")
    export({"run": str(folder), "export": "mujoco"})
    place = folder / "export" / "mujoco"
    assert json.loads((place / "friction_model.json").read_text())["kinds"] == ["network"]
    modules = ("friction_mujoco", "friction_model", "friction_law")
    for module in modules:
        sys.modules.pop(module, None)
    monkeypatch.syspath_prepend(str(place))
    import friction_mujoco

    _, system, model = load_run(folder)
    theta = parse_expression("45*deg*sin(2*pi*t)", "theta", {})
    path = InputPath.from_expressions(Mechanism(system, LAWS["coulomb"]()), np.arange(101) / 200, {"theta": theta})
    own = simulate_in_motion(system, model.friction(), path, {}).F
    scene = mujoco.MjModel.from_xml_string(pob_mjcf(system.values, timestep=1 / 4000, support="rail"))
    data, force = mujoco.MjData(scene), [own[0]]
    friction = friction_mujoco.Friction(scene, "network", joint="x", normal=friction_mujoco.Reaction("box"))
    swing = data.joint("theta")
    swing.qpos[0], swing.qvel[0] = path(0.0)[:2]
    for k in range(100 * 20):
        angle, rate, acceleration = path(data.time)[:3]
        acceleration += 100.0 * (rate - swing.qvel[0]) + 2500.0 * (angle - swing.qpos[0])
        friction.step(data, {"theta": acceleration})
        if (k + 1) % 20 == 0:
            force.append(friction.force)
    for module in modules:
        sys.modules.pop(module, None)
    assert np.sqrt(np.mean((np.array(force) - own) ** 2)) < 0.01 * np.sqrt(np.mean(own**2))
