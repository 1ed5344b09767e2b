"""Reading of recordings: units, trials, times and gains."""

import numpy as np
import pandas as pd
import pytest
from written import COLUMNS, read, refused, table, write_csv


def test_a_trial_column_splits_a_file_and_whole_numbers_lose_their_point(tmp_path):
    data = table()
    both = {key: np.tile(values, 2) for key, values in data.items()} | {"run": np.repeat([1.0, 2.0], 20)}
    recording = read(write_csv(tmp_path / "a.csv", both), trial_column="run")
    assert recording.names == ["1", "2"]
    np.testing.assert_array_equal(recording.trials[1].t, data["t"])


def test_folders_patterns_and_lists_give_one_trial_a_file(tmp_path):
    for name in ("b", "a"):
        write_csv(tmp_path / f"{name}.csv", table())
    (tmp_path / "notes.md").write_text("no recording")
    for paths in (tmp_path, str(tmp_path / "*.csv"), [tmp_path / "a.csv", tmp_path / "b.csv"]):
        assert read(paths).names == ["a", "b"]


def test_a_gain_is_applied_before_the_unit(tmp_path):
    data = table()
    path = write_csv(tmp_path / "a.csv", data)
    recording = read(path, {"t": "t", "force": "force"}, {"t": "ms", "force": "kN"}, gains={"force": 35.0})
    np.testing.assert_allclose(recording.trials[0].signals["force"], 35e3 * data["force"])
    np.testing.assert_allclose(recording.trials[0].t, 1e-3 * data["t"])


def test_a_number_in_place_of_a_column_is_a_constant_signal(tmp_path):
    trial = read(write_csv(tmp_path / "a.csv", table()), COLUMNS | {"force": 12}).trials[0]
    assert trial.signals["force"].tolist() == [12.0] * 20


def test_only_dimensionless_signals_go_without_a_unit(tmp_path):
    path = write_csv(tmp_path / "a.csv", table())
    read(path, {"t": "t", "mu": "x"}, {"t": "s"})
    refused(r"missing unit: units\.x; allowed: .*convertible to m; add 'units\.x: m'", path, COLUMNS, {"t": "s"})


@pytest.mark.parametrize("name", ["a.csv", "a.parquet", "text.parquet", "zone.parquet", "a.npz"])
def test_dates_are_seconds_from_the_first_whatever_unit_the_others_have(tmp_path, name):
    data, first = table(), np.datetime64("2026-05-01T12:00:00.25", "ns")
    dates = first + np.round(1e9 * data["t"]).astype("timedelta64[ns]")
    frame = pd.DataFrame(data | {"t": dates})
    if name == "zone.parquet":
        frame["t"] = frame.t.dt.tz_localize("Europe/Berlin")
    if name == "text.parquet":
        frame["t"] = frame.t.map(pd.Timestamp.isoformat)
    path = tmp_path / name
    np.savez(path, **data | {"t": dates}) if name == "a.npz" else (
        frame.to_csv(path, index=False) if name == "a.csv" else frame.to_parquet(path)
    )
    trial = read(path, COLUMNS, {"x": "m"}).trials[0]
    np.testing.assert_allclose(trial.t, data["t"], rtol=0, atol=1e-12)


def test_durations_are_seconds(tmp_path):
    frame = pd.DataFrame(table())
    frame.assign(t=pd.to_timedelta(frame.t, unit="s")).to_parquet(tmp_path / "a.parquet")
    np.testing.assert_allclose(read(tmp_path / "a.parquet").trials[0].t, frame.t, rtol=0, atol=1e-9)


def test_dates_tell_the_pause_between_files(tmp_path):
    for name, hour in (("a", 12), ("b", 13)):
        t = pd.Timestamp(f"2026-05-01 {hour}:00") + pd.to_timedelta(table()["t"], unit="s")
        write_csv(tmp_path / f"{name}.csv", table() | {"t": t})
    assert [trial.start for trial in read(tmp_path).trials] == [0.0, 3600.0]


@pytest.mark.parametrize(
    ("written", "names"),
    [
        (["1.0", "2.0"], ["1", "2"]),
        (["1.000000e+00", "2.000000e+01"], ["1", "20"]),
        (["001", "010"], ["001", "010"]),
        (["1_2", "1_3"], ["1_2", "1_3"]),
        (["1.50", "run 2"], ["1.50", "run 2"]),
        (["NA", "nan"], ["NA", "nan"]),
    ],
)
def test_names_of_trials_are_those_of_the_file_and_whole_numbers_however_written(tmp_path, written, names):
    data = table()
    rows = [f"{name},{t},{x},{f}" for name in written for t, x, f in zip(*data.values(), strict=True)]
    path = tmp_path / "a.csv"
    path.write_text("\n".join(["lap,t,x,force", *rows]))
    assert read(path, trial_column="lap").names == names


def test_a_constant_signal_may_be_allowed(tmp_path):
    path = write_csv(tmp_path / "a.csv", table() | {"n": np.full(20, 5.0)})
    columns = COLUMNS | {"force": "n"}
    refused("never changes", path, columns)
    assert read(path, columns, allow_constant={"force"}).names == ["a"]
    assert read(path, columns, required=["x"]).names == ["a"]
