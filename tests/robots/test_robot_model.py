"""Robots from files: inverse dynamics, regressor, base parameters, and what is refused."""

import numpy as np
import pytest
from arms import ARMATURE, mjcf, motions, urdf

from frictionpinn.errors import UserError

pytest.importorskip("pinocchio")

from frictionpinn.physics.robot import Base, Robot


@pytest.mark.parametrize("kind", ["revolute", "continuous"])
def test_regressor_and_inverse_dynamics_are_the_same_torques(tmp_path, kind):
    robot = Robot.read(urdf(tmp_path, kind), locked={"finger": 0.1})
    q, v, a = motions(50, 3)
    tau = robot.inverse_dynamics(q, v, a)
    np.testing.assert_allclose(robot.regressor(q, v, a) @ robot.inertial, tau, atol=1e-10)


def test_base_parameters_give_the_torques_of_any_motion(tmp_path):
    robot = Robot.read(urdf(tmp_path), locked={"finger": 0.1})
    base, (q, v, a) = Base.of(robot), motions(50, 3, seed=1)
    torque = base.reduced(robot.regressor(q, v, a)) @ base.values(robot.inertial)
    np.testing.assert_allclose(torque, robot.inverse_dynamics(q, v, a), atol=1e-10)
    assert len(base.names) < len(robot.inertial_names)
    W = base.reduced(robot.regressor(q, v, a)).reshape(-1, len(base.names))
    assert np.linalg.matrix_rank(W) == len(base.names)


def test_mujoco_finds_the_same_torques_in_the_same_file(tmp_path):
    mujoco = pytest.importorskip("mujoco")
    path = mjcf(tmp_path)
    robot, model = Robot.read(path), mujoco.MjModel.from_xml_path(str(path))
    model.dof_damping[:], model.dof_frictionloss[:] = 0, 0  # of which friction laws take the place
    data, (q, v, a) = mujoco.MjData(model), motions(20, 3)
    found = []
    for row in zip(q, v, a, strict=True):
        data.qpos[:], data.qvel[:], data.qacc[:] = row
        mujoco.mj_inverse(model, data)
        found.append(data.qfrc_inverse.copy())
    np.testing.assert_allclose(robot.inverse_dynamics(q, v, a), found, atol=1e-6)
    np.testing.assert_allclose(robot.armature, [0, ARMATURE, 0])
    own = robot.regressor(q, v, a) @ robot.inertial + robot.armature * a
    np.testing.assert_allclose(own, found, atol=1e-6)


def test_joints_come_in_the_order_of_the_columns(tmp_path):
    path, (q, v, a) = urdf(tmp_path), motions(5, 3)
    plain = Robot.read(path, joints=["j1", "j2", "j3"])
    turned = Robot.read(path, joints=["j3", "j1", "j2"])
    order = [2, 0, 1]
    own = turned.inverse_dynamics(q[:, order], v[:, order], a[:, order])
    np.testing.assert_allclose(own, plain.inverse_dynamics(q, v, a)[:, order], atol=1e-12)
    assert plain.neighbours == ((1,), (0, 2), (1,)) and turned.neighbours == ((2,), (2,), (0, 1))
    carried = turned.payload_regressor(turned.regressor(q[:, order], v[:, order], a[:, order]))
    np.testing.assert_allclose(carried, plain.payload_regressor(plain.regressor(q, v, a))[:, order], atol=1e-12)


def test_limits_come_in_the_order_of_the_columns(tmp_path):
    path = urdf(tmp_path)
    path.write_text(path.read_text().replace('effort="80" velocity="3"', 'effort="20" velocity="1"', 1))
    limits = Robot.read(path, joints=["j3", "j1", "j2"]).limits
    assert limits["velocity"].tolist() == [3, 1, 3] and limits["effort"].tolist() == [80, 20, 80]


def test_gravity_enters_by_its_direction(tmp_path):
    robot, (q, v, a) = Robot.read(urdf(tmp_path)), motions(5, 4)
    down = robot.gravity_regressor(q, (0, 0, -9.81)) @ robot.inertial
    np.testing.assert_allclose(down, robot.inverse_dynamics(q, 0 * v, 0 * a), atol=1e-10)
    tilted = Robot.read(urdf(tmp_path), gravity=(0, 0, 0))
    np.testing.assert_allclose(tilted.inverse_dynamics(q, 0 * v, 0 * a), 0, atol=1e-12)
    assert robot.turns.tolist() == [True, True, True, False]


def test_a_payload_is_a_body_fixed_to_the_last_one(tmp_path):
    robot, (q, v, a) = Robot.read(urdf(tmp_path), locked={"finger": 0.0}), motions(5, 3)
    Y = robot.regressor(q, v, a)
    heavier = robot.inertial.copy()
    heavier[-10:-6] += [2.0, 0.2, 0.0, 0.1]
    np.testing.assert_allclose(robot.payload_regressor(Y) @ [2.0, 0.2, 0.0, 0.1], Y @ (heavier - robot.inertial))


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"file": "no.urdf"}, "unknown file: robot.file is no.urdf"),
        ({"joints": ["j4"]}, "unknown joint: robot.joints is 'j4'; allowed: j1, j2, j3, finger"),
        ({"locked": {"fingr": 0.0}}, "unknown joint: robot.locked is 'fingr'; allowed: j1, j2, j3, finger"),
        ({"locked": {"finger": "shut"}}, "not a number: robot.locked.finger is 'shut'"),
        ({"locked": {"finger": float("nan")}}, "not a number: robot.locked.finger is nan"),
        ({"locked": {"finger": 30}}, "joint locked beyond its limits: robot.locked.finger is 30 m; allowed: -3 to 3 m"),
        ({"locked": {"j1": -30}}, "robot.locked.j1 is -30 rad; allowed: -3 to 3 rad"),
        ({"joints": ["j1", "j2", "j2"]}, "joint named twice: robot.joints is j2"),
        ({"gravity": [0, -9.81]}, "not a direction: robot.gravity is [0, -9.81]; allowed: three numbers"),
        ({"gravity": 9.81}, "not a direction: robot.gravity is 9.81"),
        ({"gravity": [0, 0, float("nan")]}, "not a direction: robot.gravity is [0, 0, nan]"),
        ({"joints": ["j1"], "locked": {"j1": 0.0}}, "joint both recorded and locked"),
        ({"locked": {"j1": 0, "j2": 0, "j3": 0, "finger": 0}}, "no joint moves"),
    ],
)
def test_a_robot_that_cannot_be_is_refused_in_a_line(tmp_path, options, said):
    with pytest.raises(UserError) as caught:
        Robot.read(**({"file": urdf(tmp_path)} | options))
    assert said in str(caught.value) and "\n" not in str(caught.value)


def test_a_file_that_is_no_robot_is_refused_in_a_line(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text("<robot name='x'><link")
    with pytest.raises(UserError, match="robot file that cannot be read"):
        Robot.read(path)
