"""Logs of robots: columns by joint, currents with gains, gear and coupling, and what is refused."""

import numpy as np
import pandas as pd
import pytest
from arms import urdf

from frictionpinn.errors import UserError

pytest.importorskip("pinocchio")

from frictionpinn.physics.robot import Base, Robot
from frictionpinn.robots.motion import prepare
from frictionpinn.robots.recording import read_robot


@pytest.fixture
def robot(tmp_path):
    return Robot.read(urdf(tmp_path), locked={"finger": 0.0})


def log(folder, **change):
    t = np.arange(200) / 100
    table = {"time": t}
    for k in range(3):
        table |= {f"pos_{k}": np.sin((k + 1) * t), f"cur_{k}": np.cos(t) + k}
    path = folder / "log.csv"
    pd.DataFrame(table | change).to_csv(path, index=False)
    return path


COLUMNS = {"t": "time", "q": "pos_*", "current": ["cur_0", "cur_1", "cur_2"]}


def test_a_pattern_counts_from_0_or_1_and_a_list_names_columns(tmp_path, robot):
    recording = read_robot(log(tmp_path), robot, columns=COLUMNS, gains=[1, 2, 3])
    (trial,) = recording.trials
    np.testing.assert_allclose(trial.signals["q_3"], np.sin(3 * trial.t))
    assert set(trial.signals) == {f"{kind}_{k}" for kind in ("q", "tau") for k in (1, 2, 3)} == set(recording.units)


def test_torque_is_gain_times_gear_times_coupling_times_current(tmp_path, robot):
    coupling = np.eye(3)
    coupling[1, 2] = -0.5
    recording = read_robot(log(tmp_path), robot, columns=COLUMNS, gains=[0.1, 0.2, 0.3], gear=[100, 50, -50],
                           coupling=coupling.tolist())  # fmt: skip
    (trial,) = recording.trials
    current = np.stack([np.cos(trial.t) + k for k in range(3)])
    motors = np.array([10, 10, -15])[:, None] * current
    np.testing.assert_allclose(trial.signals["tau_2"], motors[1] - 0.5 * motors[2])
    np.testing.assert_allclose(trial.signals["tau_3"], motors[2])


def test_a_torque_that_no_motor_has_is_refused(tmp_path, robot):
    path = log(tmp_path, cur_1=1e160 * np.cos(np.arange(200) / 100))
    with pytest.raises(UserError, match=r"no mechanism has: tau_2, trial log is 1e\+160; allowed: up to 1e\+50"):
        read_robot(path, robot, columns={"t": "time", "q": "pos_*", "tau": "cur_*"})


def test_degrees_are_a_unit_and_angles_that_wrap_are_unwrapped(tmp_path, robot):
    t = np.arange(200) / 100
    turned = np.degrees(4 * t)
    path = log(tmp_path, pos_0=(turned + 180) % 360 - 180)
    recording = read_robot(path, robot, columns=COLUMNS, units={"q": "deg", "default": "SI"}, gains=[1, 1, 1])
    np.testing.assert_allclose(np.diff(recording.trials[0].signals["q_1"]), 0.04, atol=1e-9)


def test_a_unit_of_a_kind_is_of_the_joints_that_have_its_dimension(tmp_path):
    robot, t = Robot.read(urdf(tmp_path), locked={"j1": 0.0}), np.arange(200) / 100  # the third slides
    for unit, own in (("deg", [np.pi / 180, np.pi / 180, 1]), ("mm", [1, 1, 1e-3])):
        units = {"q": unit, "default": "SI"}
        (trial,) = read_robot(log(tmp_path), robot, columns=COLUMNS, units=units, gains=[1, 1, 1]).trials
        for k, factor in enumerate(own, 1):
            np.testing.assert_allclose(trial.signals[f"q_{k}"], factor * np.sin(k * t), atol=1e-12)
    with pytest.raises(UserError, match="wrong dimension"):
        read_robot(log(tmp_path), robot, columns=COLUMNS, units={"q": "N", "default": "SI"}, gains=[1, 1, 1])


def test_a_unit_of_one_signal_goes_before_that_of_its_kind_in_either_order(tmp_path, robot):
    path = log(tmp_path, pos_2=np.degrees(np.sin(3 * np.arange(200) / 100)))
    for units in ({"q_3": "deg", "q": "rad", "default": "SI"}, {"q": "rad", "q_3": "deg", "default": "SI"}):
        (trial,) = read_robot(path, robot, columns=COLUMNS, units=units, gains=[1, 1, 1]).trials
        np.testing.assert_allclose(trial.signals["q_3"], np.sin(3 * trial.t), atol=1e-9)


def test_a_pattern_that_finds_more_columns_than_joints_is_refused(tmp_path, robot):
    """Which of them were left out it cannot know: of a joint that is locked in the middle all behind would move up."""
    path = log(tmp_path, pos_3=np.arange(200) / 100, cur_3=np.ones(200))
    with pytest.raises(UserError, match=r"more columns than joints: data.columns.q is pos_0 to pos_3 .* j1, j2, j3;"):
        read_robot(path, robot, columns=COLUMNS, gains=[1, 1, 1])
    listed = {"t": "time", "q": ["pos_0", "pos_2", "pos_3"], "current": ["cur_0", "cur_2", "cur_3"]}
    (trial,) = read_robot(path, robot, columns=listed, gains=[1, 1, 1]).trials
    np.testing.assert_allclose(trial.signals["q_3"], trial.t)


def test_one_temperature_may_stand_for_all_joints_and_each_is_less_its_own_mean(tmp_path):
    """Of twelve joints, more than digits: temperature_10 is not that of the second."""
    links = "".join(
        f'<link name="l{k}"/><joint name="j{k}" type="continuous"><parent link="l{k - 1}"/><child link="l{k}"/>'
        '<axis xyz="0 0 1"/></joint>' for k in range(1, 13))  # fmt: skip
    (tmp_path / "snake.urdf").write_text(f'<robot name="snake"><link name="l0"/>{links}</robot>')
    robot, t = Robot.read(tmp_path / "snake.urdf"), np.arange(400) / 100
    table = {"t": t} | {f"{kind}_{k}": np.sin(t + k) for kind in ("q", "tau") for k in range(1, 13)}
    warm = {f"temperature_{k}": k + t for k in range(1, 13)}
    for more, columns in ((warm, None), ({"T": t}, {"t": "t", "q": "q_*", "tau": "tau_*", "temperature": ["T"] * 12})):
        pd.DataFrame(table | more).to_csv(tmp_path / "log.csv", index=False)
        recording = read_robot(tmp_path / "log.csv", robot, columns=columns)
        (trial,) = prepare(recording, robot, Base.of(robot), 5.0)
        np.testing.assert_allclose(trial.covariate, np.tile(trial.t[:, None] - t.mean(), 12), atol=1e-9)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({}, "currents without gains: robot.gains is nothing"),
        ({"gains": [1, 2]}, "not one number for each joint: robot.gains is [1, 2]; allowed: 3 numbers"),
        ({"columns": COLUMNS | {"current": None, "tau": "cur_*"}, "gains": [1, 1, 1]}, "not one column for each joint"),
        ({"columns": {"t": "time", "q": "pos_*", "tau": "cur_*"}, "gains": [1, 1, 1]}, "gains for torques that were"),
        ({"columns": {"t": "time", "q": "pos_*"}}, "no torques in the recording"),
        ({"columns": {"t": "time", "tau": "cur_*"}}, "no positions in the recording"),
        (
            {"columns": COLUMNS | {"q": "pos_0"}, "gains": [1, 1, 1]},
            "not one column for each joint: data.columns.q is ['pos",
        ),
        (
            {"columns": COLUMNS | {"temperature_2": "cur_0"}, "gains": [1, 1, 1]},
            "data.columns is without temperature_1;",
        ),
        ({"columns": {"t": "clock", "q": "pos_*"}}, "no time: data.columns.t is 'clock'"),
        ({"columns": {"t": "time", "p": "pos_*"}}, "unknown option: data.columns is 'p'"),
        ({"gains": [1, 1, 1], "coupling": [[1, 0], [0, 1]]}, "impossible coupling"),
        ({"columns": {"t": "time", "q": ["pos_0", "pos_1", "pos_9"], "tau": "cur_*"}}, "unknown column"),
    ],
)
def test_a_log_that_does_not_fit_the_robot_is_refused_in_a_line(tmp_path, robot, change, said):
    with pytest.raises(UserError) as caught:
        read_robot(log(tmp_path), robot, **({"columns": COLUMNS} | change))
    assert said in str(caught.value) and "\n" not in str(caught.value)
