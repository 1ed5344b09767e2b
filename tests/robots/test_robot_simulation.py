"""Simulated robots: against MuJoCo and the house's simulator, energy, stiction, controllers, encoders."""

import numpy as np
import pytest
from arms import mjcf, motions, urdf
from documented import block

from frictionpinn.errors import UserError

pytest.importorskip("pinocchio")

from frictionpinn.numerics.simulate import Simulator
from frictionpinn.physics import LAWS
from frictionpinn.physics.mechanism import Mechanism
from frictionpinn.physics.robot import Robot
from frictionpinn.physics.systems.joint import Joint
from frictionpinn.robots.arm import Arm
from frictionpinn.robots.integration import pd, simulate

LUGRE = {"sigma_0": 3e3, "sigma_1": 5.0, "sigma_2": 3.0, "mu_c": 4.0, "mu_s": 6.0, "v_s": 0.05}
Q0 = np.array([0.2, -0.5, 0.3])
LEAN = np.array([5.0, -5.0, 5.0])  # N m beside gravity: less than the static friction


def pushed(t, q=None, v=None):
    """Torques that move the arm."""
    return np.array([3 * np.sin(2 * t), 10 * np.cos(3 * t), 2 * np.sin(5 * t)])


def wave(t):
    """A motion to follow."""
    w = np.array([5.0, 7.0, 6.0])
    return Q0 + 0.3 * np.sin(w * t), 0.3 * w * np.cos(w * t)


def test_derivatives_of_inverse_dynamics_are_those_of_its_differences(tmp_path):
    robot = Robot.read(urdf(tmp_path, "continuous"), joints=["j3", "j1", "j2"])
    motion = [x[0] for x in motions(1, 3)]
    tau, *slopes = robot.linearised(*motion)
    np.testing.assert_allclose(tau, robot.inverse_dynamics(*(x[None] for x in motion))[0], atol=1e-12)
    for which, slope in enumerate(slopes):
        for k in range(3):
            sides = []
            for d in (1e-6, -1e-6):
                moved = [x.copy() for x in motion]
                moved[which][k] += d
                sides.append(robot.linearised(*moved)[0])
            np.testing.assert_allclose(slope[:, k], (sides[0] - sides[1]) / 2e-6, atol=1e-7)


def test_without_friction_it_moves_as_in_mujoco(tmp_path):
    mujoco = pytest.importorskip("mujoco")
    path, t = mjcf(tmp_path), np.arange(401) / 200
    ours = simulate(Arm.of(Robot.read(path)), t, pushed, Q0)
    model = mujoco.MjModel.from_xml_path(str(path))
    model.dof_damping[:], model.dof_frictionloss[:] = 0, 0
    model.opt.timestep, model.opt.integrator = 5e-3 / 20, mujoco.mjtIntegrator.mjINT_RK4
    data, theirs = mujoco.MjData(model), []
    data.qpos[:] = Q0
    for now in t:
        theirs.append(data.qpos.copy())
        data.qfrc_applied[:] = pushed(now)
        for _ in range(20):
            mujoco.mj_step(model, data)
    assert (np.abs(ours.q - theirs).max(axis=0) < 1e-4 * np.ptp(theirs, axis=0)).all()


def test_energy_changes_by_the_work_of_motors_and_friction(tmp_path):
    t = np.arange(501) / 1000
    arm = Arm.of(Robot.read(mjcf(tmp_path)), "lugre", LUGRE)
    moved = simulate(arm, t, np.array([4 * pushed(s) for s in t]), Q0, [1.0, -1.0, 1.0])
    work = np.trapezoid(((moved.torque - moved.friction) * moved.v).sum(axis=1), t)
    lost = np.trapezoid((moved.friction * moved.v).sum(axis=1), t)
    assert lost > 1 and abs(moved.energy[-1] - moved.energy[0] - work) < 1e-3 * lost


def test_friction_holds_an_arm_against_gravity_and_lets_go_above_its_static_friction(tmp_path):
    t = np.arange(301) / 1000
    robot = Robot.read(mjcf(tmp_path))
    gravity = robot.inverse_dynamics(Q0[None], np.zeros((1, 3)), np.zeros((1, 3)))[0]
    for law, values, creep in (("lugre", LUGRE, 1e-9), ("coulomb", {"mu_c": 6.0}, 1e-5 * 0.3)):
        arm = Arm.of(robot, law, values)
        held = simulate(arm, t, np.tile(gravity + LEAN, (len(t), 1)), Q0)
        assert np.abs(held.q - Q0).max() <= creep  # LuGre: less than a bristle's 2 mrad; Coulomb: its v_t by the time
        freed = simulate(arm, t, np.tile(gravity + 1.6 * LEAN, (len(t), 1)), Q0)
        assert freed.q[-1, 0] - Q0[0] > 0.05
    np.testing.assert_allclose(held.friction[-1], LEAN, rtol=1e-3)


def test_an_arm_pulled_below_its_static_friction_moves_by_what_its_bristles_deflect(tmp_path):
    t = np.arange(301) / 1000
    arm = Arm.of(Robot.read(mjcf(tmp_path)), "lugre", LUGRE)
    gravity = arm.robot.inverse_dynamics(Q0[None], np.zeros((1, 3)), np.zeros((1, 3)))[0]
    pulled = simulate(arm, t, np.array([gravity + 1.5 * (s > 0.1) for s in t]), Q0)
    assert 1.5 / LUGRE["sigma_0"] < np.abs(pulled.q - Q0).max() < LUGRE["mu_s"] / LUGRE["sigma_0"]


@pytest.mark.parametrize("law", ["lugre", "stribeck", "dahl"])
def test_one_joint_moves_as_in_the_simulator_of_mechanisms(tmp_path, law):
    values = {name: v for name, v in LUGRE.items() if name in {par.name for par in LAWS[law].parameters}}
    robot = Robot.read(mjcf(tmp_path), joints=["j3"])
    rest = np.zeros((2, 1))
    W_cos, W_sin = robot.inverse_dynamics(np.array([[0.0], [np.pi / 2]]), rest, rest)[:, 0]
    J = robot.linearised(*np.zeros((3, 1)))[3][0, 0]
    t = np.arange(1001) / 1000
    tau = 12 * np.sin(8 * t) + W_cos
    arm = Arm.of(robot, law, values)
    ours = simulate(arm, t, tau[:, None], [0.1], rtol=1e-7, atol=1e-8)
    mechanism = Mechanism(Joint(J=J, W_cos=W_cos, W_sin=W_sin), LAWS[law]())
    theirs = Simulator(mechanism).simulate(t, {"tau": tau}, values, {"theta": 0.1}, z0="steady", rtol=1e-7, atol=1e-8)
    assert np.ptp(theirs.q) > 0.1
    np.testing.assert_allclose(ours.q, theirs.q, atol=1e-5 * np.ptp(theirs.q))
    apart = ours.friction[:, 0] - theirs.F  # where dry friction turns within a microsecond, samples differ
    assert np.sqrt(np.mean(apart**2)) < 5e-3 * np.abs(theirs.F).max()


def test_torques_of_the_simulated_motion_are_those_that_moved_it(tmp_path):
    values = {"mu_c": 4, "sigma_2": 3, "joint_2.load_friction": 0.05}
    arm = Arm.of(Robot.read(mjcf(tmp_path)), "coulomb_viscous", values, {"joint_2": ["load_friction"]})
    t = np.arange(301) / 1000
    moved = simulate(arm, t, pd(arm, wave, [2000, 2000, 800], [100, 100, 30]), *wave(0.0))
    assert np.abs(moved.q - [wave(s)[0] for s in t]).max() < 0.05
    bodies, friction = arm.torques(t, moved.q, moved.v, moved.a)
    np.testing.assert_allclose(bodies + friction, moved.torque, atol=1e-3)
    fast = np.abs(moved.v[:, 1]) > 1e-2
    ratio = (np.abs(friction[:, 1]) - 3 * np.abs(moved.v[:, 1]))[fast]
    np.testing.assert_allclose(ratio, 4 + 0.05 * np.abs(moved.load[fast, 1]), rtol=1e-6)


def test_encoders_show_steps_to_the_controller_and_to_the_log(tmp_path):
    arm = Arm.of(Robot.read(mjcf(tmp_path)), "coulomb_viscous", {"mu_c": 4, "sigma_2": 3})
    t, seen = np.arange(51) / 1000, []
    follow = pd(arm, wave, 800, 30)

    def controller(now, q, v):
        seen.append((q, v))
        return follow(now, q, v)

    moved = simulate(arm, t, controller, *wave(0.0), encoder_step=1e-3)
    q, v = (np.array(x) for x in zip(*seen, strict=True))
    np.testing.assert_allclose(q / 1e-3, np.round(q / 1e-3), atol=1e-6)
    np.testing.assert_allclose(v[1:], np.diff(q, axis=0) / 1e-3, atol=1e-9)
    log = moved.recording(torque_noise=0.02, seed=3)
    np.testing.assert_array_equal(log.trials[0].signals["q_2"], q[:, 1])
    noise = log.trials[0].signals["tau_1"] - moved.torque[:, 0]
    assert 0.01 < np.std(noise) / np.sqrt(np.mean(moved.torque[:, 0] ** 2)) < 0.03
    assert set(log.units) == set(log.trials[0].signals) | {"v_1", "v_2", "v_3"}


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"t": [0, 0.1, 0.1]}, "times that do not increase"),
        ({"q0": [0, 0]}, "not one number for each joint: q0"),
        ({"torque": np.zeros((2, 2))}, "torques that do not fit: torque is (2, 2)"),
        ({"torque": lambda t, q, v: np.array([1.0])}, "a controller's torque that does not fit"),
    ],
)
def test_a_simulation_that_cannot_be_is_refused_in_a_line(tmp_path, change, said):
    arm = Arm.of(Robot.read(mjcf(tmp_path)))
    given = {"t": [0, 0.1], "torque": np.zeros((2, 3)), "q0": np.zeros(3)} | change
    with pytest.raises(UserError) as caught:
        simulate(arm, **given)
    assert said in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"friction": "lugre"}, "parameter without a value: joint_1.sigma_0"),
        ({"friction": "coulomb", "values": {"mu_c": -1}}, "impossible value: joint_1.mu_c is -1"),
        ({"friction": "coulomb", "values": {"mu_c": 1, "mu_k": 1}}, "unknown parameter: mu_k"),
        ({"friction": ["coulomb"]}, "not one law for each joint"),
        ({"friction": "coulomb", "values": {"mu_c": 1}, "effects": {"joint_4": []}}, "joint_4"),
    ],
)
def test_an_arm_that_cannot_be_is_refused_in_a_line(tmp_path, options, said):
    with pytest.raises(UserError) as caught:
        Arm.of(Robot.read(mjcf(tmp_path)), **options)
    assert said in str(caught.value) and "\n" not in str(caught.value)


def test_the_guide_to_simulation_runs_as_printed(tmp_path, monkeypatch):
    urdf(tmp_path)
    monkeypatch.chdir(tmp_path)
    names = {}
    exec(block("python", "motion = simulate(arm").replace("np.arange(0, 1, 1e-3)", "np.arange(0, 0.1, 1e-3)"), names)
    motion = names["motion"]
    assert np.abs(motion.q - [names["reference"](t)[0] for t in names["t"]]).max() < 0.05
    exec(block("python", "observer = Observer(arm)"), names)
    friction = np.array(motion.friction[-1])
    assert np.abs(names["seen"].friction - friction).max() < 0.1 * np.abs(friction).max()
