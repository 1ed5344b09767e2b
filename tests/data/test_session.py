"""A recording is a session: each trial has its place in it, and keeps it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from frictionpinn.data.prepare import thin
from frictionpinn.data.read import find_files, read_recording
from frictionpinn.data.recording import Recording, Trial
from frictionpinn.data.simulated import simulate_recording
from frictionpinn.errors import UserError
from frictionpinn.physics import SYSTEMS

T = np.arange(201) / 100  # 2 s


def session(*firsts: float, **options) -> Recording:
    """Trials of 2 s whose own clocks show these times at their first samples."""
    return Recording(tuple(Trial(str(k + 1), T + t, {"x": np.sin(T)}, **options) for k, t in enumerate(firsts)), {})


def starts(recording: Recording) -> list[float]:
    return [trial.start for trial in recording.trials]


def test_trials_whose_clocks_begin_anew_follow_one_another():
    recording = session(0.0, 0.0, 0.5)
    assert starts(recording) == pytest.approx([0.0, 2.0, 4.0])
    assert [trial.number for trial in recording.trials] == [1, 2, 3]
    third = recording.trials[2]
    assert third.t[0] + third.session.offset == pytest.approx(4.0)


def test_a_clock_that_runs_on_is_that_of_the_session_with_its_pauses_in_whatever_order():
    assert starts(session(1000.0, 1002.0, 1062.0)) == pytest.approx([0.0, 2.0, 62.0])
    assert starts(session(1060.0, 1000.0)) == pytest.approx([60.0, 0.0])


def test_one_trial_from_zero_has_the_time_of_its_session():
    assert session(0.0).trials[0].session.offset == 0.0
    assert Trial("alone", T + 3.0, {}).session.offset == 0.0


def test_a_start_that_is_given_is_kept_and_the_next_trial_follows():
    first, second = session(0.0, 0.0).trials
    recording = Recording((replace(first, start=30.0), replace(second, start=None)), {})
    assert starts(recording) == pytest.approx([30.0, 32.0])


def test_selected_trials_keep_their_place():
    chosen = session(0.0, 0.0, 0.0).select(["1", "3"])
    assert starts(chosen) == pytest.approx([0.0, 4.0])
    assert [trial.number for trial in chosen.trials] == [1, 3]


def test_windows_and_parts_and_thinned_trials_keep_their_place():
    recording = session(0.0, 0.0)
    windows = recording.cut(1.0, longest=1000, least=8)
    assert [w.start for w in windows] == pytest.approx([0.0, 1.0, 2.0, 3.0], abs=0.02)
    assert [w.session.offset for w in windows] == pytest.approx([0.0, 0.0, 2.0, 2.0])
    part = recording.trials[1].part(slice(150, None), "end")
    assert (part.name, part.number, len(part)) == ("end", 2, 51)
    assert part.start == pytest.approx(3.5) and part.end == pytest.approx(4.0)
    assert thin(recording.trials[1], 50.0, edge_s=0.1).start == pytest.approx(2.1)


def test_simulated_trials_follow_one_another_or_begin_where_they_say():
    swing = {"duration": 1.0, "force": "5*sin(6*t)"}
    trials = [swing, swing, {**swing, "start": 60.0}, swing]
    truth = {"mu_c": 1.0, "sigma_2": 1.0}
    recording = simulate_recording(SYSTEMS["drive"](), "coulomb_viscous", truth, trials, 100.0)
    assert starts(recording) == pytest.approx([0.0, 0.99, 60.0, 60.99])
    with pytest.raises(UserError, match=r"trials\[0\].start"):
        simulate_recording(SYSTEMS["drive"](), "coulomb_viscous", truth, [{**swing, "start": "late"}], 100.0)


# ---- files


def read(path, **columns) -> Recording:
    names = {"t": "t", "x": "x"} | columns
    units, wanted = {"default": "SI", "start": "min"}, {"x": "m"}
    return read_recording(path, columns=names, units=units, signal_units=wanted, trial_column=None)


def write(folder, name: str, t: np.ndarray, **more) -> None:
    pd.DataFrame({"t": t, "x": np.sin(t)} | more).to_csv(folder / name, index=False)


def test_files_with_absolute_times_tell_the_session(tmp_path):
    for k, first in enumerate((5e5, 5e5 + 90, 5e5 + 300)):
        write(tmp_path, f"lap_{k}.csv", T + first)
    assert starts(read(tmp_path)) == pytest.approx([0.0, 90.0, 300.0])


def test_numbered_files_come_in_the_order_of_their_numbers(tmp_path):
    for k in (10, 9, 100):
        write(tmp_path, f"lap_{k}.csv", T)
    assert [path.stem for path in find_files(tmp_path)] == ["lap_9", "lap_10", "lap_100"]
    assert [path.stem for path in find_files(str(tmp_path / "lap_*.csv"))] == ["lap_9", "lap_10", "lap_100"]


def test_a_column_tells_when_trials_began_counted_from_the_first(tmp_path):
    write(tmp_path, "a.csv", T, began=720.0 + T / 60)
    write(tmp_path, "b.csv", T, began=700.0)
    recording = read(tmp_path, start="began")
    assert starts(recording) == pytest.approx([1200.0, 0.0])
    assert set(recording.units) == {"x"} and set(recording.trials[0].signals) == {"x"}


def test_trials_may_be_sessions_of_their_own(tmp_path):
    write(tmp_path, "a.csv", T)
    write(tmp_path, "b.csv", T)
    assert starts(read(tmp_path, start=0)) == [0.0, 0.0]


def test_a_trial_without_a_start_is_named(tmp_path):
    write(tmp_path, "a.csv", T, began=np.where(T > 0, 1.0, np.nan))
    with pytest.raises(UserError, match=r"missing value: .*trial 'a'.*start") as caught:
        read(tmp_path, start="began")
    assert "\n" not in str(caught.value)


@given(st.integers(1, 60), st.floats(0.02, 0.98), st.integers(2, 7))
@settings(max_examples=50, deadline=None)
def test_a_share_of_a_recording_is_spread_over_it_and_meets_no_cycle_of_its_trials_in_step(count, share, cycle):
    recording = session(*[0.0] * count)
    part = recording.spread(share, recording.trials)
    numbers = [trial.number for trial in part.trials]
    assert len(numbers) == max(round(share * count), 1) and numbers == sorted(set(numbers))
    assert part.names == recording.spread(share, recording.trials).names
    assert max(np.diff([0, *numbers, count + 1])) <= 2 * np.ceil(count / len(numbers))
    if len(numbers) >= 12 and count >= cycle * len(numbers):
        assert len({number % cycle for number in numbers}) > 1


def test_windows_of_a_long_trial_keep_their_place_in_the_session():
    long = Recording((Trial("run", np.arange(20_000) / 1000, {"x": np.zeros(20_000)}),), {"x": "m"})
    part = long.spread(0.3, long.cut(None, 4000, 9))
    assert len(part) == 6000 and part.units == long.units
    for trial in part.trials:
        assert trial.start == pytest.approx(trial.t[0]) and trial.name.startswith("run[")
