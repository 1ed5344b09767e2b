"""A robot identified by one command and handed on by another."""

import json

import numpy as np
import pandas as pd
import pytest
from arms import mjcf
from commands import call

pytest.importorskip("pinocchio")

from frictionpinn.physics.robot import Robot
from frictionpinn.robots.arm import Arm


def log(folder, arm):
    """A log of the arm on a periodic motion, torques with noise, at 200 Hz."""
    t, rng = np.arange(1600) / 200, np.random.default_rng(0)
    w = 2 * np.pi * 0.2 * np.arange(1, 6)
    sines, cosines = rng.normal(size=(2, 5, 3)) * 0.15
    q = np.sin(np.outer(t, w)) @ sines + np.cos(np.outer(t, w)) @ cosines
    v = np.cos(np.outer(t, w)) @ (w[:, None] * sines) - np.sin(np.outer(t, w)) @ (w[:, None] * cosines)
    a = -(np.sin(np.outer(t, w)) @ (w[:, None] ** 2 * sines) + np.cos(np.outer(t, w)) @ (w[:, None] ** 2 * cosines))
    tau = sum(arm.torques(t, q, v, a))
    table = {"t": t} | {f"q_{k + 1}": q[:, k] for k in range(3)}
    table |= {f"tau_{k + 1}": tau[:, k] + 0.1 * rng.standard_normal(len(t)) for k in range(3)}
    pd.DataFrame(table).to_csv(folder / "log.csv", index=False)


def test_a_run_of_identify_is_handed_on_by_evaluate(tmp_path):
    pytest.importorskip("mujoco")
    robot = Robot.read(mjcf(tmp_path))
    log(tmp_path, Arm.of(robot, "coulomb_viscous", {"mu_c": 4.0, "sigma_2": 3.0, "joint_3.mu_c": 2.0}))
    run = tmp_path / "run"
    options = ["system=robot", "robot.file=arm.xml", "robot.torque=motor", "friction=coulomb_viscous", "data=csv"]
    recorded = ["data.path=log.csv", "data.units={default: SI}"]
    done = call("identify.py", *options, *recorded, f"hydra.run.dir={run}", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    done = call("evaluate.py", f"run={run}", "export=[mjcf,isaaclab]", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "friction off by" in done.stdout + done.stderr
    found = json.loads((run / "result.json").read_text())["model"]["values"]
    lab = json.loads((run / "export" / "isaaclab" / "actuator.json").read_text())
    assert lab["dynamic_friction"]["j3"] == pytest.approx(found["joint_3.mu_c"]) == pytest.approx(2.0, abs=0.1)
    told = json.loads((run / "export" / "export.json").read_text())
    assert all(row["error"] < 1e-6 for row in told["joints"])
    written = Robot.read(run / "export" / "mjcf" / "arm.xml")  # bodies as estimated
    rest = np.zeros((20, 3))
    q = np.random.default_rng(1).uniform(-1, 1, (20, 3))
    gravity = robot.inverse_dynamics(q, rest, rest)
    assert np.abs(written.inverse_dynamics(q, rest, rest) - gravity).max() < 0.05 * np.abs(gravity).max()
    refused = call("evaluate.py", f"run={run}", "export=onnx", cwd=tmp_path)
    assert refused.returncode != 0 and "allowed: bam, isaaclab, mjcf, urdf" in refused.stdout + refused.stderr
