"""Which fits are searched anew, since they may have stopped short."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from contending import contest_stub, fit, names, option

from frictionpinn.diagnose import bench as benches
from frictionpinn.diagnose import minima
from frictionpinn.diagnose.bench import Bench, tried
from frictionpinn.diagnose.refits import refitted
from frictionpinn.diagnose.rivals import moved


@pytest.fixture
def tries(monkeypatch):
    return contest_stub(monkeypatch)


def test_once_one_explains_the_residual_others_are_searched_only_where_they_come_near_from_there(tries):
    spring, explains, ripple = fit(100, 20.0), fit(20, 1.0), fit(130, 20.0)
    explains.searched = True
    tries.found, tries.better = {"spring_force": spring, "ripple": ripple}, {id(spring): explains}
    classes = [[option("spring_force", 0)], [option("ripple", 1)]]
    assert names(refitted(tries.bench, fit(1000, 250.0), classes, ())) == ["spring_force", "ripple"]
    assert tries.searched == [spring]
    near, tries.searched = fit(40, 8.0), []
    explains.values["mu_c"] = 0.31
    tries.bench.refit = lambda found, own, values, **options: near if values["mu_c"] == 0.31 else None
    refitted(tries.bench, fit(1000, 250.0), [[option("spring_force", 0)], [option("ripple", 1)]], ())
    assert tries.searched == [spring, explains, near]


def test_what_explains_the_residual_from_the_unknowns_of_the_best_is_found_where_searches_were_in_vain(tries):
    asymmetry, constant, far = fit(100, 20.0), fit(130, 22.0), fit(400, 22.0)
    asymmetry.values["mu_c"] = 0.31
    tries.found = {"asymmetry": asymmetry, "constant_force": constant, "spring_force": far}
    tries.bench.refit = lambda found, own, values, **options: fit(20, 1.0) if values["mu_c"] == 0.31 else None
    classes = [[option("asymmetry", 0)], [option("constant_force", 1)], [option("spring_force", 2)]]
    found = refitted(tries.bench, fit(1000, 250.0), classes, ())
    assert names(found)[-1] == "asymmetry"
    assert tries.searched == [asymmetry, constant]  # each where it is the best, or near a best that no search moved


def test_rivals_within_reach_are_searched_anew_and_those_that_gain_nothing_are_not(tries):
    drag, ripple, idle = fit(80, 1.0), fit(84, 1.0), fit(100, 1.0)
    tries.found = {"drag": drag, "ripple": ripple, "adhesion": idle}
    tries.better = {id(ripple): fit(50, 1.0)}
    classes = [[option("drag", 0)], [option("ripple", 1)], [option("adhesion", 2)]]
    assert names(refitted(tries.bench, fit(100, 1.0), classes, ())) == ["ripple", "drag", "adhesion"]
    assert tries.searched == [drag, ripple]


@pytest.mark.parametrize(
    ("cost", "promised", "beside", "searched"),
    [
        (84.5, 16.0, None, False),
        (84.5, 26.0, None, True),
        (84.5, 9.0, None, True),
        (84.5, 16.0, {}, True),
        (81.0, 20.0, None, True),  # too near to be told apart by the linear model
    ],
)
def test_rivals_that_all_gained_what_their_score_tests_promised_are_not_searched_where_the_best_is_ahead(
    tries, cost, promised, beside, searched
):
    tries.found = {"drag": fit(80, 1.0), "ripple": fit(cost, 1.0)}
    drag, ripple = option("drag", 0, 2 * 20.0), option("ripple", 1, 2 * promised)
    ripple.beside = beside
    refitted(tries.bench, fit(100, 1.0), [[drag], [ripple]], ())
    assert bool(tries.searched) == searched


def test_a_rival_that_stopped_just_short_of_a_promise_that_held_is_searched_though_the_fit_is_astray(
    tries, monkeypatch
):
    monkeypatch.setattr(minima, "look", lambda bench, before, t: fit(9500))
    ripple, gradient = fit(9410, 1.0), fit(9464, 1.0)
    tries.found, tries.better = {"ripple": ripple, "position_friction": gradient}, {id(gradient): fit(9300, 1.0)}
    classes = [[option("ripple", 0, 2 * 2520.0)], [option("position_friction", 1, 2 * 2540.0)]]
    assert names(refitted(tries.bench, fit(11980, 70.0), classes, ())) == ["position_friction", "ripple"]


@pytest.mark.parametrize(("cost", "searched"), [(500, False), (485, True)])
def test_a_rival_that_the_search_of_the_best_leaves_out_of_reach_is_searched_only_if_both_were_level(
    tries, cost, searched
):
    best, rival = fit(480, 1.0), fit(cost, 1.0)
    tries.found, tries.better = {"drag": best, "ripple": rival}, {id(best): fit(400, 1.0)}
    assert names(refitted(tries.bench, fit(1000, 20.0), [[option("drag", 0)], [option("ripple", 1)]], ()))[0] == "drag"
    assert tries.searched == [best, rival][: 1 + searched]


def test_of_rivals_that_the_score_tests_cannot_tell_apart_one_is_searched_anew(tries):
    offset, bias, drag = fit(80, 1.0), fit(84, 1.0), fit(86, 1.0)
    tries.found = {"com_offset": offset, "sensor_bias": bias, "drag": drag}
    classes = [[option("com_offset", 0)], [option("sensor_bias", 0)], [option("drag", 1)]]
    refitted(tries.bench, fit(100, 1.0), classes, ())
    assert tries.searched == [offset, drag]


def test_a_rival_that_stopped_short_of_what_its_score_test_promised_is_searched_anew(tries):
    drag, short = fit(80, 1.0), fit(100, 1.0)
    tries.found = {"drag": drag, "low_speed": short}
    tries.better = {id(short): fit(60, 1.0)}
    classes = [[option("drag", 0, 35.0)], [option("low_speed", 1, 40.0)]]
    assert names(refitted(tries.bench, fit(100, 1.0), classes, ())) == ["low_speed", "drag"]
    classes[1][0].statistic, tries.searched = 4.0, []
    assert names(refitted(tries.bench, fit(100, 1.0), classes, ())) == ["drag", "low_speed"]
    assert not tries.searched


@pytest.mark.parametrize(("correlation", "tried", "least"), [(30.0, 1, 95), (1.0, 3, 50)])
def test_a_search_ends_at_a_start_that_explains_only_where_the_fit_did_not(monkeypatch, correlation, tried, least):
    starts = [{"v_s": 0.01}, {"v_s": 0.02}]
    found = iter([fit(95, 1.0), fit(94, 1.0), fit(50, 1.0)])
    monkeypatch.setattr(benches, "peaked", lambda problem, values: starts)
    seen = []

    def refit(before, names, values, **options):
        if "iterations" not in options:  # the rest of a try that came near
            return before
        seen.append(values)
        return next(found)

    stub = SimpleNamespace(problem=None, refit=refit, _anew=lambda f, thorough, starts: seen.append(f) or next(found))
    best = Bench.search(stub, fit(100, correlation))
    assert len(seen) == tried
    assert best.state.cost == least


@pytest.mark.parametrize(("cost", "count"), [(149.0, 2), (151.0, 1)])
def test_a_try_goes_on_only_where_it_came_near(cost, count):
    made = []

    def refit(before, names, values, **options):
        made.append(options)
        return fit(cost - len(made))

    found = tried(SimpleNamespace(refit=refit), fit(100), ("mu_c",), {"mu_c": 0.3}, 149.5)
    assert len(made) == count and found.state.cost == cost - count


def test_a_fit_that_was_searched_already_is_only_tried_with_its_static_friction_brought_back(monkeypatch):
    monkeypatch.setattr(benches, "peaked", lambda problem, values: [])
    searched = fit(100)
    searched.searched = True
    monkeypatch.setattr(benches, "replace", lambda item, **changes: SimpleNamespace(**(vars(item) | changes)))
    stub = SimpleNamespace(problem=None, _anew=lambda *a: pytest.fail("searched again"))
    assert Bench.search(stub, searched) == searched


def test_a_fit_that_explains_but_stopped_short_starts_from_the_unknowns_of_the_best(tries):
    best, short = fit(100, 1.0), fit(170, 1.0)
    best.locals, best.values["mu_c"] = ("those of the best",), 0.31
    tries.found = {"sensor_bias": best, "com_offset": short}
    started = []

    def refit(there, own, values, **options):
        if options.get("limits") or "iterations" not in options:  # the end of its own try, or of this one
            return None
        started.append((there.state.locals, values["mu_c"]))
        return fit(100, 1.0)

    tries.bench.refit = refit
    found = refitted(tries.bench, fit(1000), [[option("sensor_bias", 0)], [option("com_offset", 1)]], ())
    assert {t.candidate.effect: f.state.cost for t, f in found} == {"sensor_bias": 100, "com_offset": 100}
    assert started == [(("those of the best",), 0.31)]


def test_a_rival_much_like_a_best_of_several_strengths_starts_in_its_place_in_the_quadratic_model(tries):
    ripple, gradient = option("ripple"), option("position_friction")
    ripple.step, gradient.step = {"sin": 0.1, "cos": 0.2}, {"position_friction": 0.3}
    best, there = fit(50, 1.0), fit(50, 1.0)
    best.names, there.values["mu_c"] = ("mu_c", "ripple"), 0.31
    made = []

    def refit(found, own, values, **options):
        made.append((own, values["mu_c"]))
        return there if options.get("iterations") == 0 else fit(55, 1.0)

    tries.bench.refit = refit
    tries.bench.without = lambda both, gone, held: there if gone == ["ripple"] else None
    short = fit(200, 8.0)
    short.names = ("mu_c", "position_friction")
    assert moved(tries.bench, (gradient, short), (ripple, best)).state.cost == 55
    assert made[0] == (("mu_c", "ripple", "position_friction"), 0.3) and made[1] == (short.names, 0.31)


@pytest.mark.parametrize(
    ("promised", "beside", "searched"),
    [
        (45.0, None, True),
        (35.0, None, False),  # it gained 20, more than half of that
        (200.0, None, False),  # the score test was made in a wrong minimum: it may promise anything
        (45.0, {}, False),  # a promise of the score test beside a friction held elsewhere
    ],
)
def test_a_lone_contender_that_stopped_far_short_of_its_promise_is_searched_anew(tries, promised, beside, searched):
    short = fit(80, 1.0)
    tries.found, tries.better = {"drag": short}, {id(short): fit(60, 1.0)}
    drag = option("drag", 0, 2 * promised)
    drag.beside = beside
    ((_, found),) = refitted(tries.bench, fit(100, 1.0), [[drag]], ())
    assert found.state.cost == (60 if searched else 80)
    assert tries.searched == ([short] if searched else [])
