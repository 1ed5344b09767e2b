"""The commands with system=robot: a log is checked, identified and diagnosed; mistakes end in a line."""

import json

import numpy as np
import pandas as pd
import pytest
from arms import urdf
from commands import call

pytest.importorskip("pinocchio")

from test_robot_balance import ARMATURE, MU, VISCOUS, motion

from frictionpinn.errors import UserError
from frictionpinn.physics.robot import Robot
from frictionpinn.robots import least_squares
from frictionpinn.workflow.options import composed
from frictionpinn.workflow.robot import identify
from frictionpinn.workflow.robot_bench import recorded

EFFECTS = "diagnose.effects=[load_friction,constant_force,drag]"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("robot")
    robot = Robot.read(urdf(folder), locked={"finger": 0.0})
    t, q, v, a = motion(3, 25.0)
    load = robot.inverse_dynamics(q, v, a)
    tau = load + ARMATURE * a + MU * np.sign(v) + VISCOUS * v + np.array([0, 0.06, 0]) * np.abs(load) * np.sign(v)
    tau += 0.02 * tau.std(axis=0) * np.random.default_rng(0).standard_normal(tau.shape)
    table = {"t": t} | {f"q_{k + 1}": q[:, k] for k in range(3)} | {f"tau_{k + 1}": tau[:, k] for k in range(3)}
    pd.DataFrame(table).to_csv(folder / "log.csv", index=False, float_format="%.8g")
    return folder


def options(folder, *more):
    return ("system=robot", f"robot.file={folder / 'arm.urdf'}", "robot.torque=motor", "robot.locked.finger=0.0",
            f"data.path={folder / 'log.csv'}", *more)  # fmt: skip


def test_a_log_of_an_arm_is_checked_and_diagnosed_with_a_page(folder):
    done = call("check.py", *options(folder), cwd=folder)
    assert done.returncode == 0 and "nothing" in done.stdout, done.stderr
    run = options(folder, "friction=coulomb_viscous", EFFECTS, "hydra.run.dir=run")
    done = call("diagnose.py", *run, cwd=folder)
    assert done.returncode == 0, done.stderr
    result = json.loads((folder / "run/result.json").read_text())
    assert [e["name"] for e in result["effects"]] == ["load_friction@joint_2"]
    low, high = result["parameters"]["joint_2.load_friction"]["ci95"]
    assert low - 0.005 < 0.06 < high + 0.005
    page = (folder / "run/report.html").read_text()
    assert page.index("data:image/png") < page.index("<table") and "load_friction" in page
    assert all(after <= before for name in result["torque_error"] for before, after in
               [(sum(result["torque_error"][name][k]) for k in ("before", "after"))])  # fmt: skip


def test_the_page_tells_what_a_form_that_the_arm_is_handed_on_to_cannot_say(folder):
    run = options(folder, "friction=coulomb_viscous", "diagnose.effects=[load_friction]", "hydra.run.dir=handed")
    assert call("diagnose.py", *run, cwd=folder).returncode == 0
    before = (folder / "handed/report.html").read_text()
    done = call("evaluate.py", "run=handed", "export=[urdf]", cwd=folder)
    assert done.returncode == 0, done.stderr
    page = (folder / "handed/report.html").read_text()
    assert "Handed on" in page and "Handed on" not in before and before.count("<figure>") == page.count("<figure>")
    told = json.loads((folder / "handed/export/export.json").read_text())
    worst = max(told["joints"], key=lambda row: row["error"])
    assert "load_friction" in worst["left_out"] and f"{100 * worst['error']:.2g}" in page
    assert not any("lag" in note for note in told["notes"])


def test_an_arm_is_identified_by_command(folder):
    run = options(folder, "data=csv", "friction=coulomb_viscous", "hydra.run.dir=identified")
    done = call("identify.py", *run, cwd=folder)
    assert done.returncode == 0, done.stderr
    result = json.loads((folder / "identified/result.json").read_text())
    assert result["parameters"]["joint_1.mu_c"]["value"] == pytest.approx(MU[0], rel=0.05)
    assert "N m" in done.stdout


def test_a_search_that_did_not_converge_says_so(folder, tmp_path, monkeypatch, caplog):
    monkeypatch.setattr(least_squares, "STEPS", 1)
    result = identify(composed("identify", [*options(folder, "data=csv", "friction=coulomb_viscous")]), tmp_path)
    assert not result["converged"]
    (said,) = [r.message for r in caplog.records if "did not converge" in r.message]
    assert "hold what" in said and "friction.fixed.joint_1.mu_c=" in said


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (["robot.torque=joint"], "unknown option: robot.torque is 'joint'; allowed: link, motor"),
        (["robot.cutoff_hz=400"], "cutoff out of range: robot.cutoff_hz is 400 Hz"),
        (["data.columns={t: t, q: q_*, current: tau_*}"], "currents without gains"),
        (["friction.joint_9=lugre"], "unknown option: friction is 'joint_9'"),
        (["diagnose.declared=[magic]"], "unknown option: effects is 'magic'"),
        (["diagnose.effects=[magic]"], "unknown option: diagnose.effects is 'magic'"),
        (["robot.payload=loaded"], "not a list of trials"),
        (["data.gains={tau: 5}"], "a robot does not have: data.gains is {'tau': 5}; allowed: null; name the columns"),
        (["data.rate_hz=50"], "a robot does not have: data.rate_hz is 50"),
        (["data.max_samples=100"], "a robot does not have: data.max_samples is 100; allowed: 1000000; leave it out"),
        (["data.validation=[log]"], "a robot does not have: data.validation is ['log']"),
        (["friction.bounds.joint_2.mu_c=[0.1,1]"], "a robot does not have: friction.bounds is {'joint_2'"),
        (["diagnose.free=[mu_c]"], "a robot does not have: diagnose.free is ['mu_c']"),
        (["robot.payload=[loaded]"], "robot.payload is 'loaded'; allowed: log"),
        (["diagnose.effects=[drag@joint_2]"], "diagnose.effects is 'drag@joint_2'"),
        (["robot.inertia=some"], "unknown option: robot.inertia is 'some'"),
        (["diagnose.loss=robust"], "a robot does not have: diagnose.loss is robust; allowed: auto; leave it out"),
        (["diagnose.initial=rest"], "a robot does not have: diagnose.initial is rest; allowed: free"),
        (["diagnose.samples=100"], "a robot does not have: diagnose.samples is 100; allowed: 50000"),
        (["smoothing=savgol"], "a robot does not have: smoothing is savgol; allowed: none"),
        (["noise=gaussian"], "a robot does not have: noise is gaussian; allowed: none"),
    ],
)
def test_a_mistake_ends_in_a_line(folder, more, said):
    refused("diagnose.py", folder, more, said)


@pytest.mark.parametrize(
    ("script", "more", "said"),
    [
        ("identify.py", ["methods=[genetic]"], "a robot does not have: methods is ['genetic']; allowed: ['maximum_"),
        ("identify.py", ["seeds=[1,2]"], "a robot does not have: seeds is [1, 2]; allowed: [0]"),
        ("identify.py", ["start={mu_c: 1}"], "start is {'mu_c': 1}; allowed: null; give friction.start"),
        ("identify.py", ["epochs=5"], "a robot does not have: epochs is 5; allowed: null"),
        ("identify.py", ["bounds=near"], "a robot does not have: bounds is near; allowed: decade"),
        ("identify.py", ["smoothing.offline.order=4"], "smoothing is {'name': 'kalman', 'offline': {'order': 4}"),
        ("check.py", ["free=[mu_c]"], "a robot does not have: free is ['mu_c']; allowed: null"),
        ("train.py", ["model=bb1", "smoothing=savgol"], "smoothing is savgol; allowed: kalman"),
    ],
)
def test_options_of_other_systems_are_refused_where_they_are_not_as_they_are_by_themselves(folder, script, more, said):
    data = [] if script == "check.py" else ["data=csv"]
    refused(script, folder, [*data, *more], said)


def refused(script, folder, more, said):
    done = call(script, *options(folder, *more), cwd=folder)
    assert done.returncode == 2 and done.stderr.startswith("error: ") and done.stderr.count("\n") == 1, done.stderr
    assert said in done.stderr


@pytest.mark.parametrize(
    "more",
    ["robot.gains=[1,1,1,1,1,1]", "robot.gear=[1,1,1,1,1,1]", "robot.coupling=[[1]]", "data.columns.q=pos_*",
     "data.units.q=deg", "robot.locked.wrist_3_joint=0.5"],
)  # fmt: skip
def test_what_tells_how_a_log_is_read_is_refused_of_recordings_that_are_known(more):
    cfg = composed("diagnose", ["preset=ur10e", more])
    with pytest.raises(UserError, match=rf"a robot does not have: {more[:10]}.*; allowed: null; leave it out"):
        recorded(cfg)
