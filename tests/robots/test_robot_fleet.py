"""Many recordings in one call: each diagnosed by itself, then one table and one page of all."""

import csv

import pytest
from arms import urdf
from commands import call
from pages import assert_reads_everywhere

pytest.importorskip("pinocchio")

import numpy as np
import pandas as pd
from test_robot_balance import recorded

from frictionpinn.physics.robot import Robot


@pytest.fixture(scope="module")
def fleet(tmp_path_factory):
    """A folder with logs of two arms, of which one has friction that grows with the load, and a file that is none."""
    folder = tmp_path_factory.mktemp("fleet")
    robot = Robot.read(urdf(folder), locked={"finger": 0.0})
    (folder / "logs").mkdir()
    for name, share in (("one", 0.0), ("two", 0.08)):
        made = recorded(robot, 5, 12.0, lambda q, v, load, f, s=share: f + [0, s, 0] * np.abs(load) * np.sign(v))
        (trial,) = made.trials
        table = pd.DataFrame({"t": trial.t} | dict(trial.signals))
        table.to_csv(folder / "logs" / f"{name}.csv", index=False, float_format="%.7g")
    (folder / "logs" / "no_log.csv").write_text("x\n1\n")
    options = ["system=robot", "robot.file=arm.urdf", "robot.torque=motor", "robot.locked={finger: 0.0}",
               "friction=coulomb_viscous", "diagnose.effects=[load_friction]"]  # fmt: skip
    first = call("diagnose.py", "-m", *options, "data.path=glob(logs/*.csv)", "hydra.sweep.dir=f", cwd=folder)
    return folder, first, call("diagnose.py", "resume=f", cwd=folder)


def test_a_fleet_ends_in_one_table_and_one_page(fleet):
    folder, first, _ = fleet
    assert first.returncode == 2 and "no_log.csv" in first.stderr and first.stderr.count("error: ") == 1, first.stderr
    assert "load_friction: 1 of 2 (1 in joint 2)" in first.stdout and "2 of 3 recordings diagnosed" in first.stdout
    with (folder / "f/fleet.csv").open() as file:
        rows = {row["recording"]: row for row in csv.DictReader(file)}
    assert rows["one.csv"]["effects"] == "" and rows["two.csv"]["effects"] == "load_friction@joint_2"
    assert float(rows["two.csv"]["error_after"]) < float(rows["two.csv"]["error_before"])
    assert rows["no_log.csv"]["error"]
    page = (folder / "f/fleet.html").read_text()
    assert_reads_everywhere(page)
    assert "two.csv" in page and "/report.html" in page and "Not diagnosed" in page


def test_a_fleet_goes_on_where_it_stopped(fleet):
    _, _, again = fleet
    assert "finished before and skipped:" in again.stdout and "2 of 3 recordings diagnosed" in again.stdout
    assert again.stdout.count("nothing missing") == 0  # what is finished is not computed again


def test_a_pattern_without_files_ends_in_a_line(tmp_path):
    done = call("diagnose.py", "-m", "system=robot", "data.path=glob(none/*.csv)", cwd=tmp_path)
    assert done.returncode == 2 and "no such files: data.path is none/*.csv" in done.stderr, done.stderr
