"""The check of a robot's log: what is wrong with it or with the robot file, a line each."""

from dataclasses import replace

import numpy as np
import pytest
from arms import urdf

pytest.importorskip("pinocchio")

from test_robot_balance import recorded

from frictionpinn.errors import UserError
from frictionpinn.physics import LAWS
from frictionpinn.physics.robot import Base, Robot
from frictionpinn.robots.check import inspect_robot
from frictionpinn.robots.identify import declare


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    return Robot.read(urdf(tmp_path_factory.mktemp("arm")), locked={"finger": 0.0})


WRONG = {
    "every torque acts against gravity": lambda s: {n: -y if n.startswith("tau") else y for n, y in s.items()},
    "tau_2 acts against gravity": lambda s: s | {"tau_2": -s["tau_2"]},
    "swapped": lambda s: s | {"tau_2": s["tau_3"], "tau_3": s["tau_2"]},
    "where the robot file allows": lambda s: {n: np.degrees(y) if n.startswith("q") else y for n, y in s.items()},
    "a factor of 1000|robot file allows 80": lambda s: s | {"tau_2": 1000 * s["tau_2"]},
    "are the same": lambda s: s | {"q_3": s["q_2"]},
    "times what the robot file's masses": lambda s: s | {"tau_2": 2.5 * s["tau_2"]},
    "clipped|saturated": lambda s: s | {"tau_2": np.clip(s["tau_2"], -15, 15)},
}


@pytest.mark.parametrize("said", WRONG)
def test_the_check_says_what_is_wrong_with_a_log(robot, said):
    recording = recorded(robot)
    assert not [f for f in inspect_robot(robot, recording) if f.grave]
    (trial,) = recording.trials
    findings = inspect_robot(robot, replace(recording, trials=(replace(trial, signals=WRONG[said](trial.signals)),)))
    assert any(part in str(f) for f in findings for part in said.split("|")), [str(f) for f in findings]


def test_motions_from_point_to_point_are_no_joints_that_stand_and_no_clipped_positions(robot):
    """Most of the time at rest, where an encoder shows one number, and back at the end: no speed in median and mean."""
    recording = recorded(robot)
    (trial,) = recording.trials
    signals, t = dict(trial.signals), trial.t
    for k in range(1, 4):
        u = np.clip((np.abs((t + 0.3 * k) % 6 - 3) - 1.1) / 0.8, 0, 1)  # rests 2.2 s at either end, 0.8 s between
        signals[f"q_{k}"] = 1e-4 * np.round(0.3 * k * u**3 * (10 - 15 * u + 6 * u**2) / 1e-4)
    said = [str(f) for f in inspect_robot(robot, replace(recording, trials=(replace(trial, signals=signals),)))]
    assert not any(part in line for line in said for part in ("moves", "clipped")), said
    cut = signals | {"q_2": np.clip(trial.signals["q_2"], -0.2, 0.2)}
    said = [str(f) for f in inspect_robot(robot, replace(recording, trials=(replace(trial, signals=cut),)))]
    assert any("q_2 stays at its very end" in line and "clipped" in line for line in said), said


def test_a_constant_torque_is_one_line(robot):
    recording = recorded(robot)
    (trial,) = recording.trials
    flat = trial.signals | {"tau_2": np.full(len(trial.t), 5.0)}
    findings = inspect_robot(robot, replace(recording, trials=(replace(trial, signals=flat),)))
    (found,) = [f for f in findings if "tau_2" in str(f)]
    assert found.grave and str(found).startswith("tau_2 is 5 throughout")


@pytest.mark.parametrize(("joint", "unit", "factor"), [(1, "deg", 180 / np.pi), (3, "mm", 1e3)])
def test_the_unit_that_is_advised_is_one_of_the_joint(tmp_path, joint, unit, factor):
    sliding = Robot.read(urdf(tmp_path), locked={"j1": 0.0})
    recording = recorded(sliding)
    (trial,) = recording.trials
    off = trial.signals | {f"q_{joint}": factor * trial.signals[f"q_{joint}"]}
    said = [str(f) for f in inspect_robot(sliding, replace(recording, trials=(replace(trial, signals=off),)))]
    assert any(f"data.units={{q: {unit}, default: SI}}" in line for line in said), said


def test_a_clock_in_milliseconds_is_told(robot):
    recording = recorded(robot)
    (trial,) = recording.trials
    (found,) = [
        f for f in inspect_robot(robot, replace(recording, trials=(replace(trial, t=1e3 * trial.t),))) if f.grave
    ]
    assert "data.units={t: ms, default: SI}" in str(found)


def test_a_body_without_a_mass_is_told_and_is_no_prior(tmp_path, robot):
    path = urdf(tmp_path)
    text = path.read_text()
    first, last = text.index('<link name="link_2"><inertial>'), text.index('<joint name="j2"')
    path.write_text(text[:first] + '<link name="link_2"/>' + text[last:])
    lacking = Robot.read(path, locked={"finger": 0.0})
    said = [str(f) for f in inspect_robot(lacking, recorded(robot))]
    assert any("gives no mass to what j2 moves" in line for line in said), said
    assert not any("no mass" in str(f) for f in inspect_robot(robot, recorded(robot)))
    with pytest.raises(UserError, match="no mass behind j2"):
        declare(lacking, Base.of(lacking), LAWS["coulomb_viscous"](), inertia="prior")
