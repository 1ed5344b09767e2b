"""What trials that no fit saw say where the fitted ones leave a parameter open, and where they do not."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path as File

import pytest
from test_diagnosis import recorded

from frictionpinn.diagnose import held_out
from frictionpinn.diagnose.bench import Bench
from frictionpinn.diagnose.fit import Fit
from frictionpinn.diagnose.held_out import check, surprise
from frictionpinn.identify import Problem
from frictionpinn.identify.tether import Path, tethered
from frictionpinn.identify.trial import TrialModel
from frictionpinn.numerics.descent import Solution
from frictionpinn.numerics.quadratic import State
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.effects import effects_for
from frictionpinn.physics.mechanism import Mechanism

sys.path.insert(0, str(File(__file__).resolve().parents[2] / "benchmarks"))

from wide_draw import draw


def bench_of(held_out: int) -> Bench:
    system, made = recorded()
    declared = Mechanism(system, LAWS["lugre"]())
    effects = effects_for(system, declared.law, ["constant_force"])
    return Bench(declared, effects, (), made.select(made.names[:2]), made.select(made.names[3 - held_out :]))


@pytest.fixture(scope="module")
def bench() -> Bench:
    return bench_of(1)


def off(fit: Fit, name: str, factor: float, known: bool) -> Fit:
    """The fit with a parameter that is wrong by a factor, and known as well as before or not at all."""
    at, pieces = fit.names.index(name), []
    for piece in fit.state.pieces:
        gg, gl = piece.gg.copy(), piece.gl.copy()
        if not known:
            gg[at], gg[:, at], gl[at] = 0.0, 0.0, 0.0
        pieces.append(replace(piece, gg=gg, gl=gl))
    values = fit.values | {name: factor * fit.values[name]}
    return replace(fit, values=values, state=replace(fit.state, pieces=tuple(pieces)))


def test_what_the_fitted_trials_leave_open_is_left_to_the_held_out_ones(bench):
    fit = bench.base
    plain = check(bench, fit).state.cost
    wrong = off(fit, "sigma_2", 1.5, known=False)
    assert check(bench, wrong).state.cost > plain + 50
    assert surprise(bench, wrong).moved < surprise(bench, fit).moved + 15  # the price of one unknown more


def test_what_the_fitted_trials_tell_is_held_against_the_fit(bench):
    fit = bench.base
    assert surprise(bench, off(fit, "sigma_2", 1.5, known=True)).moved > surprise(bench, fit).moved + 50


def test_checking_a_fit_leaves_its_parameters_as_they_are(bench):
    fit = bench.base
    judged = check(bench, fit)
    assert judged.values == fit.values and len(judged.models) == 1
    other = replace(fit, values=fit.values | {"mu_c": 1.01 * fit.values["mu_c"]})
    assert check(bench, other).state.cost > judged.state.cost


def test_without_held_out_trials_there_is_nothing_to_say():
    bench = bench_of(0)
    assert check(bench, bench.base) is None and surprise(bench, bench.base) is None


def at_the_truth(seed: int, only: slice = slice(None)) -> tuple[Path, tuple[TrialModel, ...], State]:
    """The held-out trials of a draw, or some of them: what a search for their own unknowns is asked with."""
    case = draw(seed, effects=False)
    mechanism = Mechanism(SYSTEMS[case.system](**case.parameters), LAWS[case.law]())
    whole = Problem(mechanism, case.recording.select(case.held_out), sigmas=case.sigmas)
    every = whole.varied(values=case.truth, limits=whole.space.reaching(case.truth), prior=False)
    problem, held = (p.varied(trials=p.trials[only]) for p in (every, tethered(every)))
    u = problem.space.to_search(case.truth)
    models = problem.models_at(u)
    first = problem.evaluator(models)(u, tuple(model.local for model in models), True)
    return Path(problem, held, case.sigmas, coarse=True, given=True), models, first


@pytest.mark.parametrize("seed", [52, 263])
def test_a_held_out_trial_is_not_judged_by_a_wrong_minimum_of_its_own_unknowns(seed):
    """The bend of a bristle at which searches end (52), and a motion lost where it turns round (263), at the truth."""
    found = held_out.own_unknowns(*at_the_truth(seed))
    count = sum(r.size for piece in found.state.pieces for r in piece.residuals.values())
    assert 2 * found.state.cost < 1.05 * count


def test_a_held_out_trial_is_judged_as_if_it_were_the_only_one():
    both = held_out.own_unknowns(*at_the_truth(263)).state
    second = held_out.own_unknowns(*at_the_truth(263, slice(1, 2))).state
    assert both.pieces[1].cost == pytest.approx(second.cost, rel=1e-9)
    assert both.locals[1] == pytest.approx(second.locals[0], rel=1e-6, abs=1e-9)


def test_where_the_parameters_may_move_a_trial_shows_its_way_out_of_a_wrong_minimum(bench, monkeypatch):
    right = check(bench, bench.base).state.cost
    monkeypatch.setattr(held_out, "own_unknowns", lambda path, models, first: Solution(first, "wrong"))
    assert check(bench, replace(bench.base)).state.cost < right + 0.1


def test_held_out_trials_are_simulated_once_for_each_fit(bench):
    first, spent = surprise(bench, bench.base), bench.checked.simulations
    assert surprise(bench, bench.base) is first and check(bench, bench.base) is first.fit
    assert bench.checked.simulations == spent
