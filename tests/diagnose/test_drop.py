"""Effects that are taken out again because the fit is as good without them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace

import pytest

from frictionpinn.diagnose import drop as dropping
from frictionpinn.diagnose import select as selecting
from frictionpinn.diagnose.candidates import Candidate
from frictionpinn.diagnose.contest import Accepted, Settings
from frictionpinn.diagnose.drop import drop
from frictionpinn.diagnose.select import Selection, _beside_vanished, _deepen

SPRING = Candidate("spring_force", "spring_force", ("spring_stiffness",), ("spring_rest",), ({"spring_rest": 0.0},))
RIPPLE = Candidate("ripple", "ripple", ("ripple_sin",), ("ripple_wavelength",), ({"ripple_wavelength": 1.0},))
VALUES = {"mu_c": 0.3, "spring_stiffness": 1.1, "spring_rest": 0.4, "ripple_sin": 0.3, "ripple_wavelength": 0.8}


def fit(names, cost, **values):
    return SimpleNamespace(names=tuple(names), values=VALUES | values, state=SimpleNamespace(cost=cost))


def accepted(candidate: Candidate) -> Accepted:
    return Accepted(candidate, SimpleNamespace(freedom=1), {"gain_fitted": 300.0})


def bare(found, gone, held):
    """The fit without them, as the bench's quadratic model has it."""
    return fit(found.names, found.state.cost, **(found.values | dict.fromkeys(gone, 0.0)))


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

    monkeypatch.setattr(dropping, "scan", scan)
    monkeypatch.setattr(dropping, "add", add)
    assert drop(SimpleNamespace(refit=refit, without=bare), selection, Settings())
    assert [a.candidate for a in selection.accepted] == [SPRING]
    assert selection.fit.values["spring_stiffness"] == -1.4
    assert set(selection.fit.names) == {"mu_c", "spring_stiffness", "spring_rest"}
    assert seen[0] == (("mu_c",), 0.0, 0.0)  # both neutral: its place is not where the ripple pushed it
    assert "not needed" in selection.refused[0].why and selection.refused[0].candidate is RIPPLE


@pytest.mark.parametrize(("reached", "tries"), [(200.0, 4), (400.0, 2)])
def test_a_fit_without_an_effect_goes_on_only_where_it_comes_near(reached, tries):
    made = []

    def refit(before, names, values, **options):
        made.append(options)
        return fit(names, reached)

    bench, alone = SimpleNamespace(refit=refit, without=bare), Selection(None, fit(VALUES, 100.0), None, None)
    alone.accepted = [accepted(SPRING)]  # it gained 300: what loses 100 after a short try may come back, 300 not
    assert not drop(bench, alone, Settings())
    assert len(made) == tries and sum("iterations" in options for options in made) == 2


def test_effects_stay_that_nothing_replaces(selection, monkeypatch):
    monkeypatch.setattr(dropping, "scan", lambda *a: SimpleNamespace(tested=[None]))
    monkeypatch.setattr(dropping, "add", lambda *a, **k: None)
    bench = SimpleNamespace(refit=lambda before, names, values, **options: fit(names, 500.0, **values), without=bare)
    assert not drop(bench, selection, Settings())
    assert [a.candidate for a in selection.accepted] == [RIPPLE, SPRING] and not selection.refused


def test_an_effect_goes_that_the_others_make_up_for_as_the_quadratic_model_says(selection, monkeypatch):
    def without(found, gone, held):
        return fit(found.names, 100.0, **(found.values | dict.fromkeys(gone, 0.0) | {"mu_c": 0.31}))

    def refit(before, names, values, **options):
        return fit(names, 101.0 if values["mu_c"] == 0.31 and "spring_rest" in names else 500.0, **values)

    monkeypatch.setattr(dropping, "scan", lambda *a: pytest.fail("looked for another place"))
    monkeypatch.setattr(
        dropping, "_without", lambda *a, own=dropping._without: None if a[2].candidate is SPRING else own(*a)
    )
    assert drop(SimpleNamespace(refit=refit, without=without), selection, Settings())
    assert [a.candidate for a in selection.accepted] == [SPRING] and selection.fit.values["mu_c"] == 0.31


def test_a_rival_is_compared_at_the_noise_levels_of_the_fit_and_wins_where_its_search_ends_lower(
    selection, monkeypatch
):
    rival, at_those = SimpleNamespace(names=("mu_c",), values=VALUES, starts=()), fit(("mu_c",), 150.0)
    selection.fit.sigmas, selection.fit.count, selection.fit.explains = {"v": 0.1}, 1000, False
    selection.fit.starts = ()
    selection.accepted = [replace(accepted(SPRING), close=((SimpleNamespace(candidate=RIPPLE), rival),))]
    better = SimpleNamespace(**vars(fit(("mu_c",), 60.0)), count=1000, explains=True)
    levels = []
    bench = SimpleNamespace(
        refit=lambda own, names, values, sigmas: levels.append(sigmas) or at_those,
        search=lambda own, starts: better if own is at_those else selection.fit,
    )
    near = [(SimpleNamespace(candidate=SPRING), SimpleNamespace(values=VALUES))]
    monkeypatch.setattr(selecting, "indistinct", lambda bench, before, winner, level, settings: near)
    assert _deepen(bench, selection, Settings()) and selection.fit is better and levels == [{"v": 0.1}]
    assert selection.accepted[-1].candidate is RIPPLE
    assert [c for c, _ in selection.accepted[-1].alike] == [SPRING]  # what it took the place of is not forgotten


def test_nothing_is_looked_for_beside_a_friction_that_vanished_once_an_effect_explains_the_residual(selection):
    selection.fit.explains = True
    assert _beside_vanished(None, selection, [RIPPLE], Settings()) == []


def test_beside_a_friction_brought_back_what_promises_less_than_half_of_what_that_costs_is_not_followed(
    selection, monkeypatch
):
    selection.fit.explains, selection.accepted = False, []
    back = fit(("mu_c",), 160.0)  # 60 more than without: a candidate has to promise 30

    @dataclass
    class Shown:
        candidate: Candidate
        statistic: float
        beside: dict | None = None
        log_p: float = -10.0

    monkeypatch.setattr(selecting, "lifted", lambda *a: {"mu_c": 0.2})
    monkeypatch.setattr(selecting, "_held", lambda *a: back)
    monkeypatch.setattr(
        selecting, "scan", lambda *a: SimpleNamespace(tested=[Shown(RIPPLE, 2 * 31.0), Shown(SPRING, 2 * 29.0)])
    )
    bench = SimpleNamespace(problem=None, sizes=None)
    (shown,) = _beside_vanished(bench, selection, [RIPPLE, SPRING], Settings())
    assert shown.candidate is RIPPLE and shown.beside == back.values
