"""How long the starts of a candidate's refit are followed."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from contending import contest_stub, fit, option

from frictionpinn.diagnose import refits, tries
from frictionpinn.diagnose.bench import SHORT
from frictionpinn.diagnose.refits import refitted
from frictionpinn.diagnose.tries import add

WHOLE = None  # as many iterations as a refit takes


@pytest.fixture
def made(monkeypatch):
    """A bench whose refits end at the costs that it is given, one after another, and what they were asked."""
    monkeypatch.setattr(tries, "lifted", lambda *a: None)
    seen = SimpleNamespace(costs=[], asked=[])

    def refit(start, names, values, limits=None, iterations=WHOLE):
        seen.asked.append(iterations)
        return SimpleNamespace(**(vars(fit(seen.costs.pop(0), 200.0)) | {"names": names}))

    seen.bench = SimpleNamespace(refit=refit, clip=dict, problem=None, sizes=None, starts=[{"mu_c": 0.4}])
    return seen


def test_starts_after_the_first_are_given_up_where_they_stay_far_behind_the_best(made):
    made.costs = [990, 985, 980, 995]
    assert add(made.bench, fit(1000, 250.0), option("drag", statistic=2000.0), near=775.0).state.cost == 980
    assert made.asked == [WHOLE, SHORT, SHORT, SHORT]


def test_a_start_that_comes_near_the_best_is_followed_to_its_end(made):
    made.costs = [990, 700, 650, 980, 985]
    assert add(made.bench, fit(1000, 250.0), option("drag", statistic=2000.0), near=775.0).state.cost == 650
    assert made.asked == [WHOLE, SHORT, WHOLE, SHORT, SHORT]


def test_a_start_that_a_look_has_ranked_is_given_up_like_the_others(made):
    made.costs = [990, 985, 980, 995]
    add(made.bench, fit(1000, 250.0), option("drag", statistic=2000.0), looked=fit(991, 250.0), near=775.0)
    assert made.asked == [SHORT] * 4


def test_the_first_candidate_is_followed_from_every_start(made):
    made.costs = [990, 985, 980, 995]
    add(made.bench, fit(1000, 250.0), option("drag", statistic=2000.0))
    assert made.asked == [WHOLE] * 4


def test_a_candidate_is_far_behind_where_it_gains_less_than_a_quarter_of_the_best(monkeypatch):
    contest, told = contest_stub(monkeypatch), {}
    contest.found = {"drag": fit(100, 100.0), "ripple": fit(900, 240.0)}

    def noted(bench, before, t, thorough=True, near=None, **options):
        told.setdefault(t.candidate.effect, near)
        return contest.found[t.candidate.effect]

    monkeypatch.setattr(refits, "add", noted)
    refitted(contest.bench, fit(1000, 250.0), [[option("drag", 0)], [option("ripple", 1)]], ())
    assert told == {"drag": None, "ripple": pytest.approx(1000 - 0.25 * 900)}


@pytest.fixture
def over_windows(monkeypatch):
    """Fits of whole trials from windows end where this says."""
    seen = SimpleNamespace(ends=None, asked=0)

    def from_windows(bench, start, tested, near=None, **options):
        seen.asked += 1
        return seen.ends

    monkeypatch.setattr(tries, "from_windows", from_windows)
    return seen


def windowed(effect: str):
    return SimpleNamespace(**(vars(option(effect, statistic=2000.0)) | {"short": {"mu_c": 0.3}}))


def test_a_fit_from_windows_that_leaves_little_is_the_only_start(made, over_windows):
    over_windows.ends = fit(600, 20.0)
    assert add(made.bench, fit(1000, 250.0), windowed("drag")) is over_windows.ends
    assert not made.asked


def test_other_starts_are_tried_beside_one_from_windows_that_leaves_much(made, over_windows):
    over_windows.ends, made.costs = fit(900, 240.0), [850, 880]
    assert add(made.bench, fit(1000, 250.0), windowed("drag")).state.cost == 850
    assert len(made.asked) == 2  # not those that the declared model has from its own windows


def test_a_candidate_that_was_tried_before_goes_on_from_where_that_ended(made, over_windows):
    made.costs = [500]
    add(made.bench, fit(1000, 250.0), windowed("drag"), looked=fit(600, 200.0))
    assert not over_windows.asked
