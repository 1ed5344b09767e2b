"""A problem varied over the same recording, and a budget of steps that belongs to one search."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cases import case, deviations
from omegaconf import OmegaConf

from frictionpinn.data.noise import GaussianNoise
from frictionpinn.data.simulated import simulate_recording
from frictionpinn.identify import Problem, maximum_likelihood
from frictionpinn.numerics.simulate import Simulator
from frictionpinn.physics import SYSTEMS
from frictionpinn.physics.contacts import by_parameter, law_named
from frictionpinn.physics.effects import effects_for
from frictionpinn.physics.mechanism import Mechanism


@pytest.fixture(scope="module")
def problem():
    mechanism, _, _, noisy, _ = case("drive", "lugre", (0, 1))
    return Problem(mechanism, noisy)


def began(problem: Problem):
    """Search vector and unknowns of the trials at the start."""
    u = problem.space.to_search(problem.start)
    return u, [model.local[: model.size(problem.joint)] for model in problem.trials]


def test_a_varied_problem_leaves_the_one_that_it_comes_from(problem):
    before = {name: value for name, value in vars(problem).items() if name != "_calls"}
    made = problem.varied(names=["mu_c"], values={"mu_c": 2.0, "v_s": 5e-3}, sigmas={"v": 0.1}, prior=False)
    assert made.names == ("mu_c",) and made.start == {"mu_c": 2.0} and made.fixed["v_s"] == 5e-3
    assert made.fixed["sigma_0"] == problem.start["sigma_0"]
    assert made.given == {"v": 0.1} and made.sigmas == problem.sigmas | {"v": 0.1}
    assert made.simulations == 0 and not len(made.prior.target)
    assert all(vars(problem)[name] is value for name, value in before.items())


def test_what_is_not_given_stays(problem):
    made, (u, locals_) = problem.varied(), began(problem)
    assert made.space.bounds == problem.space.bounds and made.start == problem.start
    cost = problem.evaluator(problem.trials)(u, locals_, False).cost
    assert made.evaluator(made.trials)(u, locals_, False).cost == cost
    bare = problem.varied(prior=False)
    r = problem.prior.distance(u)
    assert cost - bare.evaluator(bare.trials)(u, locals_, False).cost == pytest.approx(0.5 * float(r @ r))


def test_bounds_are_kept_or_given_and_follow_the_values_of_new_parameters(problem):
    wider = Mechanism(problem.mechanism.system, problem.mechanism.law, ("drag",))
    values = problem.start | {"drag": 0.0}
    made = problem.varied(
        names=["mu_c", "drag"], values=values, simulator=Simulator(wider), limits={"mu_c": (0.1, 2.0)}
    )
    assert made.space.bounds["mu_c"] == (0.1, 2.0) and made.mechanism is wider
    assert made.space.bounds["drag"][0] <= 0.0 and all(model.simulator.mechanism is wider for model in made.trials)
    assert problem.varied(names=["v_s"]).space.bounds["v_s"] == problem.space.bounds["v_s"]
    reached = problem.space.reaching(problem.start | {"sigma_2": 1e6})
    assert problem.varied(limits=reached).space.bounds["sigma_2"] == (problem.space.bounds["sigma_2"][0], 1e6)


def test_a_budget_counts_the_steps_of_its_own_search_alone(problem):
    u, locals_ = began(problem)
    pieces = problem.evaluator(problem.trials)(u, locals_, False).pieces
    once = sum(piece.steps for piece in pieces)
    assert once > sum(len(model.t) for model in problem.trials) / 2
    mine, other = (problem.evaluator(problem.trials, steps=1.5 * once) for _ in range(2))
    for _ in range(5):
        other(u, locals_, False)
    assert mine(u, locals_, False) is not None and mine(u, locals_, False) is not None
    assert mine(u, locals_, False) is None and other(u, locals_, False) is None


def test_derivatives_added_to_a_simulation_cost_no_steps(problem):
    u, locals_ = began(problem)
    evaluate = problem.evaluator(problem.trials)
    ran = evaluate(u, locals_, False, strict=True)
    added = evaluate(u, locals_, True, ran=ran)
    assert sum(piece.steps for piece in added.pieces) == 0
    np.testing.assert_allclose(added.cost, ran.cost)


@pytest.mark.parametrize("derivatives", [False, True])
def test_a_trial_with_the_unknowns_of_a_known_state_beside_is_not_simulated_again(problem, derivatives):
    u, locals_ = began(problem)
    evaluate, moved = problem.evaluator(problem.trials), [locals_[0], 1.01 * locals_[1], *locals_[2:]]
    known, before = evaluate(u, locals_, True), problem.simulations
    made = [evaluate(u, moved, derivatives, beside=known) for _ in locals_]
    assert problem.simulations == before + 1  # one trial at a time
    whole = evaluate(u, moved, derivatives)
    assert made[0].cost == pytest.approx(whole.cost, rel=1e-6) and made[0].pieces[0] is known.pieces[0]
    assert made[0].pieces[1].cost == whole.pieces[1].cost and made[0].curved is whole.curved is derivatives


def test_a_law_without_a_prior_is_fitted_with_an_effect_beside_it():
    mechanism, _, _, noisy, _ = case("drive", "coulomb_viscous", (0, 3))
    problem = Problem(mechanism, noisy)
    wider = Simulator(Mechanism(mechanism.system, mechanism.law, ("drag",)))
    made = problem.varied(names=[*problem.names, "drag"], values=problem.start | {"drag": 0.0}, simulator=wider)
    found = maximum_likelihood(made, thorough=False)
    assert found.minimum is not None and found.prior == {}
    low, high = found.ci95["drag"]
    assert low <= found.values["drag"] <= high < 1.0


def test_bounds_hold_the_truth_where_noise_makes_friction_look_viscous():
    config = OmegaConf.to_container(OmegaConf.load("conf/system/two_mass.yaml"), resolve=True)
    made = config["simulate"]
    mechanism = Mechanism(SYSTEMS["two_mass"](**config["parameters"]), law_named(made["friction"], "friction"))
    truth = by_parameter(made["truth"], mechanism.law)
    undeclared = truth | {"motor.asymmetry": -0.066}
    clean = simulate_recording(mechanism.system, made["friction"], undeclared, made["trials"][:4], 100.0,
                               ["asymmetry@motor"])  # fmt: skip
    bounds = Problem(
        mechanism, GaussianNoise(0.05)(clean, 100)
    ).space.bounds  # sliding, the motor seems to have no mu_c
    assert all(low <= truth[name] <= high for name, (low, high) in bounds.items())


@pytest.mark.parametrize("seed", [5, 8])
def test_friction_that_noise_in_a_stiff_coupling_hides_starts_within_a_decade_of_the_truth(seed):
    config = OmegaConf.to_container(OmegaConf.load("conf/system/two_mass.yaml"), resolve=True)
    made = config["simulate"]
    mechanism = Mechanism(SYSTEMS["two_mass"](**config["parameters"]), law_named(made["friction"], "friction"))
    clean = simulate_recording(mechanism.system, made["friction"], made["truth"], made["trials"][:4], 100.0)
    start = Problem(mechanism, GaussianNoise(0.05)(clean, seed)).start
    truth = by_parameter(made["truth"], mechanism.law)
    assert all(0.1 < start[name] / truth[name] < 10 for name in truth if name.endswith(("mu_c", "sigma_2")))


def test_friction_that_no_equation_holds_starts_at_no_large_value():
    config = OmegaConf.to_container(OmegaConf.load("conf/system/pob_hinge.yaml"), resolve=True)
    made, laws = config["simulate"], {"box": "lugre", "hinge": "coulomb_viscous"}
    system = SYSTEMS["pob_hinge"](**config["parameters"])
    clean = simulate_recording(system, made["friction"], made["truth"], made["trials"][:2], 200.0)
    driven = SYSTEMS["pob_hinge"](**config["parameters"], driven=["theta"])
    start = Problem(Mechanism(driven, law_named(laws, "friction")), GaussianNoise(0.05)(clean, 0)).start
    assert 0 < start["hinge.mu_c"] < 1 and 0 < start["hinge.sigma_2"] < 1


def test_the_trials_one_by_one_are_one_simulation_of_the_recording_and_cost_as_much(problem):
    made, (u, locals_) = problem.varied(prior=False), began(problem)
    alone = [evaluate(u, [own], False) for evaluate, own in zip(made.apart(made.trials), locals_, strict=True)]
    assert made.simulations == 1
    assert sum(state.cost for state in alone) == pytest.approx(made.evaluator(made.trials)(u, locals_, False).cost)
    assert made.simulations == 2


@pytest.mark.parametrize("signal", ["x", "v"])
def test_a_trial_may_begin_with_a_sample_that_was_not_measured(signal):
    mechanism, truth, _, noisy, _ = case("drive", "coulomb_viscous", (0, 1))
    trials = [replace(t, signals=t.signals | {signal: np.where(t.t < 0.008, np.nan, t.signals[signal])})
              for t in noisy.trials]  # fmt: skip
    found = maximum_likelihood(mechanism, replace(noisy, trials=tuple(trials)), thorough=False, profiles=False)
    assert max(deviations(found, truth).values()) < 4


def test_a_trial_whose_first_velocity_was_not_measured_does_not_begin_at_rest():
    mechanism, _, _, noisy, _ = case("drive", "coulomb_viscous", (0, 1))
    moving = noisy.trials[0].part(slice(60, None), "moving")  # 0.3 s after its start from rest
    gap = np.where(np.arange(len(moving)) < 1, np.nan, moving.signals["v"])
    problem = Problem(mechanism, replace(noisy, trials=(replace(moving, signals=moving.signals | {"v": gap}),)))
    assert problem.trials[0].start["v"] == pytest.approx(np.mean(moving.signals["v"][:5]), rel=0.2)


def test_a_place_that_is_looked_for_nowhere_but_at_one_value_keeps_its_physical_limits():
    mechanism, _, _, noisy, _ = case("drive", "coulomb_viscous", (0, 1))
    system, law = mechanism.system, mechanism.law
    places = Mechanism(system, law, effects_for(system, law, ["position_friction"]))
    low, high = Problem(places, noisy, free=("mu_c", "position_middle")).space.bounds["position_middle"]
    assert low < -1e6 and high > 1e6
