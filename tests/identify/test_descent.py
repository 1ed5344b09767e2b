"""Coarse to fine in time: the way down, and where it ends."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from frictionpinn.data.noise import GaussianNoise
from frictionpinn.data.simulated import simulate_recording, simulate_trials
from frictionpinn.identify import Problem, bound, maximum_likelihood
from frictionpinn.identify.bound import bound_of
from frictionpinn.identify.likelihood import beginnings
from frictionpinn.identify.profile import profiled
from frictionpinn.numerics import parallel
from frictionpinn.numerics.descent import KNOWN, NEAR, Solution, coarse_to_fine, levenberg_marquardt
from frictionpinn.numerics.minima import assembled
from frictionpinn.numerics.quadratic import Known, Piece, State
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.mechanism import Mechanism

SYSTEM = SYSTEMS["drive"](M=1.36)
TRUTH = {"sigma_0": 20200.0, "sigma_1": 243.0, "sigma_2": 0.119, "mu_c": 2.67, "mu_s": 4.8, "v_s": 4.6e-3}
TRIALS = [
    {"duration": 1.3, "force": "7.412*sin(2*pi*1.203*t + 0.59*sin(2*pi*1.203*t))"},
    {"duration": 1.7, "force": "6.518*sin(2*pi*0.890*t + 0.19*sin(2*pi*0.890*t))"},
    {"duration": 2.0, "force": "4.795*sin(2*pi*(1.072*t + 0.430*t**2/2))"},
    {"duration": 1.5, "force": "5.236*sin(2*pi*1.545*t + 0.17*sin(2*pi*1.545*t))"},
]


@pytest.fixture(scope="module")
def drive():
    clean = simulate_recording(SYSTEM, "lugre", TRUTH, TRIALS, 100.0)
    return Mechanism(SYSTEM, LAWS["lugre"]()), clean, GaussianNoise(0.011)(clean, 21)


def test_resolutions_end_at_the_single_sample(drive):
    widths = Problem(drive[0], drive[2]).resolutions
    assert widths[-1] == 0.0 and widths[-2] >= 0.01
    assert widths == sorted(widths, reverse=True)


def test_from_coarse_to_fine_gets_where_the_single_sample_does_not(drive):
    mechanism, clean, noisy = drive
    problem = Problem(mechanism, noisy, sigmas=GaussianNoise(0.011).levels(clean))
    off = {"sigma_0": 0.6, "sigma_1": 0.9, "sigma_2": 0.92, "mu_c": 1.03, "mu_s": 1.11, "v_s": 1.19}
    u = problem.space.to_search(np.array([TRUTH[n] * off[n] for n in problem.names]))
    models = problem.models_at(u)
    evaluate, locals_ = problem.evaluator(models), tuple(model.local for model in models)
    down = coarse_to_fine(evaluate, State(u, locals_, ()), problem.space.limits, problem.resolutions)
    plain = levenberg_marquardt(evaluate, evaluate(u, locals_, True), problem.space.limits)
    assert down.state.cost < plain.state.cost - 50


def test_a_fit_is_not_behind_one_that_starts_at_the_truth(drive):
    mechanism, _, noisy = drive
    estimate = maximum_likelihood(mechanism, noisy)
    problem = Problem(mechanism, noisy, sigmas=estimate.sigmas)
    u = problem.space.to_search(np.array([TRUTH[n] for n in problem.names]))
    models = problem.models_at(u)
    first = State(u, tuple(model.local for model in models), ())
    reference = coarse_to_fine(problem.evaluator(models), first, problem.space.limits, problem.resolutions)
    assert estimate.outcome == "converged"
    assert estimate.cost < reference.state.cost + 2
    for name, (low, high) in estimate.ci95.items():
        assert low / 1.1 < TRUTH[name] < high * 1.1


@pytest.mark.parametrize("workers", [2, 8])
def test_a_fit_is_the_same_whatever_the_number_of_threads(drive, monkeypatch, workers):
    mechanism, _, recording = drive

    def fitted(count):
        monkeypatch.setattr(parallel, "WORKERS", count)
        with ThreadPoolExecutor(max(1, count - 1)) as pool:
            monkeypatch.setattr(parallel, "_POOL", pool)
            return maximum_likelihood(Problem(mechanism, recording))

    one, many = fitted(1), fitted(workers)
    assert one.values == many.values and one.cost == many.cost
    np.testing.assert_array_equal(one.covariance, many.covariance)


def test_a_search_ends_where_it_comes_back_to_a_known_minimum_and_goes_on_where_another_is_lower():
    def evaluate(u, locals_, derivatives, **_):
        """Two wells, at 0 and at 5, the second one lower by 1."""
        x, bottom = (float(u[0]), 0.0) if u[0] < 2.5 else (float(u[0]) - 5.0, -1.0)
        r, slope = x + 0.05 * x**3, 1 + 0.15 * x**2
        piece = Piece(bottom + 50 * r**2, {}, np.array([[100 * slope**2]]), np.zeros((1, 0)), np.zeros((0, 0)),
                      np.array([100 * slope * r]))  # fmt: skip
        return State(np.asarray(u, float), tuple(locals_), (piece,))

    limits = (np.array([-10.0]), np.array([10.0]))
    left = levenberg_marquardt(evaluate, evaluate(np.array([1.0]), [np.zeros(0)], True), limits).state
    for at, reason, minimum in ((-1.5, KNOWN, 0.0), (6.0, "converged", 5.0)):
        found = levenberg_marquardt(
            evaluate, evaluate(np.array([at]), [np.zeros(0)], True), limits, known=[Known.of(left)]
        )
        assert found.reason == reason
        assert reason == KNOWN or found.state.u[0] == pytest.approx(minimum, abs=1e-2)


def test_the_bound_leaves_the_problem_as_it_was_and_counts_no_prior(drive):
    mechanism, clean, noisy = drive
    levels = GaussianNoise(0.011).levels(clean)
    problem = Problem(mechanism, noisy, sigmas=levels, bounds={"mu_s": (5.0, 9.0)})
    before = problem.space
    found = bound_of(problem, TRUTH)
    assert problem.space is before
    few = bound(mechanism, clean.select([clean.trials[0].name]), TRUTH, sigmas={k: 30 * v for k, v in levels.items()})
    assert not few.relative["v_s"] < 1.0  # a prior would make it at most 1.5
    assert found.relative["mu_c"] < 0.01


def test_a_model_that_lacks_an_effect_never_says_converged():
    effect = {"spring_stiffness": 40.0, "spring_rest": 0.0}
    made = simulate_recording(SYSTEM, "lugre", TRUTH | effect, TRIALS, 200.0, ("spring_force",))
    estimate = maximum_likelihood(Mechanism(SYSTEM, LAWS["lugre"]()), GaussianNoise(0.02)(made, 0))
    assert estimate.outcome != "converged"
    assert any("lacks something" in sentence for sentence in estimate.advice)


def test_a_gain_counts_less_where_residuals_exceed_the_noise_or_keep_their_sign():
    rng = np.random.default_rng(0)
    white = rng.standard_normal(20_000)
    slow = np.repeat(white[:200], 100)

    def unit(r: np.ndarray) -> float:
        rows = (float(len(r)), float(r @ r), float(r[1:] @ r[:-1]))
        return State(np.zeros(1), (), (Piece(0.0, {}, rows=rows),)).unit

    assert unit(white) == pytest.approx(1.0, abs=0.05)
    assert unit(3 * white) == pytest.approx(9.0, rel=0.05)
    assert unit(slow) > 5 * unit(white)


def test_damping_does_not_hold_fast_what_a_trials_own_unknown_nearly_stands_for():
    # One parameter, one unknown of the trial, told apart by a hundred-thousandth of the information.
    beside, size = np.sqrt(1 - 1e-5), 1e8
    H, least = size * np.array([[1.0, beside], [beside, 1.0]]), np.array([0.5, -0.5])

    def evaluate(u, locals_, derivatives, **_):
        d = np.array([u[0], locals_[0][0]]) - least
        g = H @ d
        piece = Piece(0.5 * float(d @ g), {}, H[:1, :1], H[:1, 1:], H[1:, 1:], g[:1], g[1:], rows=(1.0, 1.0, 0.0))
        return State(np.asarray(u), tuple(locals_), (piece,))

    start, limits = evaluate(np.zeros(1), [np.zeros(1)], True), (np.array([-9.0]), np.array([9.0]))
    for damping in (0.0, NEAR):
        found = levenberg_marquardt(evaluate, start, limits, iterations=1, damping=damping)
        assert found.state.u[0] == pytest.approx(0.5, abs=1e-3)


def test_viscous_friction_gives_way_to_drag_along_a_straight_line():
    # sigma_2 v + drag v |v|: as logarithms their valley is bent, and a descent along it ends high after many steps.
    mechanism = Mechanism(SYSTEMS["drive"](), LAWS["coulomb_viscous"](), ("drag",))
    truth = {"mu_c": 3.0, "sigma_2": 0.05, "drag": 2.0}
    trials = [{"duration": 3.0, "force": "8*sin(3*pi*t)"}, {"duration": 3.0, "force": "6*sin(2*pi*t)+3*sin(5*pi*t)"}]
    noisy = GaussianNoise(0.01)(simulate_trials(mechanism, truth, trials, 500.0), 1)
    problem = Problem(mechanism, noisy, free=tuple(truth))

    def descended(start: dict[str, float]) -> float:
        u = problem.space.to_search(np.array([start[name] for name in problem.names]))
        models = problem.models_at(u)
        evaluate = problem.evaluator(models)
        first = evaluate(u, tuple(model.local for model in models), True)
        return levenberg_marquardt(evaluate, first, problem.space.limits, iterations=8).state.cost

    all_viscous = descended({"mu_c": 3.0, "sigma_2": 3.0, "drag": 0.0})
    assert all_viscous == pytest.approx(descended(truth), abs=0.5)


def test_only_laws_without_memory_leave_out_what_is_beside_a_jump(drive):
    trials = [{"duration": 2.0, "force": "6*sin(4*pi*t)"}]
    clean = simulate_recording(SYSTEM, "coulomb", {"mu_c": 3.0}, trials, 200.0)
    for law, left_out in (("coulomb", True), ("lugre", False)):
        (model,) = Problem(Mechanism(SYSTEM, LAWS[law]()), GaussianNoise(0.01)(clean, 1)).trials
        missing = np.isnan(dict(zip(model.outputs, model.y, strict=True))["a"])
        assert missing.any() == left_out and missing.mean() < 0.2


def test_a_profile_that_never_rises_reaches_from_nothing_to_infinity(drive):
    mechanism, _, noisy = drive
    problem = Problem(mechanism, noisy)
    n = len(problem.names)

    def evaluate(u, locals_, derivatives, **_):
        flat = Piece(0.0, {}, 1e-9 * np.eye(n), np.zeros((n, 0)), np.zeros((0, 0)), np.zeros(n), rows=(1.0, 1.0, 0.0))
        return State(np.asarray(u), tuple(locals_), (flat,))

    start = evaluate(problem.space.to_search(TRUTH), [np.zeros(0)], True)
    low, high = profiled(problem, evaluate, start, "sigma_0", 1.92, iterations=2).ci95
    assert (low, high) == (0.0, np.inf)
    assert profiled(problem, evaluate, start, "mu_s", 1.92, iterations=2).ci95[0] == pytest.approx(TRUTH["mu_c"])


@pytest.mark.parametrize("wall", [0.0, 40.0])
def test_a_stop_that_a_profile_loses_makes_no_interval_narrow(drive, wall):
    mechanism, _, noisy = drive
    problem = Problem(mechanism, noisy)
    n, fit = len(problem.names), problem.space.to_search(TRUTH)
    i = problem.names.index("sigma_0")

    def evaluate(u, locals_, derivatives, **_):
        away = np.asarray(u) - fit
        cost = 50.0 * float(away @ away) + (wall if away[i] > 0.01 else 0.0)  # a stop passes a sample, and none follows
        own = Piece(cost, {}, 100.0 * np.eye(n), np.zeros((n, 0)), np.zeros((0, 0)), 100.0 * away, rows=(1.0, 1.0, 0.0))
        return State(np.asarray(u), tuple(locals_), (own,))

    start = evaluate(fit, [np.zeros(0)], True)
    low, high = profiled(problem, evaluate, start, "sigma_0", 1.92, iterations=2).ci95
    assert np.log(TRUTH["sigma_0"] / low) == pytest.approx(0.196, rel=0.05)
    assert np.log(high / TRUTH["sigma_0"]) == pytest.approx(0.196, rel=0.05)


def test_a_body_that_begins_at_rest_is_not_left_sliding_the_wrong_way():
    law, truth = LAWS["stribeck"](), {n: TRUTH[n] for n in ("mu_c", "mu_s", "v_s", "sigma_2")}
    clean = simulate_recording(SYSTEM, "stribeck", truth, TRIALS, 500.0)  # each begins at rest
    problem = Problem(Mechanism(SYSTEM, law), GaussianNoise(0.05)(clean, 1), sigmas=GaussianNoise(0.05).levels(clean))
    u, models = problem.space.to_search(np.array([truth[n] for n in problem.names])), problem.trials
    evaluate, limits = problem.evaluator(models), problem.space.limits

    def ended(velocity: float) -> Solution:
        locals_ = [model.local.copy() for model in models]
        for model, x in zip(models, locals_, strict=True):
            x[model.states.index("v")] = velocity
        return levenberg_marquardt(evaluate, evaluate(u, locals_, True), limits)

    right, wrong = ended(0.0), ended(0.01)
    assert wrong.state.cost > right.state.cost + 10
    begun = [coarse_to_fine(evaluate, state, limits, [0.0]) for state in beginnings(problem, wrong.state)]
    found = assembled(evaluate, wrong, [end.state.locals for end in begun], limits)
    assert found.state.cost < right.state.cost + 2.0


def test_the_stiffness_of_a_contact_that_hardly_slips_is_told():
    soft, trials = (
        TRUTH | {"sigma_0": 300.0, "sigma_1": 20.0},
        [{"duration": 6.0, "force": "2.3*sin(0.8*t) + sin(60*t)"}],
    )
    clean = simulate_recording(SYSTEM, "lugre", soft, trials, 200.0)
    found = maximum_likelihood(Mechanism(SYSTEM, LAWS["lugre"]()), GaussianNoise(0.02)(clean, 1), profiles=False)
    for name in ("sigma_0", "sigma_1"):
        low, high = found.ci95[name]
        assert low <= soft[name] <= high and high < 1.3 * low
