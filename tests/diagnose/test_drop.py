"""Effects that are taken out again because the fit is as good without them."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from frictionpinn.diagnose import select
from frictionpinn.diagnose.candidates import Candidate
from frictionpinn.diagnose.contest import Accepted, Settings
from frictionpinn.diagnose.select import Selection, _drop

SPRING = Candidate("spring_force", "spring_force", ("spring_stiffness",), ("spring_rest",), ({"spring_rest": 0.0},))
RIPPLE = Candidate("ripple", "ripple", ("ripple_sin",), ("ripple_wavelength",), ({"ripple_wavelength": 1.0},))
VALUES = {"mu_c": 0.3, "spring_stiffness": 1.1, "spring_rest": 0.4, "ripple_sin": 0.3, "ripple_wavelength": 0.8}


def fit(names, cost, **values):
    return SimpleNamespace(names=tuple(names), values=VALUES | values, state=SimpleNamespace(cost=cost))


def accepted(candidate: Candidate) -> Accepted:
    return Accepted(candidate, SimpleNamespace(freedom=1), {})


@pytest.fixture
def selection() -> Selection:
    made = Selection(None, fit(VALUES, 100.0), None, None)
    made.accepted = [accepted(RIPPLE), accepted(SPRING)]
    return made


def test_an_effect_goes_where_the_other_found_anew_does_as_well_alone(selection, monkeypatch):
    seen = []

    def refit(before, names, values, **options):
        return fit(names, 500.0, **values)

    def scan(bench, bare, options, remainders, places):
        seen.append((bare.names, bare.values["spring_stiffness"], bare.values["ripple_sin"]))
        return SimpleNamespace(tested=[SimpleNamespace(candidate=options[0])])

    def add(bench, bare, tested, thorough):
        names = (*bare.names, *tested.candidate.strengths, *tested.candidate.hidden)
        return fit(names, 99.0 if tested.candidate is SPRING else 400.0, spring_stiffness=-1.4)

    monkeypatch.setattr(select, "scan", scan)
    monkeypatch.setattr(select, "add", add)
    assert _drop(SimpleNamespace(refit=refit), selection, Settings())
    assert [a.candidate for a in selection.accepted] == [SPRING]
    assert selection.fit.values["spring_stiffness"] == -1.4
    assert set(selection.fit.names) == {"mu_c", "spring_stiffness", "spring_rest"}
    assert seen[0] == (("mu_c",), 0.0, 0.0)  # both neutral: its place is not where the ripple pushed it
    assert "not needed" in selection.refused[0].why and selection.refused[0].candidate is RIPPLE


def test_effects_stay_that_nothing_replaces(selection, monkeypatch):
    monkeypatch.setattr(select, "scan", lambda *a: SimpleNamespace(tested=[None]))
    monkeypatch.setattr(select, "add", lambda *a, **k: None)
    bench = SimpleNamespace(refit=lambda before, names, values, **options: fit(names, 500.0, **values))
    assert not _drop(bench, selection, Settings())
    assert [a.candidate for a in selection.accepted] == [RIPPLE, SPRING] and not selection.refused
