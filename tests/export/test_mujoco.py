"""MuJoCo: the exported friction reproduces our own simulation, in a joint and between two bodies."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from frictionpinn.evaluate.in_simulation import simulate_model
from frictionpinn.evaluate.mjcf import pob_mjcf
from frictionpinn.evaluate.yardsticks import simulated_law
from frictionpinn.export.mujoco_model import describe

mujoco = pytest.importorskip("mujoco", reason="needs the extra: pip install -e '.[mujoco]'")


@pytest.fixture
def friction(exported, monkeypatch):
    """``friction("pe2")``: the exported modules as a user imports them, from their folder."""

    def load(name: str):
        run = exported(name)
        for module in ("friction_mujoco", "friction_model", "friction_law"):
            sys.modules.pop(module, None)
        monkeypatch.syspath_prepend(str(run.file("mujoco", "")))
        import friction_mujoco

        return run, friction_mujoco

    yield load
    for module in ("friction_mujoco", "friction_model", "friction_law"):
        sys.modules.pop(module, None)


def simulate(run, module, path, kind: str, support: str, stride: int) -> np.ndarray:
    """Friction force at the path's samples but the first."""
    step = float(path.t[1] - path.t[0]) / stride
    model = mujoco.MjModel.from_xml_string(pob_mjcf(run.system.values, timestep=step, support=support))
    data = mujoco.MjData(model)
    if support == "rail":
        friction = module.Friction(model, kind, joint="x", normal=module.Reaction("box"))
    else:
        friction = module.Friction(model, kind, bodies=("box", "world"))
    theta, force = data.joint("theta"), []
    theta.qpos[0], theta.qvel[0] = path(0.0)[:2]
    for k in range((len(path.t) - 1) * stride):
        angle, rate, acceleration = path(data.time)[:3]
        acceleration += 100.0 * (rate - theta.qvel[0]) + 2500.0 * (angle - theta.qpos[0])
        friction.step(data, {"theta": acceleration})
        if (k + 1) % stride == 0:
            force.append(friction.force)
    return np.array(force)


CASES = [("pe2", "law", "rail"), ("pe2", "law", "plane"), ("pe2", "network", "rail"), ("bb1", "network", "plane")]


@pytest.mark.parametrize(("name", "kind", "support"), CASES)
def test_mujoco_reproduces_our_simulation_within_one_percent_of_the_force(friction, swing, name, kind, support):
    run, module = friction(name)
    path = swing(run.system)
    if kind == "law":
        own = simulated_law(run.system, "lugre", run.model.physical())(path, {}).F
    else:
        own = simulate_model(run.system, run.model, path, {}, 4).F
    force = simulate(run, module, path, kind, support, stride=20)
    assert run.force_error(force, own[1:]) < 0.01


def test_a_box_that_is_pushed_below_breakaway_stays_and_begins_anew_after_a_reset(friction):
    run, module = friction("pe2")
    model = mujoco.MjModel.from_xml_string(pob_mjcf(run.system.values, timestep=1e-3, support="plane"))
    data = mujoco.MjData(model)
    law = module.Friction(model, "law", bodies=("box", "world"))
    weight = 1.5 * 9.81 * run.model.physical()["mu_c"]
    data.qfrc_applied[model.joint("x").dofadr[0]] = 0.5 * weight
    data.qfrc_applied[model.joint("theta").dofadr[0]] = 0.0
    for _ in range(300):
        law.step(data, {"theta": -20 * data.joint("theta").qvel[0] - 100 * data.joint("theta").qpos[0]})
    assert law.force == pytest.approx(0.5 * weight, rel=1e-2) and abs(data.joint("x").qvel[0]) < 1e-4
    assert data.qfrc_applied[model.joint("x").dofadr[0]] == 0.5 * weight  # what the user applied stays the user's
    mujoco.mj_resetData(model, data)
    assert abs(law.step(data)) < 0.1 * weight


def test_bodies_that_do_not_touch_do_not_rub(friction):
    run, module = friction("bb1")
    model = mujoco.MjModel.from_xml_string(pob_mjcf(run.system.values, timestep=1e-3, support="plane"))
    data = mujoco.MjData(model)
    data.joint("z").qpos[0], data.joint("x").qvel[0] = 1.0, 1.0
    law = module.Friction(model, "network", bodies=("box", "world"))
    assert law.step(data) == 0.0 and data.joint("x").qvel[0] == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("kind", ["law", "bristles"])
def test_a_contact_whose_load_goes_carries_nothing_and_slides_on_when_it_is_back(friction, kind):
    run, module = friction("pe2")
    told = {
        "tables": np.full((2, 2, 2), 1e-4),
        "grid": [0.01, 0.0, 8.0, 0.0, 20.0],
        "elements": [[1e5], [1e3], [0], [1]],
    }
    law = module.Bristles(told, 1e-3) if kind == "bristles" else module.Law(describe(run.portable), 1e-3)

    def slide(normal: float, steps: int) -> float:
        now = {"v_slip": 0.1, "normal_force": normal}
        for _ in range(steps):
            law.keep(now)
        return law.force(now)

    before = slide(10.0, 1000)
    assert before > 1.0 and abs(slide(0.0, 2)) < 1e-4 * before and not np.any(law.z)
    assert slide(10.0, 1000) == pytest.approx(before)


def test_mistakes_are_told(friction):
    run, module = friction("bb1")
    model = mujoco.MjModel.from_xml_string(pob_mjcf(run.system.values, timestep=1e-3))
    rail = module.Reaction("box")
    with pytest.raises(ValueError, match="kind 'law' is not exported; allowed: network"):
        module.Friction(model, "law", joint="x", normal=rail)
    with pytest.raises(ValueError, match="normal force"):
        module.Friction(model, "network", joint="x")
    with pytest.raises(ValueError, match="either joint or bodies"):
        module.Friction(model, "network")
    model.opt.timestep = 0.003
    with pytest.raises(ValueError, match="divided by a whole number"):
        module.Friction(model, "network", joint="x", normal=rail)
    model.opt.timestep, model.opt.integrator = 0.001, mujoco.mjtIntegrator.mjINT_RK4
    with pytest.raises(ValueError, match="RK4"):
        module.Friction(model, "network", joint="x", normal=rail)


def test_the_example_runs_as_the_readme_says(exported, tmp_path):
    folder = exported("pe2").file("mujoco", "")
    command = [sys.executable, "simulate_pob.py", "law"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    head, *rows = done.stdout.splitlines()
    assert head.startswith("t,x,v,theta,normal_force,friction_force") and len(rows) == 2 * 200 * 20
    assert float(rows[-1].split(",")[3]) == pytest.approx(0.0, abs=1e-3)  # two whole swings
