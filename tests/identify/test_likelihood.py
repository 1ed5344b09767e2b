"""Maximum likelihood recovers what made the data, says how well, and names what the data do not tell."""

import json
from dataclasses import replace

import numpy as np
import pytest
from cases import around, case, deviations

from frictionpinn.data.noise import GaussianNoise, OutlierNoise
from frictionpinn.data.recording import Recording, Trial
from frictionpinn.data.simulated import simulate_trials
from frictionpinn.errors import UserError
from frictionpinn.identify import Problem, likelihood, maximum_likelihood, profile
from frictionpinn.identify.result import verdict
from frictionpinn.numerics.descent import Solution
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.mechanism import Mechanism


@pytest.fixture(scope="module")
def pob():
    mechanism, truth, _, noisy, levels = case("pob", "lugre", (4, 5), 400.0)
    problem = Problem(mechanism, noisy, bounds=around(truth))
    return truth, levels, problem, maximum_likelihood(problem)


def test_lugre_parameters_are_found_within_their_errors(pob):
    truth, _, _, estimate = pob
    assert estimate.outcome == "converged"
    assert max(deviations(estimate, truth).values()) < 4
    assert abs(estimate.values["mu_c"] / truth["mu_c"] - 1) < 0.01


def test_noise_levels_are_estimated(pob):
    _, levels, _, estimate = pob
    for name, level in levels.items():
        assert estimate.sigmas[name] == pytest.approx(level, rel=0.1)


def test_result_can_be_written_as_json(pob):
    text = json.loads(json.dumps(pob[3].to_dict(), allow_nan=False))
    assert set(text["parameters"]) == set(pob[0])
    assert text["parameters"]["sigma_0"]["unit"] == "N/m"


def test_interval_holds_the_estimate_and_is_symmetric_in_the_logarithm_of_what_cannot_vanish(pob):
    estimate = pob[3]
    for name, (low, high) in estimate.ci95.items():
        assert low < estimate.values[name] < high
        if estimate.std[name] < 0.1 * estimate.values[name]:
            middle = (low + high) / 2 if name == "sigma_2" else (low * high) ** 0.5
            assert middle == pytest.approx(estimate.values[name])


def test_profile_agrees_with_the_curvature_where_the_likelihood_is_quadratic(pob):
    _, _, problem, estimate = pob
    found = profile(problem, estimate, "mu_c")
    low, high = estimate.ci95["mu_c"]
    assert found.ci95[1] - found.ci95[0] == pytest.approx(high - low, rel=0.4)


def test_a_fit_goes_on_from_where_the_profile_of_a_parameter_goes_below_it(monkeypatch):
    mechanism, _, _, noisy, _ = case("pob", "lugre")
    problem, best, found = Problem(mechanism, noisy), likelihood._best, []

    def beside_the_minimum_at_first(problem, ends, sigmas, thorough):
        solution, models, sigmas = best(problem, ends, sigmas, thorough)
        if not found:
            factors = {"mu_s": 1.5, "v_s": 2.0}
            u = solution.state.u + [np.log(factors.get(name, 1.0)) for name in problem.names]
            state = problem.evaluator(models, sigmas)(u, solution.state.locals, True)
            solution = Solution(state, solution.reason)
        found.append(solution.state.cost)
        return solution, models, sigmas

    monkeypatch.setattr(likelihood, "_best", beside_the_minimum_at_first)
    estimate = maximum_likelihood(problem, thorough=False)
    assert len(found) > 1
    assert estimate.cost == found[-1] < found[0] - 1.0


@pytest.mark.parametrize("offset", [0.0, 0.3])
def test_where_the_sample_is_too_rugged_the_start_is_followed_from_coarse_and_others_only_if_that_hides_a_force(
    monkeypatch, offset
):
    mechanism, _, _, noisy, _ = case("drive", "lugre")
    shifted = [
        replace(trial, signals=trial.signals | {"force": trial.signals["force"] + offset}) for trial in noisy.trials
    ]
    recording, followed, searches = replace(noisy, trials=tuple(shifted)), likelihood.followed, []
    plain = maximum_likelihood(mechanism, recording, profiles=False)

    def too_rugged_at_the_sample(path, us, stages, seen):
        searches.append((path.coarse, len(us)))
        return followed(path, us, stages, seen) if path.coarse else []

    monkeypatch.setattr(likelihood, "followed", too_rugged_at_the_sample)
    estimate = maximum_likelihood(mechanism, recording, profiles=False)
    assert searches[:2] == [(False, 1), (True, 1)]
    assert (len(searches) == 2) == (estimate.outcome == "converged") == (offset == 0.0)
    assert estimate.cost < plain.cost + 1.0


@pytest.mark.parametrize(
    ("system", "law"),
    [
        ("drive", "dahl"),
        ("drive", "coulomb_viscous"),
        ("damper", "dahl"),
        ("damper", "stribeck"),
        ("pendulum", "coulomb_viscous"),
        ("sdob", "dahl"),
    ],
)
def test_every_system_is_identified_from_noisy_data(system, law):
    mechanism, truth, _, noisy, _ = case(system, law, (0, 1))
    estimate = maximum_likelihood(mechanism, noisy)
    for name, value in truth.items():
        error = abs(estimate.values[name] - value)
        assert error < max(5 * estimate.std[name], 0.05 * value), (name, estimate.values[name], estimate.std[name])


def test_a_system_parameter_is_found_with_the_friction():
    mechanism, truth, _, noisy, _ = case("drive", "coulomb_viscous", (0, 3))
    estimate = maximum_likelihood(mechanism, noisy, free=("M", *truth))
    assert estimate.values["M"] == pytest.approx(mechanism.system.values["M"], abs=5 * estimate.std["M"])


def test_windows_with_free_initial_states_give_the_same_parameters():
    mechanism, truth, _, noisy, _ = case("drive", "dahl", (0, 1))
    whole = maximum_likelihood(mechanism, noisy)
    cut = maximum_likelihood(mechanism, noisy, windows=0.5)
    assert len(cut.residuals) == 8
    for name in truth:
        assert cut.values[name] == pytest.approx(whole.values[name], abs=5 * cut.std[name])


def test_outliers_hardly_move_the_robust_estimate():
    mechanism, truth, clean, _, _ = case("drive", "dahl", (0, 1))
    dirty = OutlierNoise(0.05, fraction=0.05, scale=20.0)(clean, 1)
    robust = maximum_likelihood(mechanism, dirty, loss="robust")
    plain = maximum_likelihood(mechanism, dirty)
    assert robust.std["mu_c"] < plain.std["mu_c"]
    assert abs(robust.values["mu_c"] - truth["mu_c"]) < 5 * robust.std["mu_c"]


def test_what_never_slides_is_named_and_its_interval_is_open():
    mechanism, _, _, noisy, _ = case("pob", "lugre", (0,))
    estimate = maximum_likelihood(mechanism, noisy)
    assert np.isfinite(list(estimate.values.values())).all()
    assert not np.isnan(list(estimate.ci95.values())).any()
    hidden = [name for name, (_, high) in estimate.ci95.items() if np.isinf(high)]
    assert hidden
    for name in hidden:
        assert any(sentence.startswith(name) for sentence in estimate.advice)


@pytest.mark.parametrize(("white", "outcome"), [(True, "no excitation"), (False, "not explained")])
def test_where_nothing_shows_it_is_the_excitation_only_beside_residuals_that_are_noise(pob, white, outcome):
    problem, estimate = pob[2:]
    names, unknown = estimate.names, np.full((len(estimate.names),) * 2, np.nan)
    nothing = unknown, dict.fromkeys(names, (np.nan, np.nan)), set(names), (), ()
    found, advice = verdict(problem, estimate.minimum, *nothing, 1.0, white)
    assert found == outcome
    assert [name for name in names if f"{name} does not show in these data" in " ".join(advice)] == [*names] * white
    assert any("the model lacks something" in sentence for sentence in advice) is not white


def test_a_bound_that_excludes_the_truth_is_reported():
    mechanism, truth, _, noisy, _ = case("drive", "dahl", (0, 1))
    estimate = maximum_likelihood(mechanism, noisy, bounds={"mu_c": (1.2 * truth["mu_c"], 4 * truth["mu_c"])})
    assert estimate.outcome == "at a bound"
    assert any("bounds.mu_c, or hold it fixed" in sentence for sentence in estimate.advice)


def test_a_given_start_leads_to_the_same_estimate():
    mechanism, truth, _, noisy, _ = case("drive", "dahl", (0, 1))
    searched = maximum_likelihood(mechanism, noisy)
    given = maximum_likelihood(mechanism, noisy, start={name: 1.2 * value for name, value in truth.items()})
    for name in truth:
        assert given.values[name] == pytest.approx(searched.values[name], abs=searched.std[name])


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"free": ("mu_k",)}, "mu_c"),
        ({"bounds": {"mu_c": (1.0, 0.5)}}, "bounds.mu_c"),
        ({"bounds": {"mu_c": (-1.0, 0.5)}}, "bounds.mu_c"),
        ({"inputs": "noisy"}, "joint"),
        ({"initial": "zero"}, "rest"),
        ({"loss": "absolute"}, "gaussian"),
        ({"windows": 1e-3}, "windows"),
    ],
)
def test_mistakes_are_named_in_one_line(options, words):
    mechanism, _, _, noisy, _ = case("drive", "dahl", (0, 1))
    with pytest.raises(UserError, match=words) as caught:
        Problem(mechanism, noisy, **options)
    assert "\n" not in str(caught.value)


def test_a_recording_without_a_predicted_signal_is_refused():
    mechanism, _, clean, _, _ = case("drive", "dahl", (0, 1))
    only = Recording(tuple(t.__class__(t.name, t.t, {"force": t.signals["force"]}) for t in clean.trials), clean.units)
    with pytest.raises(UserError, match="nothing of x was recorded"):
        Problem(mechanism, only)


def test_an_imposed_motion_without_its_force_is_refused():
    t = np.linspace(0.0, 1.0, 50)
    system = SYSTEMS["damper"]()
    only = Recording((Trial("1", t, {"x": 0.01 * np.sin(6 * t)}),), dict(system.signal_units))
    with pytest.raises(UserError, match="nothing to compare the model with"):
        Problem(Mechanism(system, LAWS["coulomb"]()), only)


def test_a_force_that_the_model_lacks_is_not_explained_by_the_noise_of_an_input():
    # A constant force may pass for an input that was measured so much too low: the outputs are white.
    system, trials = SYSTEMS["drive"](M=2.0), [{"duration": 3.0, "force": f"9*sin({w}*t)"} for w in (5, 7)]
    law, truth = LAWS["coulomb_viscous"](), {"mu_c": 4.0, "sigma_2": 6.0}
    more = {"constant_force": 0.5}
    for effects, strength, outcome in (((), {}, "converged"), (tuple(more), more, "not explained")):
        clean = simulate_trials(Mechanism(system, law, effects), truth | strength, trials, 250.0)
        found = maximum_likelihood(Mechanism(system, law), GaussianNoise(0.01)(clean, 0))
        assert found.outcome == outcome, found
