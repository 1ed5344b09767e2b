"""Friction of a robot's joints as samples come: beside a simulation's own, from encoders, at rest, after a gap."""

import numpy as np
import pytest
from arms import mjcf

from frictionpinn.errors import UserError

pytest.importorskip("pinocchio")

from frictionpinn.physics.robot import Robot
from frictionpinn.robots import Arm, Observer, pd, simulate

LUGRE = {"sigma_0": 3e3, "sigma_1": 5.0, "sigma_2": 3.0, "mu_c": 4.0, "mu_s": 6.0, "v_s": 0.05}
Q0, W = np.array([0.2, -0.5, 0.3]), np.array([5.0, 7.0, 6.0])
T = np.arange(1001) / 1000


def wave(t):
    """A motion to follow, which turns round in every joint."""
    return Q0 + 0.3 * np.sin(W * t), 0.3 * W * np.cos(W * t)


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    robot = Robot.read(mjcf(tmp_path_factory.mktemp("arm")))
    return Arm.of(robot, "lugre", LUGRE | {"joint_2.load_friction": 0.1}, {"joint_2": ["load_friction"]})


@pytest.fixture(scope="module")
def motion(arm):
    return simulate(arm, T, pd(arm, wave, 800, 30), *wave(0.0), encoder_step=1e-5)


def off(said, truth):
    """Error of each joint over what is said, relative."""
    return np.sqrt(np.mean((np.array(said) - truth) ** 2, axis=0) / np.mean(truth**2, axis=0))


def test_it_says_the_simulated_friction_and_what_the_motors_need(arm, motion):
    seen, own = Observer(arm), motion
    told = [seen.step(*sample) for sample in zip(T, own.q, own.v, own.a, own.torque, strict=True)]
    assert (off([s.friction for s in told], own.friction) < 0.03).all()
    assert (off([s.torque for s in told], own.torque) < 0.03).all()
    np.testing.assert_allclose([s.load for s in told], own.load, rtol=1e-9, atol=1e-9)


def test_from_encoder_positions_and_their_differences_alone_it_stays_near(arm, motion):
    v = np.vstack([motion.v[:1], np.diff(motion.measured, axis=0) * 1000])
    seen = Observer(arm)
    told = [seen.step(*sample).friction for sample in zip(T, motion.measured, v, strict=True)]
    assert (off(told, motion.friction) < 0.1).all()


def test_twice_the_samples_say_the_same(arm, motion):
    seen = Observer(arm), Observer(arm)
    every = [seen[0].step(*s).friction for s in zip(T, motion.q, motion.v, motion.a, strict=True)]
    other = [seen[1].step(*s).friction for s in zip(*(x[::2] for x in (T, motion.q, motion.v, motion.a)), strict=True)]
    assert (off(other, np.array(every)[::2]) < 0.05).all()


def test_joints_at_rest_begin_with_the_torque_that_was_measured(arm):
    gravity = arm.robot.inverse_dynamics(Q0[None], np.zeros((1, 3)), np.zeros((1, 3)))[0]
    lean = np.array([2.0, -3.0, 1.0])  # less than static friction
    told = Observer(arm).step(0.0, Q0, np.zeros(3), np.zeros(3), gravity + lean)
    np.testing.assert_allclose(told.friction, lean, atol=1e-6)
    np.testing.assert_allclose(told.unexplained, 0.0, atol=1e-6)


def test_a_torque_that_nobody_models_is_left_unexplained(arm, motion):
    seen, touched = Observer(arm), motion.torque + np.array([0.0, 5.0, 0.0])
    left = [seen.step(*s).unexplained for s in zip(T, motion.q, motion.v, motion.a, touched, strict=True)]
    assert np.median(left, axis=0) == pytest.approx([0.0, 5.0, 0.0], abs=0.1)


def test_after_a_gap_it_begins_anew(arm, motion):
    fresh, held = Observer(arm), Observer(arm)
    for k in range(300):
        held.step(T[k], motion.q[k], motion.v[k])
    gap = 5.0 + T[600], motion.q[600], motion.v[600], motion.a[600]
    np.testing.assert_array_equal(held.step(*gap).friction, fresh.step(*gap).friction)


@pytest.mark.parametrize(
    ("sample", "said"),
    [((0.0, Q0, Q0), "time does not go on"), ((2.0, Q0[:2], Q0), "one number for each joint"),
     ((2.0, Q0, [0.0, np.nan, 0.0]), "finite")],
)  # fmt: skip
def test_samples_that_cannot_be_are_refused_in_a_line(arm, sample, said):
    seen = Observer(arm)
    seen.step(1.0, Q0, np.zeros(3))
    with pytest.raises(UserError, match=said):
        seen.step(*sample)
