"""Logs as loggers write them: repeated and late rows, gaps, angles that wrap."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from frictionpinn.data.read import read_recording
from frictionpinn.errors import UserError

UNITS = {"t": "s", "theta": "rad", "omega": "rad/s"}


@pytest.fixture
def read(tmp_path):
    def run(table: pd.DataFrame, **options):
        table.to_csv(tmp_path / "run.csv", index=False)
        columns = {name: name for name in table.columns}
        return read_recording(
            tmp_path / "run.csv", columns=columns, units={"default": "SI"}, signal_units=UNITS, **options
        )

    return run


def turning(rate: float = 100.0, seconds: float = 6.0) -> pd.DataFrame:
    t = np.arange(int(rate * seconds)) / rate
    return pd.DataFrame({"t": t, "theta": 8 * np.sin(t), "omega": 8 * np.cos(t)})


def test_rows_that_repeat_or_come_late_are_put_right_and_said(read):
    table = turning()
    order = np.arange(len(table))
    order[[100, 101]] = 101, 100
    spoilt = pd.concat([table.iloc[order], table.iloc[[-1]]])
    (trial,) = read(spoilt).trials
    np.testing.assert_array_equal(trial.t, table.t)
    np.testing.assert_allclose(trial.signals["theta"], table.theta)
    assert "1 rows came late" in trial.notes[0] and "1 rows repeat a time" in trial.notes[1]


def test_time_that_is_too_coarse_is_refused_with_what_to_do(read):
    with pytest.raises(UserError, match=r"time repeats at row 2: .* is 90 % .*; allowed: up to 10 %; .* more digits"):
        read(turning().assign(t=lambda d: np.floor(d.t * 10) / 10))


@pytest.mark.parametrize(("full", "low", "unit"), [(2 * np.pi, -np.pi, "rad"), (360.0, 0.0, "deg")])
def test_an_angle_that_wraps_is_unwrapped(tmp_path, full, low, unit):
    table = turning()
    wrapped = np.rad2deg(table.theta) if unit == "deg" else table.theta
    table.assign(theta=(wrapped - low) % full + low).to_csv(tmp_path / "run.csv", index=False)
    (trial,) = read_recording(
        tmp_path / "run.csv", columns={n: n for n in UNITS}, units={"theta": unit, "default": "SI"}, signal_units=UNITS
    ).trials
    moved = trial.signals["theta"] - table.theta
    np.testing.assert_allclose(moved, moved[0], atol=1e-9)
    assert "unwrapped" in trial.notes[0]


@pytest.mark.parametrize("rate", [100.0, 1000.0])
def test_a_gap_that_no_line_bridges_ends_a_trial_and_a_short_one_does_not(read, rate):
    table = turning(rate)
    long, short = (table.t > 2) & (table.t < 3.5), (table.t > 4) & (table.t < 4.1)
    parts = read(table[~long & ~short]).trials
    assert [part.name for part in parts] == ["run[0]", "run[1]"]
    assert parts[0].t[-1] == pytest.approx(2.0) and parts[1].t[0] == pytest.approx(3.5)
    assert parts[1].start == pytest.approx(3.5), "the clock of the session ran on"
    assert "1 gaps of up to 1.5" in parts[0].notes[0]


def test_uneven_steps_are_taken_as_they_are_and_said(read):
    rng = np.random.default_rng(0)
    t = np.cumsum(rng.uniform(0.008, 0.016, 500))
    (trial,) = read(pd.DataFrame({"t": t, "theta": np.sin(t), "omega": np.cos(t)})).trials
    np.testing.assert_allclose(trial.t, t)
    assert "sampled unequally, 0.008" in trial.notes[0]
