"""Derivatives that overflow in a simulation: what they concern could not be tested, and all else is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from test_diagnosis import diagnosed
from test_possible import drive

from frictionpinn.diagnose import scan as scanning
from frictionpinn.numerics.score import Normal, Score

__all__ = ["drive"]
NAMES = "asymmetry", "drag", "inertia"


def scanned(drive):
    bench, table = drive
    return {t.candidate.name: t for t in scanning.scan(bench, bench.base, [table[name] for name in NAMES]).tested}


def spoilt(work, value, column):
    """The rows that ``work`` makes, with the last tenth of a parameter's column at a value."""

    def made(bench, fit, names, *rest, **options):
        rows = work(bench, fit, names, *rest, **options)
        for row in rows:
            row.change[:, -row.change.shape[1] // 10 :, list(names).index(column)] = value
        return rows

    return made


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e200, 1e30])
def test_a_candidate_whose_derivatives_overflow_could_not_be_tested_and_the_others_are(drive, monkeypatch, value):
    usual = scanned(drive)
    monkeypatch.setattr(scanning, "linearise", spoilt(scanning.linearise, value, "drag"))
    found = scanned(drive)
    assert found["drag"].untested and found["drag"].log_p == 0.0 and found["drag"].step["drag"] > 0
    assert not any(usual[name].untested for name in NAMES)
    for name in ("asymmetry", "inertia"):
        assert not found[name].untested
        assert found[name].statistic == pytest.approx(usual[name].statistic, rel=0.05, abs=0.05)


def test_a_simulation_that_fails_at_some_shape_leaves_the_others(drive, monkeypatch):
    bench, table = drive
    ripple = table["ripple (force)"]

    def tested():
        return scanning.scan(bench, bench.base, [ripple]).tested[0]

    usual, respond = tested(), scanning.Tangent.respond

    def fails(keep):
        def work(*a, **options):
            lost = np.repeat([shape not in keep for shape in ripple.grid], len(ripple.strengths))
            return {key: np.where(lost, np.inf, values) for key, values in respond(*a, **options).items()}

        return work

    monkeypatch.setattr(scanning.Tangent, "respond", fails([usual.shape]))
    found = tested()
    assert not found.untested and found.shape == usual.shape
    assert found.statistic == pytest.approx(usual.statistic, rel=1e-6)
    monkeypatch.setattr(scanning.Tangent, "respond", fails([]))
    assert tested().untested


def test_numbers_that_are_too_far_apart_are_not_tested(drive, monkeypatch):
    monkeypatch.setattr(Normal, "test", lambda normal, lengths: Score(np.zeros(len(lengths)), overflow=True))
    assert all(t.untested for t in scanned(drive).values())


def test_what_could_not_be_tested_is_refitted_where_it_has_a_single_parameter_and_may_win(monkeypatch):
    monkeypatch.setattr(Normal, "test", lambda normal, lengths: Score(np.zeros(len(lengths)), overflow=True))
    d = diagnosed(["constant_force"], {"constant_force": 0.3}, effects=["constant_force", "drag"])
    assert d.verdict == "effect found"
    assert [a.candidate.effect for a in d.accepted] == ["constant_force"]
    assert np.isnan(d.accepted[0].evidence["log10_p"])
    low, high = d.ci95["constant_force"]
    assert low <= 0.3 <= high


def test_with_hardly_more_rows_than_candidates_the_noise_is_that_of_the_fit(drive):
    # At a coarse resolution a short recording has fewer rows than could explain them: no noise is left to see.
    bench, _ = drive
    names = (*bench.base.names, *NAMES)
    rows = scanning.linearise(bench, bench.base, names)
    few = len(names) // sum(len(row.signals) for row in rows) + 1
    short = [
        replace(row, r=row.r[:, :few], change=row.change[:, :few], local=row.local[:, :few], weight=row.weight[:, :few])
        for row in rows
    ]
    assert scanning._noise(short).level == {}
    assert scanning._noise(rows).level != {}
