"""Which candidates are refitted, and from where."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from contending import contest_stub, fit, names, option

from frictionpinn.diagnose import minima, refits, simpler
from frictionpinn.diagnose import tries as tries_
from frictionpinn.diagnose.candidates import Candidate
from frictionpinn.diagnose.minima import AT_ONCE, BATCH, BETTER
from frictionpinn.diagnose.refits import refitted


@pytest.fixture
def tries(monkeypatch):
    return contest_stub(monkeypatch)


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
    beside = [("asymmetry", 0.5, False), ("asymmetry", 0.3, False)]  # before the leader is searched, and after
    assert tries.refitted == [("ripple", 0.5, True), *beside, *beside]
    assert tries.searched == [asymmetric, found["asymmetry", 0.3]]


RANKED = ("drag", "ripple", "spring_force", "com_offset")


def test_a_leader_that_leaves_little_is_searched_once_the_next_two_were_tried_beside_it(tries):
    leader, solved = fit(100, 20.0), fit(50, 1.0)
    tries.found = {"drag": leader, **{name: fit(200, 60.0) for name in RANKED[1:]}}
    tries.better = {id(leader): solved}
    classes = [[option(name, k)] for k, name in enumerate(RANKED)]
    assert names(refitted(tries.bench, fit(1000, 250.0), classes, ()))[0] == "drag"
    assert tries.searched == [leader]
    beside = sorted(tries.refitted[1:5])  # from where they stand and from the leader
    assert tries.refitted[0] == "drag" and beside == ["ripple", "ripple", "spring_force", "spring_force"]
    assert sorted(tries.refitted[5:]) == sorted(RANKED[1:])  # from where they stand alone: the leader explains all


def test_one_of_the_next_two_that_leaves_nothing_spares_the_search_of_the_leader(tries):
    tries.found = {name: fit(200, 60.0) for name in RANKED} | {"drag": fit(100, 20.0), "spring_force": fit(50, 1.0)}
    classes = [[option(name, k)] for k, name in enumerate(RANKED)]
    assert names(refitted(tries.bench, fit(1000, 250.0), classes, ()))[:2] == ["spring_force", "drag"]
    assert not tries.searched


@pytest.mark.parametrize(
    ("statistic", "order"),
    [(400.0, ["constant_force", "com_offset"]), (200.0, ["com_offset", "constant_force"])],
)
def test_where_the_leader_was_searched_in_vain_and_the_fit_is_astray_the_others_come_before_what_ranks_behind(
    tries, monkeypatch, statistic, order
):
    monkeypatch.setattr(
        minima, "look", lambda bench, before, t: fit(150) if t.candidate.effect in ("drag", "constant_force") else None
    )
    tries.found = {name: fit(500, 60.0) for name in RANKED}
    tries.found |= {"drag": fit(100, 20.0), "constant_force": fit(50, 1.0)}
    classes = [[option(name, k, statistic)] for k, name in enumerate(RANKED)]
    found = refitted(tries.bench, fit(1000, 250.0), classes, [option("constant_force", 9)])
    assert names(found)[0] == "constant_force"
    assert list(dict.fromkeys(tries.refitted))[3:] == order


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


def test_beside_what_leaves_little_a_candidate_that_gains_nothing_at_a_first_look_is_not_refitted(tries, monkeypatch):
    looks = {"ripple": fit(900), "spring_force": fit(150), "asymmetry": fit(400)}
    monkeypatch.setattr(minima, "look", lambda bench, before, t: looks[t.candidate.effect])
    tries.found = {"spring_force": fit(100, 1.0), "asymmetry": fit(300, 60.0)}
    classes = [[option(name, k, 400.0)] for k, name in enumerate(looks)]
    found = refitted(tries.bench, fit(1000), classes, ())
    assert tries.refitted == ["spring_force", "asymmetry"]
    assert names(found) == ["spring_force", "asymmetry", "ripple"]


def test_an_effect_of_fewer_parameters_is_tried_in_the_place_of_a_best_that_explains(tries, monkeypatch):
    ripple, gradient, alike = option("ripple"), option("position_friction", 1), option("vibration", 2)
    for one, name in ((ripple, "ripple"), (alike, "vibration")):
        one.candidate = Candidate(name, name, (f"{name}_sin", f"{name}_cos"), (f"{name}_length",))
    best = fit(100, 1.0)
    best.names = ("mu_c", *ripple.candidate.strengths, *ripple.candidate.hidden)
    tries.found = {"ripple": best}
    tries.bench.without = lambda own, gone, held: fit(900)
    tries.bench.refit = lambda own, names, values, **options: fit(900 if options.get("iterations") == 0 else 90, 1.0)
    asked = []
    told = SimpleNamespace(tested=[gradient])
    monkeypatch.setattr(simpler, "scan", lambda bench, at, options, *a: asked.extend(options) or told)
    found = refitted(tries.bench, fit(1000, 20.0), classes := [[ripple]], [gradient, alike])
    assert names(found) == ["position_friction", "ripple"]
    assert asked == [gradient.candidate] and len(classes) == 2
    assert tries.refitted == ["ripple"]  # the score tests had not shown it


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


def test_what_leaves_little_but_not_nothing_keeps_no_other_from_being_tried(tries, monkeypatch):
    monkeypatch.setattr(minima, "look", lambda bench, before, t: fit(300))
    tries.found = {"ripple": fit(100, 13.0), "constant_force": fit(50, 1.0)}
    found = refitted(tries.bench, fit(1000, 260.0), [[option("ripple", 0)]], [option("constant_force", 1)])
    assert names(found)[0] == "constant_force"


@pytest.mark.parametrize(("short", "correlation", "looks"), [({}, 10.0, 0), ({}, 20.0, 1), (None, 10.0, 1)])
def test_where_windows_chose_a_leader_that_leaves_but_another_effect_no_others_are_asked_for_all_of_it(
    tries, monkeypatch, short, correlation, looks
):
    looked = []
    monkeypatch.setattr(minima, "look", lambda bench, before, t: looked.append(t.candidate.effect) or fit(900, 200.0))
    tries.found = {"asymmetry": fit(100, correlation), "payload": fit(900, 200.0)}
    leader = SimpleNamespace(**(vars(option("asymmetry", 0)) | {"short": short}))
    found = refitted(tries.bench, fit(1000, 250.0), [[leader]], [option("payload", 9)])
    assert names(found)[0] == "asymmetry"
    assert looked == ["payload"] * looks
