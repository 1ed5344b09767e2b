"""The pendulum on a box in MuJoCo moves as the derived equations say."""

import numpy as np
import pytest

from frictionpinn.errors import UserError
from frictionpinn.evaluate.mjcf import pob_mjcf
from frictionpinn.numerics.torch_functions import contact_signals
from frictionpinn.physics import SYSTEMS

mujoco = pytest.importorskip("mujoco", reason="needs the extra: pip install -e '.[mujoco]'")
SYSTEM = SYSTEMS["pob"]()


def test_mujoco_and_the_derived_equations_agree_on_acceleration_and_normal_force():
    model = mujoco.MjModel.from_xml_string(pob_mjcf(SYSTEM.values))
    data = mujoco.MjData(model)
    for theta, omega, tau in np.random.default_rng(0).uniform(-2, 2, (20, 3)):
        data.qpos[:], data.qvel[:], data.ctrl[0] = (0.3, theta), (0.1, omega), tau
        mujoco.mj_forward(model, data)
        mujoco.mj_rnePostConstraint(model, data)
        (a, alpha), box = data.qacc, data.cfrc_int[model.body("box").id]
        signals = {"x": 0.3, "v": 0.1, "a": a, "theta": theta, "omega": omega, "alpha": alpha, "tau": tau}
        ours = contact_signals(SYSTEM, {name: np.array([value]) for name, value in signals.items()})
        assert ours["friction_force"][0] == pytest.approx(0.0, abs=1e-8)
        assert ours["normal_force"][0] == pytest.approx(box[5], rel=1e-9)


def test_on_a_plane_the_contact_carries_the_weight_and_mujocos_friction_holds():
    model = mujoco.MjModel.from_xml_string(pob_mjcf(SYSTEM.values, timestep=1e-3, support="plane", friction=0.6))
    data = mujoco.MjData(model)
    for _ in range(500):
        mujoco.mj_step(model, data)
    force, total = np.zeros(6), np.zeros(3)
    for k in range(data.ncon):
        mujoco.mj_contactForce(model, data, k, force)
        total += force[:3]
    assert total[0] == pytest.approx(1.5 * 9.81, rel=1e-3)
    assert abs(data.joint("x").qpos[0]) < 1e-6


def test_friction_of_mujoco_needs_a_contact():
    with pytest.raises(UserError, match="no contact to rub"):
        pob_mjcf(SYSTEM.values, friction=0.3)
