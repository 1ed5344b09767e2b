"""Which candidates a further round of the selection may ask."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from contending import fit, option

from frictionpinn.diagnose import select as selecting
from frictionpinn.diagnose.contest import Accepted, Refused
from frictionpinn.diagnose.select import Settings, select


@pytest.fixture
def rounds(monkeypatch):
    """A selection whose rounds accept what ``accepted`` names, and from which ``dropped`` are taken out again."""
    seen = SimpleNamespace(asked=[], accepted=[], dropped=[], why=lambda name: "")
    spring, ripple = option("spring_force", 0), option("ripple", 1)
    for tested in (spring, ripple):
        tested.log_p = -50.0
    table = {"spring_force": spring, "ripple": ripple}
    scanned = SimpleNamespace(tested=[spring, ripple], remaining=[])

    def contest(bench, before, significant, hidden, others, settings, *over_windows):
        seen.asked.append([t.candidate.name for t in significant])
        if not seen.accepted:
            return None, before, []
        tested = table[seen.accepted.pop(0)]
        return Accepted(tested.candidate, tested, {}), before, []

    def polish(bench, selection, *rest):
        if seen.dropped and selection.accepted[-1].candidate.name == seen.dropped[0]:
            seen.dropped.pop(0)
            selection.refused.append(Refused(selection.accepted.pop().candidate, "not needed in the end"))

    monkeypatch.setattr(selecting, "contest", contest)
    monkeypatch.setattr(selecting, "_polish", polish)
    monkeypatch.setattr(selecting, "_blunt", lambda *a: None)
    monkeypatch.setattr(selecting, "intervals", lambda *a: ({}, {}))
    monkeypatch.setattr(selecting, "impossible", lambda bench, c, values, ci95: seen.why(c.name))
    monkeypatch.setattr(selecting, "_beside_vanished", lambda *a: [])
    monkeypatch.setattr(selecting, "widened", lambda bench, found: found)
    monkeypatch.setattr(selecting, "scan", lambda *a: scanned)
    bench = SimpleNamespace(base=lambda: fit(1000))
    options = [table["spring_force"].candidate, table["ripple"].candidate]
    seen.run = lambda: select(bench, options, (), {}, Settings())
    return seen


def test_an_effect_that_but_led_out_of_a_wrong_minimum_is_asked_again_there(rounds):
    rounds.accepted, rounds.dropped = ["spring_force", "spring_force"], ["spring_force"]
    selection = rounds.run()
    assert rounds.asked[:2] == [["spring_force", "ripple"]] * 2
    assert [a.candidate.name for a in selection.accepted] == ["spring_force"] and not selection.refused


def test_one_that_is_dropped_a_second_time_is_asked_no_more(rounds):
    rounds.accepted, rounds.dropped = ["spring_force"] * 2, ["spring_force"] * 2
    selection = rounds.run()
    assert rounds.asked == [["spring_force", "ripple"]] * 2 + [["ripple"]]
    assert not selection.accepted and [r.candidate.name for r in selection.refused] == ["spring_force"]


def test_an_effect_whose_interval_holds_zero_in_the_end_is_refused_and_the_next_is_asked(rounds):
    rounds.accepted = ["spring_force", "ripple"]
    rounds.why = lambda name: "its 95 % interval holds zero" if name == "spring_force" else ""
    selection = rounds.run()
    assert [a.candidate.name for a in selection.accepted] == ["ripple"]
    assert [(r.candidate.name, r.why) for r in selection.refused] == [("spring_force", "its 95 % interval holds zero")]
    assert rounds.asked[:2] == [["spring_force", "ripple"], ["ripple"]]


def test_an_effect_that_makes_an_earlier_one_impossible_is_refused_itself(rounds):
    rounds.accepted = ["ripple", "spring_force"]
    rounds.why = lambda name: "no mechanism" if name == "ripple" and len(rounds.asked) > 1 else ""
    selection = rounds.run()
    assert [a.candidate.name for a in selection.accepted] == ["ripple"]
    assert [(r.candidate.name, r.why) for r in selection.refused] == [
        ("spring_force", "with it ripple is not possible: no mechanism")
    ]
