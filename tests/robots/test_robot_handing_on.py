"""Identified robots in other simulators' forms: each file is read back and gives the friction that it says."""

import json
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from arms import mjcf, urdf
from documented import block

from frictionpinn.errors import UserError

pytest.importorskip("pinocchio")

from frictionpinn.physics.robot import Base, Robot
from frictionpinn.robots.arm import Arm
from frictionpinn.robots.bodies import bodies_of
from frictionpinn.robots.handing_on import FORMS, hand_on
from frictionpinn.robots.integration import simulate

PLAIN = {"mu_c": 4.0, "sigma_2": 3.0, "joint_2.mu_c": 7.0}
LUGRE = {"sigma_0": 3e3, "sigma_1": 5.0, "sigma_2": 3.0, "mu_c": 4.0, "mu_s": 6.0, "v_s": 0.05}
T = np.arange(2001) / 1000


def swing():
    """A motion with reversals, and slow enough for the Stribeck effect to show."""
    w, start = np.array([2.0, 3.0, 5.0]), np.array([0.2, -0.5, 0.3])
    phase = np.outer(T, w)
    return T, start + 0.3 * np.sin(phase), 0.3 * w * np.cos(phase), -0.3 * w**2 * np.sin(phase)


def by_joint(handed, form):
    return [row for row in handed.rows if row.target == form]


def test_mujoco_reads_back_armature_damping_and_frictionloss(tmp_path):
    mujoco = pytest.importorskip("mujoco")
    path = mjcf(tmp_path)
    arm = Arm.of(Robot.read(path), "coulomb_viscous", PLAIN, armature=[0.1, 0.2, 0.3])
    handed = hand_on(arm, path, tmp_path / "out", swing(), ["mjcf"])
    model = mujoco.MjModel.from_xml_path(str(handed.files["mjcf"][0]))
    np.testing.assert_allclose(model.dof_armature, [0.1, 0.2, 0.3])
    np.testing.assert_allclose(model.dof_damping, [3, 3, 3])
    np.testing.assert_allclose(model.dof_frictionloss, [4, 7, 4])
    assert all(row.error < 1e-9 and not row.left_out for row in handed.rows)


@pytest.mark.parametrize("law", ["lugre", "lugre_tied"])
def test_a_bristle_moves_in_mujoco_as_in_our_simulation(tmp_path, law):
    mujoco = pytest.importorskip("mujoco", minversion="3.7")
    values = {n: v for n, v in LUGRE.items() if law == "lugre" or n != "sigma_1"}
    path = mjcf(tmp_path)
    arm = Arm.of(Robot.read(path), law, values)
    handed = hand_on(arm, path, tmp_path / "out", swing(), ["mjcf"])
    assert all(row.error < 1e-9 and not row.left_out for row in handed.rows)
    model = mujoco.MjModel.from_xml_path(str(handed.files["mjcf"][0]))
    model.opt.timestep = 1e-4
    data, start = mujoco.MjData(model), np.array([0.2, -0.5, 0.3])
    data.qpos[:] = start
    gravity = arm.robot.inverse_dynamics(start[None], np.zeros((1, 3)), np.zeros((1, 3)))[0]
    t = np.arange(401) / 1000
    push = gravity + np.array([9.0, 6.0, 5.0]) * np.sin(np.outer(t, [8.0, 12.0, 10.0]))
    theirs = []
    for k in range(len(t)):
        theirs.append(data.qpos.copy())
        for j in range(10):
            data.qfrc_applied[:] = push[k] + (push[min(k + 1, 400)] - push[k]) * j / 10
            mujoco.mj_step(model, data)
    ours = simulate(arm, t, push, start)
    assert np.ptp(ours.q, axis=0).max() > 0.02
    assert np.abs(ours.q - theirs).max() < 0.02 * np.ptp(ours.q, axis=0).max()


@pytest.mark.parametrize("kind", ["mjcf", "urdf"])
def test_estimated_bodies_give_mujoco_and_pinocchio_the_arms_torques(tmp_path, kind):
    mujoco = pytest.importorskip("mujoco")
    path = mjcf(tmp_path) if kind == "mjcf" else urdf(tmp_path, "continuous")
    text = path.read_text()
    if kind == "mjcf":  # a tool that is fixed to the last link, whose frame is turned
        tool = '<body name="tool" pos="0.1 0 0"><inertial pos="0 0 0" mass="0.5" diaginertia="1e-3 1e-3 1e-3"/></body>'
        text = text.replace("</body></body></body>", f"{tool}</body></body></body>")
        text = text.replace('name="j3" axis', 'name="j3" pos="0.05 0 0.02" axis').replace(
            '"link_2"', '"link_2" euler="20 0 0"'
        )
    else:
        text = text.replace('name="finger" type="prismatic"', 'name="finger" type="fixed"')
    path.write_text(text)
    robot = Robot.read(path)
    base = Base.of(robot)
    heavier = robot.inertial.reshape(-1, 10) * np.array([[1.2], [0.8], [1.1]])
    inertial, misfit = bodies_of(robot, base, base.values(heavier.reshape(-1)))
    assert misfit < 1e-8
    arm = Arm.of(robot, "coulomb_viscous", PLAIN)
    arm = Arm(robot.with_inertia(inertial, np.array([0.1, 0.2, 0.3])), arm.mechanisms, arm.values, estimated=True)
    handed = hand_on(arm, path, tmp_path / "out", swing(), ["mjcf"] if kind == "mjcf" else ["mjcf", "urdf"])
    model = mujoco.MjModel.from_xml_path(str(handed.files["mjcf"][0]))
    model.dof_damping[:], model.dof_frictionloss[:] = 0, 0
    data, motion = mujoco.MjData(model), [x[::400] for x in swing()[1:]]
    expected, found = arm.robot.inverse_dynamics(*motion), []
    for row in zip(*motion, strict=True):
        data.qpos[:], data.qvel[:], data.qacc[:] = row
        mujoco.mj_inverse(model, data)
        found.append(data.qfrc_inverse.copy())
    np.testing.assert_allclose(found, expected, atol=1e-5)  # MuJoCo writes six digits of a frame
    assert np.abs(expected - robot.inverse_dynamics(*motion)).max() > 1
    if kind == "urdf":
        read = Robot.read(handed.files["urdf"][0])
        np.testing.assert_allclose(read.inverse_dynamics(*motion), expected - arm.armature * motion[2], atol=1e-6)


def test_a_urdf_holds_damping_and_friction_and_says_what_it_loses(tmp_path):
    path = urdf(tmp_path)
    arm = Arm.of(Robot.read(path, locked={"finger": 0.0}), "lugre", LUGRE, armature=[0.5, 0, 0])
    handed = hand_on(arm, path, tmp_path / "out", swing(), ["urdf"])
    joints = {item.get("name"): item for item in ET.parse(handed.files["urdf"][0]).iter("joint")}
    dynamics = {name: item.find("dynamics").attrib for name, item in joints.items() if name != "finger"}
    first = by_joint(handed, "urdf")[0]
    assert float(dynamics["j1"]["friction"]) == pytest.approx(first.values["mu_c"])
    assert float(dynamics["j1"]["damping"]) == pytest.approx(first.values["sigma_2"])
    assert {"sigma_0", "sigma_1", "mu_s", "v_s"} == set(first.left_out)
    t, q, v, a = swing()
    friction = arm.torques(t, q, v, a)[1][:, 0]
    columns = np.stack([np.sign(v[:, 0]), v[:, 0]], axis=1)
    best = np.linalg.lstsq(columns, friction, rcond=None)[0]
    np.testing.assert_allclose([first.values["mu_c"], first.values["sigma_2"]], best, rtol=1e-3)
    theirs = columns @ best
    off = np.sqrt(np.mean((theirs - friction) ** 2) / np.mean(friction**2))
    assert first.error == pytest.approx(off, rel=0.02) and off > 0.02
    assert first.inertia_error == pytest.approx(0.5 * np.sqrt(np.mean(a[:, 0] ** 2) / np.mean(friction**2)))
    told = json.loads((tmp_path / "out" / "urdf" / "torque_error.json").read_text())
    assert told[0]["error"] == first.error and "left out" in (tmp_path / "out" / "torque_error.txt").read_text()


def test_isaac_lab_gets_an_actuators_arguments_by_joint(tmp_path):
    path = urdf(tmp_path)
    arm = Arm.of(
        Robot.read(path, locked={"finger": 0.0}), "stribeck", {n: LUGRE[n] for n in ("mu_c", "mu_s", "v_s", "sigma_2")}
    )
    handed = hand_on(arm, path, tmp_path / "out", swing(), ["isaaclab"])
    table = json.loads(handed.files["isaaclab"][0].read_text())
    assert set(table) == {"joint_names_expr", "armature", "friction", "dynamic_friction", "viscous_friction"}
    assert table["joint_names_expr"] == ["j1", "j2", "j3"] == list(table["friction"])
    assert table["friction"]["j1"] > table["dynamic_friction"]["j1"] > 4


def bam_friction(p, load, v):
    """Friction of bam's models M1 to M4 as their paper gives it; load of both sides of the gear."""
    shape = np.exp(-(np.abs(v / p.get("dtheta_stribeck", 1.0)) ** p.get("alpha", 1.0)))
    dry = p["friction_base"] + p.get("load_friction_base", 0) * load
    dry = dry + shape * (p.get("friction_stribeck", 0) + p.get("load_friction_stribeck", 0) * load)
    return np.sign(v) * dry + p["friction_viscous"] * v


def test_bams_parameters_give_the_friction_that_is_told(tmp_path):
    path = urdf(tmp_path)
    robot = Robot.read(path, locked={"finger": 0.0})
    stribeck = {n: LUGRE[n] for n in ("mu_c", "mu_s", "v_s", "sigma_2")} | {"alpha": 1.5, "joint_2.load_friction": 0.05}
    arm = Arm.of(robot, "stribeck", stribeck, {"joint_2": ["load_friction"]})
    handed = hand_on(arm, path, tmp_path / "out", swing(), ["bam"])
    tables = [json.loads(path.read_text()) for path in handed.files["bam"]]
    assert [table["model"] for table in tables] == ["m2", "m4", "m2"]
    t, q, v, a = swing()
    bodies, friction = arm.torques(t, q, v, a)
    bias = robot.inverse_dynamics(q, v, 0 * a)
    for k, (table, row) in enumerate(zip(tables, handed.rows, strict=True)):
        theirs = bam_friction(table, np.abs(bias + bodies + friction)[:, k], v[:, k])
        off = np.sqrt(np.mean((theirs - friction[:, k]) ** 2) / np.mean(friction[:, k] ** 2))
        assert off == pytest.approx(row.error, abs=2e-3)
    assert handed.rows[0].error < 1e-6 < handed.rows[1].error < 0.05 and not handed.rows[1].left_out


def test_what_a_form_lacks_is_told_by_parameter(tmp_path):
    path = mjcf(tmp_path)
    effects = {"joint_1": ["load_friction", "ripple"], "joint_2": ["load_friction"]}
    arm = Arm.of(Robot.read(path), "coulomb_viscous", PLAIN | {"joint_2.load_friction": 0.1}, effects)
    handed = hand_on(arm, path, tmp_path / "out", swing(), ["isaaclab", "bam"])
    assert [row.left_out for row in by_joint(handed, "isaaclab")] == [(), ("load_friction",), ()]
    assert [row.left_out for row in by_joint(handed, "bam")] == [(), (), ()]
    assert by_joint(handed, "isaaclab")[1].error > 0.02 > by_joint(handed, "isaaclab")[0].error


@pytest.mark.parametrize(("form", "said"), [("usd", "export is 'usd'"), ("urdf", "a URDF is made from a URDF alone")])
def test_a_form_that_cannot_be_is_refused_in_a_line(tmp_path, form, said):
    path = mjcf(tmp_path)
    with pytest.raises(UserError) as caught:
        hand_on(Arm.of(Robot.read(path)), path, tmp_path / "out", swing(), [form])
    assert said in str(caught.value) and "\n" not in str(caught.value)


def test_bodies_that_cannot_exist_give_way_to_the_nearest_that_can(tmp_path):
    robot = Robot.read(mjcf(tmp_path))
    base = Base.of(robot)
    beta = base.values(robot.inertial)
    impossible = beta * np.where(np.arange(len(beta)) == int(np.argmax(beta)), -1.0, 1.0)
    inertial, misfit = bodies_of(robot, base, impossible)
    assert misfit > 0.01
    for m, x, y, z, *_ in inertial.reshape(-1, 10):
        assert m > 0 and np.isfinite([x, y, z]).all()
    q = np.random.default_rng(0).uniform(-2, 2, (20, 3))
    robot = robot.with_inertia(inertial, np.zeros(3))
    assert all(np.linalg.eigvalsh(robot.linearised(x, 0 * x, 0 * x)[3]).min() > 0 for x in q)


def test_the_guide_to_handing_on_runs_as_printed(tmp_path, monkeypatch, capsys):
    urdf(tmp_path)
    monkeypatch.chdir(tmp_path)
    exec(block("python", "print(hand_on(arm"), {})
    assert "urdf joint_1" in capsys.readouterr().out
    assert {path.name for path in (tmp_path / "handed_on").iterdir()} == {*FORMS, "torque_error.txt"}
