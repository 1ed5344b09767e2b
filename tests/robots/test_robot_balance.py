"""Identification and diagnosis of an arm whose truth is known: torques of a given motion, noise and all."""

from dataclasses import replace

import numpy as np
import pytest
from arms import mjcf, urdf

pytest.importorskip("pinocchio")

from frictionpinn.data.recording import Recording, Trial
from frictionpinn.errors import UserError
from frictionpinn.physics import LAWS
from frictionpinn.physics.friction import CONTACT_LAWS
from frictionpinn.physics.robot import Base, Robot
from frictionpinn.robots.balance import friction_of
from frictionpinn.robots.diagnose import diagnose
from frictionpinn.robots.identify import (
    begun_anew,
    declare,
    identify,
    independent_armatures,
    joint_effect,
    narrowed,
    relative_errors,
    without_motors,
)
from frictionpinn.robots.least_squares import solve
from frictionpinn.robots.motion import cutoff, fitted_smoothers, prepare
from frictionpinn.robots.rounds import Settings

MU, VISCOUS = np.array([6.0, 8.0, 4.0]), np.array([3.0, 5.0, 2.0])
ARMATURE = np.array([0.0, 0.0, 0.2])  # those of the first two joints are among their bodies' base parameters


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    return Robot.read(urdf(tmp_path_factory.mktemp("arm")), locked={"finger": 0.0})


def motion(seed, duration, rate=200.0):
    """Fourier series, a few seconds a period, that visit much of the workspace."""
    rng, t = np.random.default_rng(seed), np.arange(int(duration * rate)) / rate
    q, v, a = np.zeros((3, len(t), 3))
    for k in range(3):
        for w in rng.uniform(0.5, 3.0, 4):
            size, phase = rng.uniform(0.2, 0.5), rng.uniform(0, 6)
            q[:, k] += size * np.sin(w * t + phase)
            v[:, k] += size * w * np.cos(w * t + phase)
            a[:, k] -= size * w**2 * np.sin(w * t + phase)
    return t, q, v, a


def recorded(robot, seed=0, duration=25.0, change=None, noise=0.02, rate=200.0):
    """A recording of the arm with Coulomb and viscous friction; ``change(q, v, load, friction)`` gives other friction,
    ``load`` the torque of the bodies."""
    t, q, v, a = motion(seed, duration, rate)
    load = robot.inverse_dynamics(q, v, a)
    friction = MU * np.sign(v) + VISCOUS * v
    if change is not None:
        friction = change(q, v, load, friction)
    tau = load + ARMATURE * a + friction
    rng = np.random.default_rng([seed, 1])
    tau = tau + noise * np.sqrt(np.mean(tau**2, axis=0)) * rng.standard_normal(tau.shape)
    q = q + 1e-5 * rng.standard_normal(q.shape)
    signals = {f"q_{k + 1}": q[:, k] for k in range(3)} | {f"tau_{k + 1}": tau[:, k] for k in range(3)}
    units = {n: "rad" if n.startswith("q") else "N*m" for n in signals}
    return Recording((Trial("run", t, signals, start=0.0),), units, "test")


@pytest.mark.parametrize("name", ["load_friction", "load_direction"])
def test_friction_stays_bounded_at_loads_at_which_its_dry_part_would_be_negative(name):
    friction, t = friction_of(LAWS["lugre"](), (joint_effect(name),), True), np.arange(2000) * 1e-3
    values = {"preload": 1.0, "sigma_0": 1e4, "sigma_1": 1.0, "sigma_2": 0.0, "mu_c": 1.0, "mu_s": 1.2, "v_s": 0.05,
              "alpha": 2.0, name: -0.1}  # fmt: skip
    v, load = np.sin(5 * t), 30.0 * np.cos(3 * t)
    force = friction.force({"t": t, "v": v, "load": load}, [values[n] for n in friction.names])
    assert np.abs(force).max() < 2 * (1.2 + 0.1 * 30.0)


def ready(robot, recording, hz=15.0):
    base = Base.of(robot)
    return base, prepare(recording, robot, base, hz)


def test_an_arm_is_identified_with_intervals_that_hold_the_truth(robot):
    base, trials = ready(robot, recorded(robot))
    solution = identify(declare(robot, base, LAWS["coulomb_viscous"]()), trials)
    values = solution.model.values
    truth = {f"joint_{k + 1}.{n}": x[k] for k in range(3) for n, x in (("mu_c", MU), ("sigma_2", VISCOUS))}
    truth |= {"armature.joint_3": 0.2}
    for name, value in truth.items():
        assert abs(values[name] - value) < 4 * solution.errors[name] + 0.02 * value, name
    assert relative_errors(solution.model, trials)["run"].max() < 0.03  # noise: 2 % of the torque, and of positions
    assert independent_armatures(robot, base) == [2]


def test_thinned_samples_tell_dry_friction_without_bias(robot):
    """Where a velocity turns between two samples its sign errs as an input does: friction is told too small."""
    base = Base.of(robot)
    off = []
    for seed in range(3):
        trials = prepare(recorded(robot, seed, noise=0.001, rate=1000.0), robot, base)
        assert trials[0].t[1] - trials[0].t[0] > 1.5e-3
        values = identify(declare(robot, base, LAWS["coulomb_viscous"]()), trials).model.values
        off.append([values[f"joint_{k + 1}.mu_c"] / MU[k] - 1 for k in range(3)])
    assert np.abs(np.mean(off, axis=0)).max() < 8e-4, off


def test_what_is_fixed_stays_where_it_is(robot):
    base, trials = ready(robot, recorded(robot, duration=8.0))
    fixed = {"armature.joint_3": 0.1, "joint_1.mu_s": 3.0, "v_s": 0.1}  # 3 N m: below the Coulomb friction of the arm
    start = {"joint_2.v_s": 0.7, "armature.joint_3": 5.0}
    model = declare(robot, base, LAWS["stribeck"](), fixed=fixed, start=start)
    solution = identify(model, trials)
    values = solution.model.values
    assert values["armature.joint_3"] == 0.1 and values["joint_2.v_s"] == 0.1
    assert values["joint_1.mu_s"] == 3.0 >= values["joint_1.mu_c"]
    assert not {"armature.joint_3", "joint_1.mu_s", "joint_2.v_s"} & {*solution.model.free}
    with pytest.raises(UserError, match=r"friction\.fixed is 'Izz'"):
        declare(robot, base, LAWS["stribeck"](), fixed={"Izz": 1.0})


def test_torques_behind_the_gears_hold_no_inertia_of_motors(tmp_path):
    robot = Robot.read(mjcf(tmp_path))
    base = Base.of(robot)
    (trial,) = prepare(recorded(robot, duration=8.0), robot, base, 15.0)
    model = without_motors(declare(robot, base, CONTACT_LAWS["none"](), inertia="known"))
    load = trial.filtered(trial.full @ robot.inertial)
    np.testing.assert_allclose(model.recorded(trial), load, atol=1e-9 * np.abs(load).max())


def test_load_dependence_is_estimated_without_bias_where_the_inertia_is_free(robot):
    def change(q, v, load, friction):
        return friction + np.array([0, 0.06, 0]) * np.abs(load) * np.sign(v)

    base, trials = ready(robot, recorded(robot, change=change))
    model = declare(robot, base, LAWS["coulomb_viscous"](), {"joint_2": ["load_friction"]})
    solution = identify(model, trials)
    low, high = solution.interval("joint_2.load_friction", 0.997)
    assert low < 0.06 < high and high - low < 0.02


@pytest.mark.parametrize("law", ["coulomb_viscous", "stribeck", "lugre"])
def test_derivatives_are_those_of_what_is_recorded(robot, law):
    base, trials = ready(robot, recorded(robot, duration=6.0))
    model = declare(robot, base, LAWS[law](), ["load_friction"])
    model = model.with_values(**{f"joint_{k}.load_friction": 0.05 for k in (1, 2, 3)})
    columns = model.columns(trials[0], model.free)
    rng = np.random.default_rng(0)
    for c in rng.choice(len(model.free), 6, replace=False):
        name = model.free[c]
        size = 1e-5 * max(abs(model.values[name]), 1e-2)
        sides = [model.with_values(**{name: model.values[name] + s * size}).recorded(trials[0]) for s in (1, -1)]
        expected = (sides[0] - sides[1]) / (2 * size)
        # Of a bristle, the derivative in the load is that of a load that changes slowly.
        near = 1e-4 if law != "lugre" or not name.startswith("inertia") else 0.05
        np.testing.assert_allclose(columns[:, :, c], expected, atol=near * np.abs(expected).max() + 1e-7)


CASES = {
    "load_friction@joint_2": lambda q, v, load, f: f + np.array([0, 0.06, 0]) * np.abs(load) * np.sign(v),
    "constant_force@joint_1": lambda q, v, load, f: f + np.array([1.5, 0, 0]),
    "ripple@joint_3 (force)": lambda q, v, load, f: f + np.array([0, 0, 1]) * np.sin(4 * q),
    "asymmetry@joint_3": lambda q, v, load, f: f + np.array([0, 0, 0.15]) * MU * np.abs(np.sign(v)),
}


@pytest.mark.parametrize("name", ["", "load_friction@joint_2", "ripple@joint_3 (force)"])
def test_the_missing_effect_is_named_in_its_joint_and_nothing_on_a_clean_arm(robot, name):
    base, trials = ready(robot, recorded(robot, seed=3, change=CASES.get(name)))
    settings = Settings(
        joints=("load_friction", "constant_force", "asymmetry", "ripple", "drag"), robot=("gain_error",)
    )
    d = diagnose(declare(robot, base, LAWS["coulomb_viscous"]()), trials, (), settings)
    assert [a.term.name for a in d.accepted] == ([name] if name else [])
    assert not d.rest


def test_what_no_name_covers_is_unexplained_with_its_variable(robot):
    base, trials = ready(robot, recorded(robot, seed=4, change=CASES["ripple@joint_3 (force)"]))
    d = diagnose(declare(robot, base, LAWS["coulomb_viscous"]()), trials, (), Settings(joints=("drag",), robot=()))
    assert d.verdicts["joint_3"] == "unexplained" and d.rest["joint_3"].variables[0] == "position"
    assert d.verdicts["joint_1"] == "nothing missing"


def test_a_gain_error_and_a_payload_are_found_with_their_size(robot):
    first, second = recorded(robot, seed=5), recorded(robot, seed=6)
    (trial,) = second.trials
    _, q, v, a = motion(6, 25.0)
    carried = robot.payload_regressor(robot.regressor(q, v, a)) @ [2.0, 0.3, 0.0, 0.1]
    loaded = {f"tau_{k + 1}": trial.signals[f"tau_{k + 1}"] + carried[:, k] for k in range(3)}
    both = [*first.trials, replace(trial, name="loaded", signals=trial.signals | loaded)]
    trials = tuple(replace(t, signals=t.signals | {"tau_2": 1.2 * t.signals["tau_2"]}) for t in both)
    base, ready_ = ready(robot, replace(first, trials=trials))
    settings = Settings(joints=(), robot=("payload", "gain_error"), suspected=("loaded",))
    d = diagnose(declare(robot, base, LAWS["coulomb_viscous"]()), ready_, (), settings)
    assert {a.term.name for a in d.accepted} == {"payload", "gain_error@joint_2"}
    assert d.fit.model.values["joint_2.gain_error"] == pytest.approx(0.2, abs=0.02)
    assert d.fit.model.values["payload.mass"] == pytest.approx(2.0, rel=0.03)


def test_a_leaning_base_is_named_alone_though_a_level_one_hides_some_of_its_moments(robot):
    level = robot.model.gravity.linear.copy()
    robot.model.gravity.linear = level + 9.81 * np.array([0.04, -0.02, 0.0])
    recording = recorded(robot)
    robot.model.gravity.linear = level
    base, trials = ready(robot, recording)
    settings = Settings(joints=("constant_force", "ripple", "asymmetry"), robot=("base_tilt", "coupling"))
    found = diagnose(declare(robot, base, LAWS["coulomb_viscous"]()), trials, settings=settings)
    assert [a.term.name for a in found.accepted] == ["base_tilt"]
    for name, value in (("base.tilt_x", 0.04), ("base.tilt_y", -0.02)):
        low, high = found.fit.interval(name)
        assert low - 0.001 < value < high + 0.001


def test_a_search_that_ended_far_off_begins_anew(robot):
    def stribeck(q, v, load, friction):
        return friction + MU * np.sign(v) * np.exp(-((v / 0.1) ** 2))

    base, trials = ready(robot, recorded(robot, change=stribeck))
    right = identify(declare(robot, base, LAWS["stribeck"]()), trials)
    away = right.model.with_values(**{"joint_2.v_s": 50.0, "joint_2.mu_s": right.model.values["joint_2.mu_c"]})
    astray = solve(replace(away, priors={}).held_near(), trials)
    assert astray.cost > right.cost + 10
    assert begun_anew(astray).cost < right.cost + 1
    assert begun_anew(right) is right


def test_a_stribeck_curve_as_wide_as_the_motion_is_held_narrow_and_its_coulomb_friction_comes_back(robot):
    base, trials = ready(robot, recorded(robot))
    right = identify(declare(robot, base, LAWS["stribeck"]()), trials)
    dry = {"joint_2.mu_s": right.model.values["joint_2.mu_c"], "joint_2.mu_c": 1e-6, "joint_2.v_s": 50.0}
    wide = replace(right, model=right.model.with_values(**dry))
    narrow, names = narrowed(wide)
    assert names == ("joint_2.v_s",) and names[0] not in narrow.model.free
    assert narrow.model.values["joint_2.v_s"] < 0.1
    assert narrow.model.values["joint_2.mu_c"] == pytest.approx(right.model.values["joint_2.mu_c"], rel=0.1)
    assert narrowed(narrow) == (narrow, ())


def test_no_channel_is_ahead_of_the_torque_that_it_shows(robot):
    base, (trial,) = ready(robot, recorded(robot))
    early = replace(trial, tau=np.stack([np.interp(trial.compared + [0, 0.03, 0][k], trial.compared, tau)
                                         for k, tau in enumerate(trial.tau.T)], axis=1))  # fmt: skip
    found = diagnose(declare(robot, base, LAWS["coulomb_viscous"]()), [early], settings=Settings(joints=()))
    assert "delay@joint_2" not in [a.term.name for a in found.accepted]


def test_a_stretch_that_gains_most_of_all_does_not_make_a_gain_unsure():
    from frictionpinn.robots.score import Confirmed, certainty

    even, one = np.array([9.0, 11, 10, 300, 12, 8, 10, 14]), np.array([-5.0, -3, 300, 2, -1, 1, -2, 3])
    assert Confirmed(*certainty(even), 1.0).sure(2.0)
    assert not Confirmed(*certainty(one), 1.0).sure(2.0)


def test_stretches_left_out_in_turn_leave_fits_that_keep_their_priors(robot):
    from frictionpinn.robots.least_squares import away
    from frictionpinn.robots.score import Scorer

    base, (trial,) = ready(robot, recorded(robot, duration=12.0))
    found = identify(declare(robot, base, LAWS["lugre"]()), [trial])
    assert not found.told("joint_1.dither")  # but for its prior, nothing says what it is
    scorer, k = Scorer(found), 1
    term = trial.filtered(np.sign(trial.v[:, k]) * trial.q[:, k])[:, None]
    C, r = found.columns[0], found.residuals[0] / found.sigmas
    T = np.zeros((*C.shape[:2], 1))
    T[:, k] = term / found.sigmas[k]
    held, gains = np.sqrt(found.prior), []
    for rows in scorer.folds:
        kept = np.setdiff1d(np.arange(len(C)), np.arange(len(C))[rows])
        left = []
        for X in (C, np.concatenate([C, T], axis=2)):
            pull = np.concatenate([np.diag(held), np.zeros((len(held), X.shape[2] - len(held)))], axis=1)
            A = np.concatenate([X[kept].reshape(-1, X.shape[2]), pull])
            b = np.concatenate([r[kept].ravel(), held * away(found.model)])
            step = -np.linalg.lstsq(A, b, rcond=1e-12)[0]
            left.append(0.5 * np.sum((r[rows] + X[rows] @ step) ** 2))
        gains.append(left[0] - left[1])
    assert scorer.confirmed([term], (k,)).gain == pytest.approx(sum(gains), rel=1e-4, abs=1e-3)


def test_the_low_pass_is_found_from_noise_and_rate(robot):
    quiet, noisy = recorded(robot), recorded(robot)
    (trial,) = noisy.trials
    rough = {n: y + 1e-2 * np.random.default_rng(0).standard_normal(len(y)) if n.startswith("q") else y
             for n, y in trial.signals.items()}  # fmt: skip
    rough_one = replace(noisy, trials=(replace(trial, signals=rough),))
    of_rough, of_quiet = (cutoff(r, fitted_smoothers(r, 3)) for r in (rough_one, quiet))
    assert 3 * of_rough < of_quiet <= 20.0
