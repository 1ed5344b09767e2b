"""Which of several candidates that explain the same data is named."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from frictionpinn.diagnose import contest
from frictionpinn.diagnose.candidates import Candidate
from frictionpinn.diagnose.contest import _decide
from frictionpinn.diagnose.refits import _best_of_each
from frictionpinn.diagnose.tries import penalised


def contender(effect: str, cost: float, held: float = 0.0):
    """A candidate and a stub of its fit, which carries what the held-out trials say of it."""
    fit = SimpleNamespace(
        names=("mu_c", effect), count=1000, state=SimpleNamespace(cost=cost), held=held, explains=True
    )
    return SimpleNamespace(candidate=Candidate(effect, effect, (effect,)), beside=None), fit


@pytest.fixture(autouse=True)
def held_out(monkeypatch):
    monkeypatch.setattr(contest, "compared_gains", lambda bench, before, fits: [fit.held for fit in fits])


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
