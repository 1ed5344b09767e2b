"""Coarse to fine in time: residuals at a resolution, the way down, and what counts as noise."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from frictionpinn.data.noise import GaussianNoise
from frictionpinn.data.simulated import simulate_recording, simulate_trials
from frictionpinn.identify import Problem, bound, maximum_likelihood
from frictionpinn.identify.bound import bound_of
from frictionpinn.identify.likelihood import beginnings
from frictionpinn.identify.profile import profiled
from frictionpinn.numerics import parallel
from frictionpinn.numerics.descent import (
    KNOWN,
    NEAR,
    Piece,
    Solution,
    State,
    coarse_to_fine,
    levenberg_marquardt,
)
from frictionpinn.numerics.jumps import beside_jumps
from frictionpinn.numerics.minima import assembled, carried, lowest_of_trials
from frictionpinn.numerics.resolution import averaged, samples_within
from frictionpinn.numerics.whiteness import SIGNIFICANCE, whiteness
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


def plainly(rows, weight, half):
    """What ``averaged`` says it does, sample by sample."""
    means, result = np.zeros_like(rows), np.zeros_like(rows)
    there = np.zeros(rows.shape[:2])
    for i in range(rows.shape[0]):
        for k in range(rows.shape[1]):
            near = [j for j in range(max(0, k - half), min(rows.shape[1], k + half + 1)) if weight[i, j]]
            if near:
                means[i, k], there[i, k] = rows[i, near].mean(axis=0), 1.0
        for k in range(rows.shape[1]):
            near = [j for j in range(max(0, k - half), min(rows.shape[1], k + half + 1)) if there[i, j]]
            result[i, k] = means[i, near].mean(axis=0) if near else 0.0
    return np.sqrt(half) * result[:, ::half]


@settings(max_examples=40, deadline=None)
@given(st.integers(1, 9), st.integers(20, 60), st.integers(0, 2**31 - 1))
def test_rows_are_averaged_twice_over_what_was_measured(half, n, seed):
    rng = np.random.default_rng(seed)
    rows, weight = rng.standard_normal((2, n, 3)), (rng.random((2, n)) > 0.2).astype(float)
    np.testing.assert_allclose(averaged(rows, weight, half), plainly(rows, weight, half), atol=1e-12)


def test_what_varies_slowly_keeps_its_weight_and_noise_loses_it():
    t = np.arange(4000) / 1000.0
    slow, noise = np.sin(2 * np.pi * 0.5 * t), np.random.default_rng(0).standard_normal(len(t))
    for values, kept in ((slow, (0.97, 1.03)), (noise, (0.0, 0.05))):
        rows = averaged(np.ascontiguousarray(values[None, :, None]), np.ones((1, len(t))), 20)
        assert kept[0] < np.sum(rows**2) / np.sum(values**2) < kept[1]


def test_a_late_stop_costs_more_than_in_proportion_only_at_a_coarse_resolution():
    k = np.arange(400)
    late = np.array([np.where((k >= 200) & (k < 200 + d), 1.0, 0.0) for d in (4, 8)])[:, :, None]
    coarse = np.sum(averaged(late, np.ones((2, 400)), 20) ** 2, axis=(1, 2))
    assert np.sum(late**2, axis=(1, 2))[1] == 2 * np.sum(late**2, axis=(1, 2))[0]
    assert coarse[1] > 3.5 * coarse[0]  # as the square: a descent sees where to go


def test_a_resolution_is_a_time_not_a_number_of_samples():
    assert samples_within(np.arange(0, 2, 0.01), 0.05) == 5
    assert samples_within(np.arange(0, 2, 0.001), 0.05) == pytest.approx(50, abs=1)
    assert samples_within(np.arange(0, 2, 0.01), 0.0) == 0


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
        found = levenberg_marquardt(evaluate, evaluate(np.array([at]), [np.zeros(0)], True), limits, known=[left])
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


def test_white_noise_is_noise_and_ringing_or_a_slow_remainder_is_not():
    rng, t = np.random.default_rng(1), np.arange(1500) / 500.0
    noise = [rng.standard_normal(len(t)) for _ in range(3)]
    assert whiteness({"v": noise}, 50) > SIGNIFICANCE
    for extra in (0.3 * np.sin(2 * np.pi * 120 * t), 0.2 * np.sin(2 * np.pi * 0.7 * t)):
        assert whiteness({"v": [r + extra for r in noise]}, 50) < SIGNIFICANCE


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


@settings(max_examples=30, deadline=None)
@given(st.lists(st.floats(-1.0, 1.0), min_size=3, max_size=6), st.integers(0, 2**31 - 1))
def test_searches_that_each_end_right_in_another_trial_make_one_that_is_right_in_all(centres, seed):
    # Each trial's own unknown x has a minimum at u + c and a higher one at u + c + 5: cos(2 pi d / 5) - 1 + d^2 / 90.
    rng, centres = np.random.default_rng(seed), np.array(centres)

    def evaluate(u, locals_, derivatives, **_):
        pieces = []
        for c, x in zip(centres, locals_, strict=True):
            d = float(x[0] - u[0] - c)
            k = 2 * np.pi / 5
            cost = 100 * (1 - np.cos(k * d) + d * d / 90) + 0.5 * float(u[0]) ** 2
            slope, curve = 100 * (k * np.sin(k * d) + d / 45), 100 * (k * k + 1 / 45)
            gg, gl, ll = np.array([[curve + 1.0]]), np.array([[-curve]]), np.array([[curve]])
            grad = np.array([-slope + u[0]])
            pieces.append(Piece(cost, {}, gg, gl, ll, grad, np.array([slope]), rows=(1.0, 1.0, 0.0)))
        return State(np.asarray(u, float), tuple(locals_), tuple(pieces))

    def ended(wrong: np.ndarray) -> Solution:
        first = evaluate(np.zeros(1), [np.array([c + 5.0 * w]) for c, w in zip(centres, wrong, strict=True)], True)
        return levenberg_marquardt(evaluate, first, limits)

    limits = np.array([-9.0]), np.array([9.0])
    wrong = np.array([rng.permutation(len(centres)) == k for k in range(3)])  # each right in all trials but one
    ends = sorted((ended(w) for w in wrong), key=lambda end: end.state.cost)
    offered = carried([end.state for end in ends[1:]], ends[0].state.u, limits)
    found = assembled(evaluate, ends[0], offered, limits)
    right = ended(np.zeros(len(centres)))
    if len({int(np.argmax(w)) for w in wrong}) > 1:
        assert found.state.cost == pytest.approx(right.state.cost, abs=0.05)
    assert found.state.cost <= ends[0].state.cost


@given(st.floats(-3.0, 3.0), st.floats(0.1, 3.0), st.floats(1e-3, 0.1))
def test_a_wall_that_holds_up_one_trial_holds_up_neither_the_parameters_nor_the_others(told, beyond, before):
    # The first trial's own unknown is drawn to ``beyond`` a wall at 0, as a velocity to the other side of rest.
    def evaluate(u, locals_, derivatives, **_):
        pieces = []
        for (x,), place in zip(locals_, (beyond, -1.0), strict=True):
            own, shared = x - place, u[0] - told
            cost = 500 * own**2 + 500 * shared**2 + (1e5 if x > 0 else 0.0)
            gg, gl, ll = np.array([[1e3]]), np.zeros((1, 1)), np.array([[1e3]])
            pieces.append(Piece(cost, {}, gg, gl, ll, np.array([1e3 * shared]), 1e3 * np.array([own]), rows=(1, 1, 0)))
        return State(np.asarray(u, float), tuple(locals_), tuple(pieces))

    first = evaluate(np.zeros(1), (np.array([-before]), np.array([-3.0])), True)
    found = levenberg_marquardt(evaluate, first, (np.array([-9.0]), np.array([9.0]))).state
    assert found.u[0] == pytest.approx(told, abs=0.01)
    assert found.locals[0][0] <= 0 and found.locals[1][0] == pytest.approx(-1.0, abs=0.01)


def test_unknowns_of_a_trial_that_nothing_tells_do_not_stop_the_search_for_lower_minima():
    def evaluate(u, locals_, derivatives, **_):
        (x,) = locals_  # their sum alone shows
        ll, grad, cost = np.ones((2, 2)) - 1e-11 * (1 - np.eye(2)), np.full(2, x.sum()), 0.5 * float(x.sum() ** 2)
        piece = Piece(cost, {}, np.eye(1), np.zeros((1, 2)), ll, np.zeros(1), grad, rows=(1.0, 1.0, 0.0))
        return State(np.asarray(u, float), tuple(locals_), (piece,))

    found = Solution(evaluate(np.zeros(1), (np.zeros(2),), True), "converged")
    best = lowest_of_trials(evaluate, [evaluate], found, (np.array([-1.0]), np.array([1.0])), [0.1, 0.0])
    assert best.state.cost <= found.state.cost


@pytest.mark.parametrize("wrong", [(1, 0, 0), (0, -1, 1), (1, 1, -1)])
def test_trials_that_ended_in_a_minimum_of_their_own_are_brought_to_lower_ones(wrong):
    # Minima of each trial's own unknown lie 5 apart, each next one 2 higher in log-likelihood: stops a sample too late.
    def evaluate(u, locals_, derivatives, **_):
        pieces = []
        for (x,) in locals_:
            k = 2 * np.pi / 5
            cost, slope = 2 * (1 - np.cos(k * x)) + 2 * (x / 5) ** 2, 2 * k * np.sin(k * x) + 4 * x / 25
            cost += 50 * float(u[0] - 1) ** 2
            gg, gl, ll = np.array([[100.0]]), np.zeros((1, 1)), np.array([[2 * k * k + 4 / 25]])
            pieces.append(Piece(cost, {}, gg, gl, ll, 100 * (u - 1), np.array([slope]), rows=(1.0, 1.0, 0.0)))
        return State(np.asarray(u, float), tuple(locals_), tuple(pieces))

    limits = np.array([-9.0]), np.array([9.0])
    first = evaluate(np.zeros(1), [np.array([5.0 * w]) for w in wrong], True)
    found = levenberg_marquardt(evaluate, first, limits)
    assert found.state.cost > 1.5 * np.count_nonzero(wrong)
    best = lowest_of_trials(evaluate, [evaluate] * len(wrong), found, limits, [0.0])
    assert best.state.cost < found.state.cost - 1.5 and best.state.u[0] == pytest.approx(1.0, abs=0.01)


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


def test_samples_beside_a_jump_are_left_out_and_no_others():
    y = np.where(np.arange(100) < 40, 0.0, 3.0) + np.random.default_rng(0).normal(0, 0.1, 100)
    assert np.flatnonzero(beside_jumps(y, 0.1)).tolist() == [39, 40]
    assert not beside_jumps(np.sin(np.arange(100) / 10), 0.01).any()


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
