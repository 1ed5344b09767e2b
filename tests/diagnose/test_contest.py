"""Which of several candidates that explain the same data is named."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from frictionpinn.diagnose import contest
from frictionpinn.diagnose.candidates import Candidate
from frictionpinn.diagnose.contest import _decide
from frictionpinn.diagnose.refits import _best_of_each
from frictionpinn.diagnose.tries import penalised


def contender(effect: str, cost: float, held: float = 0.0, as_fitted: float | None = None):
    """A candidate and a stub of its fit, which carries what the held-out trials say of it, also as it was fitted."""
    fit = SimpleNamespace(
        names=("mu_c", effect), values={effect: 0.1}, count=1000, state=SimpleNamespace(cost=cost), held=held,
        as_fitted=held if as_fitted is None else as_fitted, explains=True,
    )  # fmt: skip
    candidate = Candidate(effect, effect, (effect,))
    return SimpleNamespace(
        candidate=candidate, beside=None, freedom=1, statistic=200.0, log_p=-30.0, step={}, short=None, untested=False,
        trace=np.eye(1, 30, len(effect))[0],
    ), fit  # fmt: skip


@pytest.fixture(autouse=True)
def no_mechanism(monkeypatch):
    """What held-out trials say; and effect -> why no mechanism has it."""
    no_mechanism = {}

    def gain(bench, before, fit, enough):
        return fit.as_fitted if fit.as_fitted >= enough else max(fit.as_fitted, fit.held)

    monkeypatch.setattr(contest, "compared_gains", lambda bench, before, fits: [fit.held for fit in fits])
    monkeypatch.setattr(contest, "held_out_gain", gain)
    monkeypatch.setattr(contest, "impossible", lambda bench, candidate, values: no_mechanism.get(candidate.effect, ""))
    return no_mechanism


def decided(first, *near):
    winner, _, alike, worse = _decide(None, None, first, first[1].held, list(near))
    return winner[0].candidate.effect, [p[0].candidate.effect for p in alike], [r.candidate.effect for r in worse]


def test_of_effects_that_the_data_do_not_tell_apart_the_usual_one_stands_first():
    first, second = contender("sensor_scale", 100.0, 50.0), contender("inertia", 100.3, 49.8)
    assert decided(first, second) == ("inertia", ["sensor_scale"], [])
    first[1].held = None
    assert decided(first, second) == ("inertia", ["sensor_scale"], [])
    assert decided(first, contender("inertia", 103.0)) == ("sensor_scale", ["inertia"], [])


def test_an_effect_that_explains_more_stands_first_however_usual_the_other():
    assert decided(contender("adhesion", 100.0, 50.0), contender("inertia", 103.0, 50.0))[0] == "adhesion"
    assert decided(contender("adhesion", 100.0, 50.0), contender("inertia", 100.0, 48.5))[0] == "adhesion"


def test_held_out_trials_that_prefer_a_rival_clearly_put_it_first_and_refuse_the_other():
    first, second = contender("inertia", 100.0, 50.0), contender("adhesion", 104.0, 60.0)
    assert decided(first, second) == ("adhesion", [], ["inertia"])


def test_a_candidate_that_was_refitted_twice_stands_once_with_its_better_fit():
    pairs = [contender("drag", 105.0), contender("asymmetry", 103.0), contender("drag", 101.0)]
    kept = _best_of_each(pairs)
    assert [(t.candidate.effect, f.state.cost) for t, f in kept] == [("drag", 101.0), ("asymmetry", 103.0)]
    assert penalised(kept[0][1]) < penalised(kept[1][1])


@pytest.mark.parametrize(
    ("bent", "steady", "declared", "winner"),
    [
        ({"as_fitted": -500.0}, {"held": 80.0}, 300.0, "adhesion"),
        ({"as_fitted": 60.0}, {"held": 80.0}, 300.0, "load_exponent"),  # the first predicts them as well
        ({"as_fitted": -500.0}, {"held": 80.0, "as_fitted": -3.0}, 300.0, "load_exponent"),  # the other neither
        ({"as_fitted": -500.0}, {"held": 74.0}, 300.0, "load_exponent"),  # 4 better, 3 of which the fitted trials take
        ({"as_fitted": -500.0}, {"held": 80.0}, 115.0, "load_exponent"),  # the other is not significant: it gains 6
    ],
)
def test_a_fit_that_predicts_held_out_trials_as_it_is_wins_over_one_that_is_bent_to_the_fitted_ones(
    monkeypatch, bent, steady, declared, winner
):
    fits = [contender("load_exponent", 100.0, 70.0, **bent), contender("adhesion", 109.0, **steady)]
    monkeypatch.setattr(contest, "refitted", lambda *a: fits)
    monkeypatch.setattr(contest, "contenders", lambda significant: [[tested] for tested, _ in fits])
    before = contender("nothing", declared)[1]
    accepted, fit, refused = contest.contest(None, before, (), tuple, (), contest.Settings())
    assert accepted.candidate.effect == winner and fit is {t.candidate.effect: f for t, f in fits}[winner]
    if winner == "adhesion":
        assert [r.candidate.effect for r in refused] == ["load_exponent"] and not accepted.alike
        assert refused[0].why == "predicts held-out trials worse than adhesion"
        assert accepted.evidence["gain_fitted"] == 191.0 and accepted.evidence["gain_held_out"] == 80.0


@pytest.mark.parametrize(
    ("short", "correlation_explained", "accepted"), [({}, True, True), (None, True, False), ({}, False, False)]
)
def test_a_fit_from_windows_that_held_out_trials_refuse_is_searched_anew_and_asked_again(
    monkeypatch, short, correlation_explained, accepted
):
    (tested, fit), (_, lower) = contender("drag", 120.0, -3.0), contender("drag", 100.0, 20.0)
    tested.short, fit.searched, fit.explains = short, False, correlation_explained
    monkeypatch.setattr(contest, "refitted", lambda *a: [(tested, fit)])
    monkeypatch.setattr(contest, "contenders", lambda significant: [[tested]])
    before, bench = contender("nothing", 300.0)[1], SimpleNamespace(search=lambda found: lower)
    found, after, refused = contest.contest(bench, before, (), tuple, (), contest.Settings())
    assert (found is not None) is accepted
    assert after is (lower if accepted else before)
    assert [r.candidate.effect for r in refused] == ([] if accepted else ["drag"])


def test_a_value_that_no_mechanism_has_is_refused_with_the_reason_and_the_next_is_asked(monkeypatch, no_mechanism):
    fits = [contender("delay", 100.0, 50.0), contender("drag", 120.0, 40.0)]
    monkeypatch.setattr(contest, "refitted", lambda *a: fits)
    monkeypatch.setattr(contest, "contenders", lambda significant: [[tested] for tested, _ in fits])
    no_mechanism["delay"] = "longer than a period of the fastest motion"
    accepted, _, refused = contest.contest(None, contender("nothing", 300.0)[1], (), tuple, (), contest.Settings())
    assert accepted.candidate.effect == "drag"
    assert [(r.candidate.effect, r.why) for r in refused] == [("delay", no_mechanism["delay"])]


@pytest.mark.parametrize(
    ("inertia", "payload", "alike"),
    [
        ((103.0, 50.0), (100.0, 46.0), ["payload"]),  # fits better by 3, predicts worse by 4: 1 in all
        ((100.0, 50.0), (101.0, 0.9), []),  # held-out trials tell them apart
        ((101.0, 1.2), (100.0, 0.9), ["payload"]),  # refused by the held-out trials, by a hair
        ((100.0, 50.0), (107.0, 50.0), []),
    ],
)
def test_what_acts_the_same_and_all_trials_together_do_not_tell_apart_is_listed_not_refused(
    monkeypatch, inertia, payload, alike
):
    fits = [contender("inertia", *inertia), contender("payload", *payload)]
    fits[1][0].trace = fits[0][0].trace
    fits.sort(key=lambda pair: pair[1].state.cost)
    monkeypatch.setattr(contest, "refitted", lambda *a: fits)
    monkeypatch.setattr(contest, "contenders", lambda significant: [[tested] for tested, _ in fits])
    accepted, _, refused = contest.contest(None, contender("nothing", 300.0)[1], (), tuple, (), contest.Settings())
    assert accepted.candidate.effect == "inertia" and [c.effect for c, _ in accepted.alike] == alike
    assert not alike or not refused


def test_what_acts_otherwise_is_not_listed_however_well_it_fits(monkeypatch):
    fits = [contender("adhesion", 100.0, 46.0), contender("drag", 103.0, 50.0)]
    monkeypatch.setattr(contest, "refitted", lambda *a: fits)
    monkeypatch.setattr(contest, "contenders", lambda significant: [[tested] for tested, _ in fits])
    accepted, _, refused = contest.contest(None, contender("nothing", 300.0)[1], (), tuple, (), contest.Settings())
    assert not accepted.alike and [r.candidate.effect for r in refused] == ["adhesion"]
