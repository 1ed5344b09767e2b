"""Candidates ranked and started over short windows, where what is missing does not add up."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from contending import option

from frictionpinn.data.noise import GaussianNoise
from frictionpinn.data.simulated import simulate_recording
from frictionpinn.diagnose import windows
from frictionpinn.diagnose.bench import Bench
from frictionpinn.diagnose.candidates import candidates, places, ranges, scales
from frictionpinn.diagnose.diagnosis import _bench
from frictionpinn.diagnose.rivals import mates, twins
from frictionpinn.diagnose.tries import from_windows
from frictionpinn.diagnose.windows import Asked, Short, over_windows, regular
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.mechanism import Mechanism

TRUTH = {"sigma_0": 2e4, "sigma_1": 150.0, "sigma_2": 2.0, "mu_c": 3.0, "mu_s": 4.0, "v_s": 5e-3}
TRIALS = [{"duration": 2.0, "force": "5*sin(2*pi*t)"}, {"duration": 2.0, "force": "6*sin(3*pi*t)"}]
SYSTEM = SYSTEMS["drive"](M=1.0)
STIFFNESS = 3.0  # N/m


@pytest.fixture(scope="module")
def recording():
    truth = TRUTH | {"spring_stiffness": STIFFNESS, "spring_rest": 0.0}
    return GaussianNoise(0.02)(simulate_recording(SYSTEM, "lugre", truth, TRIALS, 200.0, ("spring_force",)), 0)


def fitted_with(recording, *names: str) -> tuple[Bench, Asked]:
    """The declared model fitted, and what is asked where only these effects are known."""
    declared = Mechanism(SYSTEM, LAWS["lugre"]())
    bench, kinds, probes = _bench(declared, recording, recording.select(()), names, None, {})
    runs = bench.simulate(bench.base())
    covered = ranges(SYSTEM, probes, runs)
    where = {k: v for r in probes for k, v in places(r, covered[r.variable]).items()}
    return bench, Asked(candidates(kinds, SYSTEM, declared.law, scales(SYSTEM, runs)), probes, where, 4)


@pytest.fixture(scope="module")
def made(recording) -> tuple[Bench, Asked]:
    return fitted_with(recording, "constant_force", "spring_force", "drag", "asymmetric_viscous")


def test_a_missing_spring_leads_over_windows_and_whole_trials_fitted_from_there_leave_noise(made):
    bench, asked = made
    before = bench.base()
    assert not before.explains
    ranked = over_windows(bench, before, [], (), asked)
    (first, *_), *_ = ranked.classes
    assert first.candidate.name == "spring_force"
    assert first.short["spring_stiffness"] == pytest.approx(STIFFNESS, rel=0.1)
    found = from_windows(bench, before, first)
    assert found.explains
    assert found.values["spring_stiffness"] == pytest.approx(STIFFNESS, rel=0.1)
    assert ranked.others == []
    assert not ranked.nameless()


def test_where_no_known_effect_is_the_one_and_position_explains_it_no_name_fits(recording):
    bench, asked = fitted_with(recording, "constant_force", "drag")
    assert over_windows(bench, bench.base(), [], (), asked).nameless()
    elsewhere = tuple(r for r in asked.variables if r.variable == "time")
    assert not over_windows(bench, bench.base(), [], (), replace(asked, variables=elsewhere)).nameless()


def test_the_others_are_those_that_were_given_in_the_order_of_their_tests_over_windows(made):
    bench, asked = made
    given = [SimpleNamespace(candidate=o) for o in asked.options if o.effect in ("drag", "constant_force")]
    others = over_windows(bench, bench.base(), [], given, asked).others
    assert {t.candidate.effect for t in others} == {"drag", "constant_force"}
    assert [t.statistic for t in others] == sorted((t.statistic for t in others), reverse=True)


def test_a_contender_of_the_whole_trials_is_fitted_over_windows_as_well(made, monkeypatch):
    bench, asked = made
    seen = []
    inner = Short.with_
    monkeypatch.setattr(Short, "with_", lambda self, t, *rest: seen.append(t.candidate.effect) or inner(self, t, *rest))
    weak = next(o for o in asked.options if o.effect == "drag")
    over_windows(bench, bench.base(), [[SimpleNamespace(candidate=weak)]], (), asked)
    assert {"drag", "spring_force"} <= set(seen)


def test_classes_stay_as_they_are_where_the_windows_cannot_be_simulated(monkeypatch):
    monkeypatch.setattr(windows.Short, "of", lambda bench, fit: None)
    classes, others = [[option("drag")]], [option("payload")]
    ranked = over_windows(None, None, classes, others, Asked(()))
    assert (ranked.classes, ranked.others) == (classes, others)
    assert not ranked.nameless()


def told(*each: float, wild: int | None = None):
    """A fit of as many windows, each with so much information per sample on a parameter; all a thousandfold in one."""
    shares = [np.array([x, 0.01 * k * x]) * (1e4 if k == wild else 1.0) for k, x in enumerate(each)]
    pieces = tuple(SimpleNamespace(gg=np.diag(share * 50)) for share in shares)
    return SimpleNamespace(state=SimpleNamespace(pieces=pieces), models=[SimpleNamespace(t=np.zeros(50))] * len(each))


@pytest.mark.parametrize("wild", [0, 7, 19])
def test_a_window_whose_derivatives_are_a_thousand_times_the_others_is_left_out(wild):
    each = np.random.default_rng(0).uniform(0.5, 2.0, 20)
    assert regular(told(*each, wild=wild)) == [k for k in range(20) if k != wild]


@pytest.mark.parametrize("count", [1, 2, 20])
def test_windows_that_tell_about_as_much_as_one_another_all_count(count):
    each = np.random.default_rng(1).uniform(0.5, 2.0, count)
    assert regular(told(*each)) == list(range(count))


def test_traces_over_windows_and_over_whole_trials_are_not_compared():
    one, other = option("drag"), option("payload")
    other.trace = np.concatenate([one.trace, [0.0]])
    assert twins(one, option("payload"))
    assert not twins(one, other)
    assert not mates(one, other)
