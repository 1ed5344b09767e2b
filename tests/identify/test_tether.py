"""A mechanism held to the motion that was measured, and let go of."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from cases import case
from omegaconf import OmegaConf

from frictionpinn.data.noise import GaussianNoise
from frictionpinn.data.simulated import simulate_recording
from frictionpinn.identify import Problem, maximum_likelihood
from frictionpinn.identify.likelihood import BEST
from frictionpinn.identify.start import coarse_design
from frictionpinn.identify.tether import (
    FADING,
    LONGEST,
    RATE,
    Path,
    begun_at,
    followed,
    held_by,
    lagging,
    led,
    lowest,
    regained,
    tethered,
    tethers,
)
from frictionpinn.numerics.descent import levenberg_marquardt
from frictionpinn.physics import SYSTEMS
from frictionpinn.physics.contacts import by_parameter, law_named
from frictionpinn.physics.mechanism import Mechanism


@pytest.fixture(scope="module")
def box() -> tuple[Problem, dict[str, float]]:
    mechanism, truth, _, noisy, _ = case("pob", "lugre")
    return Problem(mechanism, noisy), truth


def distance(problem: Problem, simulator_of: Problem, values: dict[str, float], signal: str) -> float:
    """Root mean square distance of the simulated signal from the measured one, over all trials."""
    p = simulator_of.fixed | values
    rows = []
    for model in simulator_of.trials:
        run = model.simulate(p, model.local[: model.size(False)])
        rows.append(run.signals[signal] - model.y[list(model.outputs).index(signal)])
    return float(np.sqrt(np.mean(np.concatenate(rows) ** 2)))


def test_without_tether_the_held_mechanism_moves_like_the_free_one(box):
    problem, truth = box
    held = tethered(problem)
    for own, model in zip(held.trials, problem.trials, strict=True):
        local = model.local[: model.size(False)]
        free, same = model.simulate(problem.fixed | truth, local), own.simulate(held.fixed | truth, local)
        np.testing.assert_allclose(same.signals["x"], free.signals["x"], atol=1e-9)


def test_the_shorter_the_tether_the_closer_wrong_parameters_stay_to_what_was_measured(box):
    problem, truth = box
    wrong = truth | {"mu_c": 2 * truth["mu_c"], "mu_s": 2 * truth["mu_s"]}
    held = tethered(problem)
    apart = [distance(problem, held.varied(values={RATE.name: 1 / tau}), wrong, "x") for tau in (0.01, 0.1, 1.0)]
    assert apart[0] < apart[1] < apart[2] < 1.01 * distance(problem, problem, wrong, "x")
    assert apart[0] < 0.1 * apart[2]


def test_tethers_double_from_a_stretch_of_low_speed_to_beyond_the_longest_trial(box):
    problem, _ = box
    lengths = np.array(tethers(problem))
    assert lengths[0] == problem.resolutions[0]
    np.testing.assert_allclose(lengths[1:] / lengths[:-1], FADING)
    longest = max(model.t[-1] - model.t[0] for model in problem.trials)
    assert longest < lengths[-1] <= LONGEST * longest


def test_held_to_the_motion_found_under_a_tether_wrong_parameters_show_more_than_under_that_one(box):
    problem, truth = box
    held, tau, wrong = tethered(problem), 0.05, truth | {"mu_c": 2 * truth["mu_c"], "mu_s": 2 * truth["mu_s"]}
    state, models = begun_at(problem, problem.space.to_search(wrong))
    again = led(Path(problem, held, problem.sigmas), held_by(held, tau, models), state)
    under = [distance(problem, by.varied(values={RATE.name: 1 / tau}), wrong, "x") for by in (held, again)]
    assert 1.2 * under[0] < under[1] < distance(problem, problem, wrong, "x")


def test_every_tether_holds_to_the_motion_found_under_the_one_before(box, monkeypatch):
    problem, _ = box
    path, held_to, found, cost = Path(problem, tethered(problem), problem.sigmas), [], [], Path.cost

    def recorded(self, models, stage):
        held_to.append((stage[0], self.held))
        return cost(self, models, stage)

    def leading(path, held, state):
        found.append(led(path, held, state))
        return found[-1]

    monkeypatch.setattr(Path, "cost", recorded)
    monkeypatch.setattr("frictionpinn.identify.tether.led", leading)
    followed(path, [problem.space.to_search(problem.start)], path.stages, {})
    rates, holders = zip(*held_to, strict=True)
    assert rates == pytest.approx([tether for tether, _ in path.stages])
    assert len(found) == len(tethers(problem))
    assert all(by is own for by, own in zip(holders, [path.held, *found], strict=True))


def test_let_go_the_fit_ends_in_the_minimum_of_the_truth(box):
    problem, truth = box
    path = Path(problem, tethered(problem), problem.sigmas)
    found = followed(path, [problem.space.to_search(problem.start)], path.stages, {})
    solution, models = found[0]
    evaluate = problem.evaluator(models)
    begun = evaluate(problem.space.to_search(truth), [m.local[: m.size(problem.joint)] for m in models], True)
    reference = levenberg_marquardt(evaluate, begun, problem.space.limits)
    assert solution.state.cost < reference.state.cost + 1.0


def test_a_path_whose_first_search_at_the_sample_comes_to_no_end_is_not_walked(box, monkeypatch):
    problem, _ = box
    path, asked, cost = Path(problem, tethered(problem), problem.sigmas), [], Path.cost
    monkeypatch.setattr(Path, "cost", lambda self, models, stage: asked.append(stage) or cost(self, models, stage))
    monkeypatch.setattr("frictionpinn.identify.tether.ROUGHLY", {"iterations": 1, "decrease": 0.1})
    assert followed(path, [problem.space.to_search(problem.start)], path.stages, {}) == []
    assert set(asked) == {path.stages[0]}


def test_what_comes_to_where_another_search_has_been_is_left(box):
    problem, _ = box
    path, u, seen = Path(problem, tethered(problem), problem.sigmas), problem.space.to_search(problem.start), {}
    begun = problem.simulations
    assert followed(path, [u], path.stages, seen)
    walked, begun = problem.simulations - begun, problem.simulations
    assert set(seen) == set(path.stages)
    assert followed(path, [u + 0.1], path.stages, seen) == []
    assert problem.simulations - begun < 0.5 * walked


@pytest.mark.parametrize("white", [True, False])
def test_what_is_not_white_is_looked_for_from_the_coarsest_resolution_from_its_own_start_and_others(
    box, monkeypatch, white
):
    problem, _ = box
    told, walked, own = iter([white, True]), [], problem.space.to_search(problem.start)

    def walk(path, us, stages, seen):
        others = [u for u in us if not np.array_equal(u, own)]
        walked.append(([width for _, width in stages if width], len(us) - len(others), len(others)))
        return followed(path, us, stages, {})

    monkeypatch.setattr("frictionpinn.identify.likelihood._white", lambda *_: next(told))
    monkeypatch.setattr("frictionpinn.identify.likelihood.followed", walk)
    maximum_likelihood(problem, thorough=False, profiles=False)
    closely, *coarse = walked
    assert closely == ([], 1, 0)
    assert [widths for widths, *_ in coarse] == ([] if white else [problem.resolutions[:1], problem.resolutions[:-1]])
    assert white or coarse[0][1:] == (1, BEST)


def test_starts_are_compared_at_the_sample_and_not_before(box, monkeypatch):
    problem, _ = box
    path, asked, cost = Path(problem, tethered(problem), problem.sigmas, coarse=True), [], Path.cost
    monkeypatch.setattr(Path, "cost", lambda self, models, stage: asked.append(stage) or cost(self, models, stage))
    monkeypatch.setattr("frictionpinn.identify.tether.AS_NEAR", 0.0)
    monkeypatch.setattr("frictionpinn.identify.tether.same_minimum", lambda *_: False)
    u, first = problem.space.to_search(problem.start), len(problem.resolutions)
    followed(path, [u, u + 0.3], path.stages[: first + 1], {})
    assert [asked.count(stage) for stage in path.stages[:first]] == [2] * first
    assert set(asked[2 * first :]).isdisjoint(path.stages[:first]) and asked.count(path.stages[first]) == 1


def test_a_held_cost_counts_among_the_problems_simulations(box):
    problem, truth = box
    before = problem.simulations
    held = held_by(tethered(problem), 0.1, problem.trials)
    u, locals_ = problem.space.to_search(truth), [m.local[: m.size(problem.joint)] for m in problem.trials]
    held.evaluator(held.trials)(u, locals_, False)
    assert problem.simulations == before + 1


def test_held_closely_the_start_nearest_to_the_truth_is_ranked_first(box):
    problem, truth = box
    path = Path(problem, tethered(problem), problem.sigmas)
    wrong = [problem.space.to_search(truth | {"sigma_0": s * truth["sigma_0"]}) for s in (0.1, 0.3, 10.0)]
    near = problem.space.to_search(truth | {"sigma_0": 1.1 * truth["sigma_0"]})
    (best,) = lowest(path, [*wrong, near], 1)
    assert best is near


def test_the_design_reaches_beyond_the_default_start_in_what_sliding_does_not_tell(box):
    problem, _ = box
    values = [problem.space.named(u) for u in coarse_design(problem)]
    for name in ("sigma_0", "sigma_1", "v_s"):
        own = [p[name] for p in values]
        assert min(own) < 0.5 * problem.start[name] < 2 * problem.start[name] < max(own)


def test_what_shows_accelerations_alone_is_not_held(box):
    mechanism, _, _, noisy, _ = case("pob", "lugre")
    kept = ("a", "theta", "omega", "alpha")
    trials = tuple(replace(trial, signals={name: trial.signals[name] for name in kept}) for trial in noisy.trials)
    alone = replace(noisy, trials=trials)
    assert tethered(Problem(mechanism, alone)) is None


LOAD = ("load.mu_c", "load.mu_s", "load.v_s")


def drive(places: list[int], seed: int) -> tuple[Problem, dict[str, float]]:
    """Two bodies and a compliant coupling, LuGre friction on both, that of the load unknown; trials by their place."""
    config = OmegaConf.to_container(OmegaConf.load("conf/system/two_mass.yaml"), resolve=True)
    made, system = config["simulate"], SYSTEMS["two_mass"](**config["parameters"])
    mechanism = Mechanism(system, law_named(made["friction"], "friction"))
    truth = by_parameter(made["truth"], mechanism.law)
    clean = simulate_recording(system, made["friction"], truth, [made["trials"][k] for k in places], 100.0)
    fixed = {name: value for name, value in truth.items() if name not in LOAD}
    return Problem(mechanism, GaussianNoise(0.05)(clean, seed), free=LOAD, fixed=fixed), truth


def test_a_trial_that_lags_behind_is_held_anew_and_comes_back_with_what_the_other_one_tells():
    problem, truth = drive([0, 3], 0)
    wrong = problem.space.to_search(truth | {"load.mu_s": 0.35, "load.v_s": 0.15})
    evaluate = problem.evaluator(problem.trials)
    begun = evaluate(wrong, [m.local[: m.size(problem.joint)] for m in problem.trials], True)
    fit = levenberg_marquardt(evaluate, begun, problem.space.limits).state
    assert lagging(fit) == 1
    found = regained(problem, tethered(problem), problem.sigmas, (fit, problem.trials))
    values = problem.values(found.state.u)
    assert lagging(found.state) is None
    assert [values[name] for name in LOAD] == pytest.approx([truth[name] for name in LOAD], rel=0.05)


def test_trials_with_the_same_noise_do_not_lag_and_one_with_a_tenth_more_does():
    def leaving(*sizes: float) -> SimpleNamespace:
        return SimpleNamespace(pieces=[SimpleNamespace(rows=(2000.0, 2000.0 * size**2, 0.0)) for size in sizes])

    assert lagging(leaving(1.0, 1.02, 0.99)) is None
    assert lagging(leaving(1.0, 1.1, 1.0)) == 1
    assert lagging(leaving(5.0)) is None


def test_a_load_that_barely_breaks_away_is_followed_to_where_the_truth_fits():
    """The push a tenth above breakaway: let go of at once the load stays at rest, and a breakaway that comes a swing of
    the coupling too late has a minimum of its own."""
    for seed in (2, 5):
        problem, truth = drive([3], seed)
        path = Path(problem, tethered(problem), problem.sigmas, coarse=True)
        (best, _), *_ = followed(path, [problem.space.to_search(problem.start)], path.stages, {})
        values = problem.values(best.state.u)
        assert [values[name] for name in LOAD] == pytest.approx([truth[name] for name in LOAD], rel=0.02)


def test_from_other_starts_resolutions_grow_finer_under_the_shortest_tether_before_it_is_let_go_of(box):
    problem, _ = box
    first = len(problem.resolutions)
    tethers_, widths = zip(*Path(problem, tethered(problem), problem.sigmas, coarse=True).stages, strict=True)
    assert widths[:first] == tuple(problem.resolutions) and not any(widths[first:])
    assert len({*tethers_[:first]}) == 1 and tethers_[-1] == 0
    assert Path(problem, tethered(problem), problem.sigmas).stages[0] == (tethers_[0], 0.0)
    assert Path(problem, None, problem.sigmas, coarse=True).stages == tuple(
        (0.0, width) for width in problem.resolutions
    )
