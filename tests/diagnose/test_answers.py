"""What a diagnosis answers to several effects, to such as act the same way, and without trials to hold out."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from test_matrix import BEDS, told

from frictionpinn.diagnose import contenders
from frictionpinn.diagnose import select as selecting
from frictionpinn.diagnose.diagnosis import Diagnosis, diagnose
from frictionpinn.diagnose.select import Accepted, Selection, Settings
from frictionpinn.numerics import parallel

PUSHED = {"constant_force": 0.25}
HEAVY = {"inertia": 6.0, "position_gradient": 4.0}


def diagnosed(bed: str, values, acting, held_out: int = 1, **options) -> Diagnosis:
    made = BEDS[bed].record(values, acting, 0)
    count = len(made.names) - held_out
    return diagnose(BEDS[bed].mechanism, made.select(made.names[:count]), made.select(made.names[count:]), **options)


def names(d: Diagnosis) -> list[str]:
    return [a.candidate.effect for a in d.accepted]


@pytest.fixture(scope="module")
def heavy() -> Diagnosis:
    tried = ["inertia", "position_friction", "drag", "asymmetric_viscous"]
    return diagnosed("damper", HEAVY, ("inertia", "position_friction"), effects=tried)


def test_two_effects_that_act_together_are_both_found_and_measured(heavy):
    assert heavy.verdict == "effect found" and set(names(heavy)) == {"inertia", "position_friction"}, told(heavy)
    for name, value in HEAVY.items():
        low, high = heavy.ci95[name]
        assert low - 0.25 * (high - low) <= value <= high + 0.25 * (high - low)
    assert sum(s["value"] for s in heavy.shares) + heavy.left["value"] == pytest.approx(1.0)


def test_no_more_effects_are_added_than_asked_for():
    d = diagnosed(
        "damper", HEAVY, ("inertia", "position_friction"), effects=["inertia", "position_friction"],
        settings=Settings(most=1),
    )  # fmt: skip
    assert len(d.accepted) == 1 and d.verdict == "partly explained"


def test_effects_that_act_the_same_way_are_named_together():
    tried = ["payload", "gain_error", "inertia", "drag"]
    d = diagnosed("drive", {"gain_error_force": 0.08}, ("gain_error",), effects=tried)
    (found,) = d.accepted
    strengths = {n: d.values[n] for n in found.candidate.strengths}
    strengths |= {name: value for _, alike in found.alike for name, value in alike.items()}
    assert set(strengths) == {"payload_M", "gain_error_force", "inertia"}, told(d)
    assert strengths["gain_error_force"] == pytest.approx(0.08, rel=0.2)
    assert strengths["payload_M"] == pytest.approx(1 / 1.08 - 1, rel=0.2)


def test_a_steady_push_and_friction_that_differs_by_direction_are_alike_under_a_constant_load():
    tried = ["constant_force", "asymmetry", "drag"]
    d = diagnosed("damper", {"asymmetry": 0.07}, ("asymmetry",), effects=tried)
    (found,) = d.accepted
    assert {found.candidate.effect, *(c.effect for c, _ in found.alike)} == {"constant_force", "asymmetry"}, told(d)


def test_what_would_be_part_of_an_effect_that_was_added_is_told_of_beside_it():
    acting = {"spring_stiffness": 400.0, "constant_force": 8.0}  # together a spring that is relaxed elsewhere
    tried = ["spring_force", "constant_force", "drag"]
    d = diagnosed("damper", acting, ("spring_force", "constant_force"), effects=tried)
    (low, high), relaxed = d.ci95["spring_rest"], -8.0 / 400.0
    assert names(d) == ["spring_force"] and low <= relaxed <= high, told(d)
    assert [c.name for c in d.inseparable] == ["constant_force"] and d.to_dict()["inseparable"] == ["constant_force"]
    assert "Beside spring_force, constant_force would not show" in d.tables()[0].title


def test_without_held_out_trials_the_fitted_ones_judge():
    d = diagnosed("drive", PUSHED, ("constant_force",), held_out=0, effects=["constant_force", "drag"])
    assert d.verdict == "effect found" and names(d) == ["constant_force"] and d.scored == "fitted trials"
    assert "gain_held_out" not in d.accepted[0].evidence
    assert d.gain_within_errors == 0.0


def test_an_effect_that_held_out_trials_contradict_is_not_added():
    bed = BEDS["drive"]
    pushed, free = bed.record(PUSHED, ("constant_force",), 0), bed.record({}, (), 0)
    d = diagnose(bed.mechanism, pushed.select(pushed.names[:-1]), free.select(free.names[-1:]),
                 effects=["constant_force"])  # fmt: skip
    assert not d.accepted
    assert [r.why.partition(" (")[0] for r in d.refused] == ["held-out trials do not improve"]


def test_an_effect_whose_interval_holds_zero_is_not_added(monkeypatch):
    usual = selecting.intervals

    def wide(bench, fit, scanned):
        values, ci95 = usual(bench, fit, scanned)
        return values, ci95 | {name: (-1.0, 1.0) for name in ci95 if name == "constant_force"}

    monkeypatch.setattr(selecting, "intervals", wide)
    d = diagnosed("drive", PUSHED, ("constant_force",), effects=["constant_force", "drag"])
    assert "constant_force" not in names(d)
    (why,) = [r.why for r in d.refused if r.candidate.effect == "constant_force"]
    assert why == "its 95 % interval holds zero (-1 to 1)"


def test_effects_with_which_no_held_out_trial_can_be_simulated_are_refused_one_and_all(monkeypatch):
    usual = contenders.surprise
    monkeypatch.setattr(
        contenders, "surprise", lambda bench, fit: usual(bench, fit) if fit.names == bench.declared else None
    )
    d = diagnosed("drive", {"gain_error_force": 0.08}, ("gain_error",), effects=["gain_error", "inertia", "drag"])
    assert d.verdict == "unexplained" and not d.accepted
    refused = {r.candidate.effect: r.why for r in d.refused}
    assert refused["gain_error"] == refused["inertia"] == "held-out trials cannot be simulated with it"


def test_an_effect_that_is_not_needed_beside_another_is_taken_out():
    d = diagnosed("drive", PUSHED, ("constant_force",), effects=["constant_force", "drag"])
    bench, fit = d.bench, d.selection.fit
    (found,) = d.accepted
    drag = next(t for t in d.selection.first.tested if t.candidate.effect == "drag")
    both = bench.refit(fit, (*fit.names, "drag"), fit.values | {"drag": 0.5})
    selection = Selection(bench.base, both, d.selection.first, d.selection.last)
    selection.accepted = [Accepted(drag.candidate, drag, {}, both), found]
    selecting._drop(bench, [], selection, bench.base, Settings())
    assert [a.candidate.effect for a in selection.accepted] == ["constant_force"]
    assert selection.fit.values["drag"] == 0.0 and "drag" not in selection.fit.names


def test_an_effect_that_stood_for_another_gives_way_to_it_once_what_was_missing_beside_both_is_there():
    d = diagnosed("drive", PUSHED, ("constant_force",), effects=["constant_force", "spring_force", "drag"])
    bench, first = d.bench, {t.candidate.effect: t for t in d.selection.first.tested}
    spring, drag = first["spring_force"], first["drag"]
    names = (*bench.base.names, *spring.candidate.strengths, *spring.candidate.hidden, "drag")
    both = bench.refit(bench.base, names, bench.base.values | spring.step | spring.shape | {"drag": 0.5})
    selection = Selection(bench.base, both, d.selection.first, d.selection.last)
    constant, later = (Accepted(t.candidate, t, {}, both) for t in (first["constant_force"], drag))
    selection.accepted = [Accepted(spring.candidate, spring, {}, both, others=(constant,)), later]
    assert selecting._judged_anew(bench, [], selection, Settings())
    assert [a.candidate.effect for a in selection.accepted] == ["constant_force", "drag"]
    assert [a.candidate.effect for a in selection.accepted[0].others] == ["spring_force"]
    assert selection.fit.values["constant_force"] == pytest.approx(d.values["constant_force"], rel=0.05)
    assert "spring_stiffness" not in selection.fit.names


def test_one_thread_and_several_find_the_same(heavy, monkeypatch):
    found = []
    for workers in (1, 3):
        monkeypatch.setattr(parallel, "WORKERS", workers)
        with ThreadPoolExecutor(max(1, workers - 1)) as pool:
            monkeypatch.setattr(parallel, "_POOL", pool)
            tried = ["inertia", "position_friction", "drag", "asymmetric_viscous"]
            found.append(diagnosed("damper", HEAVY, ("inertia", "position_friction"), effects=tried))
    one, several = found
    assert names(one) == names(several) == names(heavy) and one.verdict == several.verdict
    assert one.values == pytest.approx(several.values, rel=1e-6)
    assert one.selection.fit.state.cost == pytest.approx(several.selection.fit.state.cost, rel=1e-6)
    for name in one.ci95:
        assert np.allclose(one.ci95[name], several.ci95[name], rtol=1e-6)
