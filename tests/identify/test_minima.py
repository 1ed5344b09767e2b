"""Minima of trials that each have unknowns of their own: put together, brought to lower ones, and held up by none."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from omegaconf import OmegaConf

from frictionpinn.data.noise import GaussianNoise
from frictionpinn.data.simulated import simulate_recording
from frictionpinn.identify import maximum_likelihood
from frictionpinn.numerics.descent import Solution, levenberg_marquardt
from frictionpinn.numerics.minima import assembled, carried, lowest_of_trials
from frictionpinn.numerics.quadratic import Piece, State
from frictionpinn.physics import SYSTEMS
from frictionpinn.physics.contacts import by_parameter, law_named
from frictionpinn.physics.mechanism import Mechanism


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


def test_less_static_friction_that_is_lost_at_a_higher_velocity_is_no_minimum_to_stay_in():
    # Of this draw of the noise the search ends at (0.160, 0.0073), 122 in log-likelihood above the other minimum.
    declared = OmegaConf.to_container(OmegaConf.load("conf/system/pob_hinge.yaml"), resolve=True)
    system, made = SYSTEMS["pob_hinge"](**declared["parameters"]), declared["simulate"]
    mechanism = Mechanism(system, law_named(made["friction"], "friction"))
    truth = by_parameter(made["truth"], mechanism.law)
    trials = [trial for k, trial in enumerate(made["trials"], 1) if k not in made["held_out"]]
    recording = GaussianNoise(0.05)(simulate_recording(system, made["friction"], made["truth"], trials, 400.0), 67)
    free = ("box.mu_s", "box.v_s")
    fixed = {name: value for name, value in truth.items() if name not in free}
    found = maximum_likelihood(mechanism, recording, free=free, fixed=fixed)
    for name in free:
        assert found.ci95[name][0] < truth[name] < found.ci95[name][1]
