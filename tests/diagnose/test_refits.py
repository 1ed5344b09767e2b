"""Which candidates are refitted, and which fits are searched anew."""

from __future__ import annotations

from collections import defaultdict
from types import SimpleNamespace

import numpy as np
import pytest

from frictionpinn.diagnose import bench as benches
from frictionpinn.diagnose import minima, refits, rivals
from frictionpinn.diagnose import tries as tries_
from frictionpinn.diagnose.bench import Bench, tried
from frictionpinn.diagnose.candidates import Candidate
from frictionpinn.diagnose.minima import AT_ONCE, BATCH, BETTER
from frictionpinn.diagnose.refits import refitted


def fit(cost: float, correlation: float = 50.0):
    """A stub of a fit: what remains of it is noise where its correlation is below 4.5."""
    return SimpleNamespace(
        names=("mu_c",), values=defaultdict(float, mu_c=0.3), count=1000, state=SimpleNamespace(cost=cost, locals=()),
        correlation=correlation, explains=correlation < 4.5, minima=(), searched=False, locals=(),
    )  # fmt: skip


def option(effect: str, trace: int = 0, statistic: float = 0.0):
    own = np.eye(40)[trace]
    return SimpleNamespace(
        candidate=Candidate(effect, effect, (effect,), bends=effect == "stribeck_shape"),
        beside=None, trace=own, shape={}, statistic=statistic, step={},
    )  # fmt: skip


@pytest.fixture
def tries(monkeypatch):
    """What was refitted and what was searched; ``found`` tells the fit of each candidate, ``better`` a search's."""
    seen = SimpleNamespace(refitted=[], searched=[], found={}, better={})

    def add(bench, before, t, thorough=True, **options):
        seen.refitted.append(t.candidate.effect)
        return seen.found[t.candidate.effect]

    def search(found):
        seen.searched.append(found)
        return seen.better.get(id(found))

    seen.bench = SimpleNamespace(
        mechanism=SimpleNamespace(memory=True),
        search=search,
        refit=lambda *a, **k: None,
        clip=dict,
        problem=None,
        sizes=None,
    )
    for module in (refits, minima):
        monkeypatch.setattr(module, "add", add)
    monkeypatch.setattr(refits, "lifted", lambda *a: None)
    for module in (refits, minima, rivals):
        monkeypatch.setattr(module, "replace", lambda item, **changes: SimpleNamespace(**(vars(item) | changes)))
    return seen


def names(fits):
    return [t.candidate.effect for t, _ in fits]


def test_what_score_tests_cannot_tell_apart_is_refitted_where_the_first_of_them_leaves_more_than_noise(tries):
    tries.found = {"constant_force": fit(110, 8.0), "asymmetry": fit(100, 1.0)}
    classes = [[option("constant_force"), option("asymmetry")]]
    assert names(refitted(tries.bench, fit(1000), classes, ())) == ["asymmetry", "constant_force"]
    assert [names([(t, None) for t in group]) for group in classes] == [["constant_force"], ["asymmetry"]]


def test_a_class_mate_that_stopped_short_is_fitted_from_the_other_with_the_strength_that_does_the_same(tries):
    tries.found = {"com_offset": fit(170, 8.0), "sensor_bias": fit(100, 1.0)}
    tries.found["sensor_bias"].values["bias"] = -0.04
    offset, bias = option("com_offset"), option("sensor_bias")
    offset.step, bias.step = {"across": 0.005}, {"bias": -0.02}
    started = []
    tries.bench.refit = lambda before, own, values, **options: started.append(dict(values)) or fit(100, 1.0)
    fits = refitted(tries.bench, fit(1000), [[offset, bias]], ())
    assert {t.candidate.effect: found.state.cost for t, found in fits} == {"com_offset": 100, "sensor_bias": 100}
    assert started[0]["across"] == pytest.approx(0.01)


def test_beside_a_fit_that_explains_nearly_all_the_others_start_from_there_too_and_are_searched(tries, monkeypatch):
    found = {("asymmetry", 0.5): fit(200, 60.0), ("asymmetry", 0.3): fit(120, 20.0)}
    asymmetric, constant = fit(110, 20.0), fit(50, 1.0)
    asymmetric.values["mu_c"] = 0.3
    before = fit(1000, 250.0)
    before.values["mu_c"] = 0.5

    def add(bench, start, t, thorough=True, **options):
        tries.refitted.append((t.candidate.effect, start.values["mu_c"], thorough))
        return asymmetric if t.candidate.effect == "ripple" else found["asymmetry", start.values["mu_c"]]

    monkeypatch.setattr(refits, "add", add)
    tries.better = {id(found["asymmetry", 0.3]): constant}
    classes = [[option("ripple", 0)], [option("asymmetry", 1)]]
    assert names(refitted(tries.bench, before, classes, ())) == ["asymmetry", "ripple"]
    assert tries.refitted == [("ripple", 0.5, True), ("asymmetry", 0.5, False), ("asymmetry", 0.3, False)]
    assert tries.searched == [asymmetric, found["asymmetry", 0.3]]


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


def test_a_leader_that_leaves_little_is_searched_before_any_other_is_tried(tries):
    leader, solved = fit(100, 20.0), fit(50, 1.0)
    tries.found, tries.better = {"drag": leader, "ripple": fit(200, 60.0)}, {id(leader): solved}
    classes = [[option("drag", 0)], [option("ripple", 1)]]
    assert names(refitted(tries.bench, fit(1000, 250.0), classes, ())) == ["drag", "ripple"]
    assert tries.searched == [leader]
    assert tries.refitted == ["drag", "ripple"]  # from where it stands alone: the leader explains all


@pytest.mark.parametrize(
    ("statistic", "order"),
    [(400.0, ["drag", "constant_force", "ripple"]), (200.0, ["drag", "ripple", "constant_force"])],
)
def test_where_the_leader_was_searched_in_vain_and_the_fit_is_astray_the_others_come_before_what_ranks_behind(
    tries, monkeypatch, statistic, order
):
    monkeypatch.setattr(
        minima, "look", lambda bench, before, t: fit(150) if t.candidate.effect != "ripple" else fit(500)
    )
    tries.found = {"drag": fit(100, 20.0), "ripple": fit(500, 60.0), "constant_force": fit(50, 1.0)}
    classes = [[option("drag", 0, statistic)], [option("ripple", 1, statistic)]]
    found = refitted(tries.bench, fit(1000, 250.0), classes, [option("constant_force", 2)])
    assert names(found)[0] == "constant_force"
    assert list(dict.fromkeys(tries.refitted)) == order


def test_where_the_fit_is_astray_a_first_look_says_which_candidate_is_refitted_first(tries, monkeypatch):
    tries.found = {"ripple": fit(200, 60.0), "spring_force": fit(100, 1.0)}
    looks = {"ripple": fit(500), "spring_force": fit(150)}
    monkeypatch.setattr(minima, "look", lambda bench, before, t: looks[t.candidate.effect])
    for statistic, order in ((400.0, ["spring_force", "ripple"]), (200.0, ["ripple", "spring_force"])):
        tries.refitted = []
        refitted(
            tries.bench, fit(1000), [[option("ripple", 0, statistic)], [option("spring_force", 1, statistic / 2)]], ()
        )
        assert tries.refitted == order


def test_what_score_tests_cannot_tell_apart_stays_one_class_where_the_first_of_them_explains_the_residual(tries):
    tries.found = {"constant_force": fit(110, 1.0), "asymmetry": fit(100, 1.0)}
    classes = [[option("constant_force"), option("asymmetry")]]
    assert names(refitted(tries.bench, fit(1000), classes, ())) == ["constant_force"]
    assert len(classes) == 1


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


def test_of_rivals_that_the_score_tests_cannot_tell_apart_one_is_searched_anew(tries):
    offset, bias, drag = fit(80, 1.0), fit(84, 1.0), fit(86, 1.0)
    tries.found = {"com_offset": offset, "sensor_bias": bias, "drag": drag}
    classes = [[option("com_offset", 0)], [option("sensor_bias", 0)], [option("drag", 1)]]
    refitted(tries.bench, fit(100, 1.0), classes, ())
    assert tries.searched == [offset, drag]


def test_beside_what_leaves_little_a_candidate_that_gains_nothing_at_a_first_look_is_not_refitted(tries, monkeypatch):
    looks = {"ripple": fit(900), "spring_force": fit(150), "asymmetry": fit(400)}
    monkeypatch.setattr(minima, "look", lambda bench, before, t: looks[t.candidate.effect])
    tries.found = {"spring_force": fit(100, 1.0), "asymmetry": fit(300, 60.0)}
    classes = [[option(name, k, 400.0)] for k, name in enumerate(looks)]
    found = refitted(tries.bench, fit(1000), classes, ())
    assert tries.refitted == ["spring_force", "asymmetry"]
    assert names(found) == ["spring_force", "asymmetry", "ripple"]


def test_a_rival_that_stopped_short_of_what_its_score_test_promised_is_searched_anew(tries):
    drag, short = fit(80, 1.0), fit(100, 1.0)
    tries.found = {"drag": drag, "low_speed": short}
    tries.better = {id(short): fit(60, 1.0)}
    classes = [[option("drag", 0, 35.0)], [option("low_speed", 1, 40.0)]]
    assert names(refitted(tries.bench, fit(100, 1.0), classes, ())) == ["low_speed", "drag"]
    classes[1][0].statistic, tries.searched = 4.0, []
    assert names(refitted(tries.bench, fit(100, 1.0), classes, ())) == ["drag", "low_speed"]
    assert not tries.searched


def test_where_no_contender_explains_the_residual_the_best_of_all_others_are_refitted(tries):
    others = [option(f"effect_{k}", k) for k in range(12)]
    tries.found = {t.candidate.effect: fit(1000 - k, 40.0) for k, t in enumerate(others)}
    tries.bench.problem = tries.bench.sizes = None
    looks = {f"effect_{k}": fit(900 - k) for k in range(12)}
    refits_look = {(*fit(0).names, name): found for name, found in looks.items()}
    tries.bench.refit = lambda before, own, values, **options: refits_look.get(tuple(own))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tries_, "lifted", lambda *a: None)
        patch.setattr(tries_, "reach", lambda t: {})
        classes = [[others[0]]]
        refitted(tries.bench, fit(1000), classes, others)
    first = [f"effect_{k}" for k in range(BATCH, BATCH - AT_ONCE, -1)]
    rest = [name for k in range(11, 0, -1) if (name := f"effect_{k}") not in first]
    assert tries.refitted == ["effect_0", *first, *rest[:BETTER]]
    assert len(classes) == 1 + AT_ONCE + BETTER


@pytest.mark.parametrize(("correlation", "tried", "least"), [(30.0, 1, 95), (1.0, 3, 50)])
def test_a_search_ends_at_a_start_that_explains_only_where_the_fit_did_not(monkeypatch, correlation, tried, least):
    starts = [{"v_s": 0.01}, {"v_s": 0.02}]
    found = iter([fit(95, 1.0), fit(94, 1.0), fit(50, 1.0)])
    monkeypatch.setattr(benches, "peaked", lambda problem, values: starts)
    seen = []

    def refit(before, names, values, **options):
        if not options:  # the rest of a try that came near
            return before
        seen.append(values)
        return next(found)

    stub = SimpleNamespace(problem=None, refit=refit, _anew=lambda f, thorough: seen.append(f) or next(found))
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


def test_a_refit_goes_on_from_where_a_first_look_ended(monkeypatch):
    monkeypatch.setattr(tries_, "lifted", lambda *a: None)
    began = []

    def refit(before, names, values, **options):
        began.append((before.state.cost, values["mu_c"]))
        return fit(300)

    looked = fit(400)
    looked.values["mu_c"] = 0.37
    bench = SimpleNamespace(refit=refit, clip=lambda values: values, problem=None, sizes=None, starts=[])
    before = fit(1000)
    tries_.add(bench, before, option("drag", 0), thorough=False, looked=looked)
    tries_.add(bench, before, option("drag", 0), thorough=False)
    assert began[0] == (400, 0.37) and began[1] == (1000, before.values["mu_c"])


def test_friction_that_vanished_is_brought_back_first_and_what_is_significant_there_is_looked_at_before_the_others(
    tries, monkeypatch
):
    monkeypatch.setattr(refits, "lifted", lambda *a: {"mu_c": 0.2})
    shown = [option(f"shown_{k}", k) for k in range(5)]
    for tested in shown:
        tested.beside = {"mu_c": 0.2}
    tries.found = {f"shown_{k}": fit(500 - k, 60.0) for k in range(4)} | {"shown_4": fit(100, 1.0)}
    tries.found |= {"ripple": fit(600, 60.0), "drag": fit(900, 60.0)}
    looked = []
    monkeypatch.setattr(minima, "look", lambda bench, before, t: looked.append(t) or fit(550 - len(looked)))
    found = refitted(tries.bench, fit(1000), [[option("ripple", 9)]], [option("drag", 10)], lambda: shown)
    assert tries.refitted[:4] == ["shown_0", "shown_1", "shown_2", "ripple"]
    assert [t.candidate.effect for t in looked] == ["shown_3", "shown_4", "drag"]
    assert names(found)[0] == "shown_4"


def test_a_fit_that_was_searched_already_is_only_tried_with_its_static_friction_brought_back(monkeypatch):
    monkeypatch.setattr(benches, "peaked", lambda problem, values: [])
    searched = fit(100)
    searched.searched = True
    stub = SimpleNamespace(problem=None, _anew=lambda *a: pytest.fail("searched again"))
    assert Bench.search(stub, searched) is None


@pytest.mark.parametrize(
    ("first", "correlation", "asked"), [("drag", 1.0, False), ("drag", 20.0, True), ("stribeck_shape", 1.0, True)]
)
def test_candidates_beside_a_friction_that_vanished_are_asked_for_where_none_explains_or_it_bends_what_is_left(
    tries, first, correlation, asked
):
    tries.found = {first: fit(100, correlation), "low_speed": fit(50, 1.0)}
    hidden = option("low_speed", 1)
    hidden.beside = {"mu_s": 0.6}
    found = refitted(tries.bench, fit(1000), [[option(first)]], (), lambda: [hidden])
    assert names(found) == (["low_speed", first] if asked else [first])


def test_a_fit_that_explains_but_stopped_short_starts_from_the_unknowns_of_the_best(tries):
    best, short = fit(100, 1.0), fit(170, 1.0)
    best.locals, best.values["mu_c"] = ("those of the best",), 0.31
    tries.found = {"sensor_bias": best, "com_offset": short}
    started = []

    def refit(there, own, values, **options):
        if "limits" in options or "iterations" not in options:  # the end of its own try, or of this one
            return None
        started.append((there.state.locals, values["mu_c"]))
        return fit(100, 1.0)

    tries.bench.refit = refit
    found = refitted(tries.bench, fit(1000), [[option("sensor_bias", 0)], [option("com_offset", 1)]], ())
    assert {t.candidate.effect: f.state.cost for t, f in found} == {"sensor_bias": 100, "com_offset": 100}
    assert started == [(("those of the best",), 0.31)]


def test_what_leaves_little_but_not_nothing_keeps_no_other_from_being_tried(tries, monkeypatch):
    monkeypatch.setattr(minima, "look", lambda bench, before, t: fit(300))
    tries.found = {"ripple": fit(100, 13.0), "constant_force": fit(50, 1.0)}
    found = refitted(tries.bench, fit(1000, 260.0), [[option("ripple", 0)]], [option("constant_force", 1)])
    assert names(found)[0] == "constant_force"
