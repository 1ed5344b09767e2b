"""Reading of recordings: formats, units, trials and every mistake that a file can hold."""

import contextlib
import gzip
import hashlib

import h5py
import numpy as np
import pandas as pd
import pytest
import scipy.io
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from frictionpinn.data.read import read_recording
from frictionpinn.data.recording import Recording
from frictionpinn.data.tables import columns_of
from frictionpinn.errors import UserError

SIGNALS = {"x": "m", "v": "m/s", "force": "N", "mu": ""}
COLUMNS = {"t": "t", "x": "x"}
SI = {"default": "SI"}


def read(path, columns=COLUMNS, units=SI, **options):
    return read_recording(path, columns=columns, units=units, signal_units=SIGNALS, **options)


def table(n=20):
    t = np.arange(n) * 0.01
    return {"t": t, "x": np.sin(40 * t), "force": np.cos(40 * t)}


def write_csv(path, data, sep=","):
    pd.DataFrame(data).to_csv(path, sep=sep, index=False)
    return path


def refused(pattern, path, *args, **kwargs):
    with pytest.raises(UserError, match=pattern) as caught:
        read(path, *args, **kwargs)
    assert "\n" not in str(caught.value)


# ---- formats


def write_hdf5_mat(path, data):
    with h5py.File(path, "w") as file:
        for name, values in data.items():
            file[name] = values.reshape(1, -1)


WRITERS = {
    "a.csv": write_csv,
    "a.csv.gz": write_csv,
    "a.txt": lambda path, data: write_csv(path, data, "\t"),
    "a.parquet": lambda path, data: pd.DataFrame(data).to_parquet(path),
    "a.mat": lambda path, data: scipy.io.savemat(path, data),
    "a73.mat": write_hdf5_mat,
    "a.npz": lambda path, data: np.savez(path, **data),
}


@pytest.mark.parametrize("name", WRITERS)
def test_every_format_gives_the_written_numbers(tmp_path, name):
    data, path = table(), tmp_path / name
    WRITERS[name](path, data)
    recording = read(path, {"t": "t", "x": "x", "force": "force"}, {"t": "s", "x": "mm", "force": "N"})
    (trial,) = recording.trials
    assert trial.name == name.split(".")[0]
    np.testing.assert_array_equal(trial.t, data["t"])
    np.testing.assert_allclose(trial.signals["x"], 1e-3 * data["x"], rtol=1e-14)
    np.testing.assert_array_equal(trial.signals["force"], data["force"])
    assert recording.units == {"x": "m", "force": "N"}
    assert recording.checksum == hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.mark.parametrize(("column", "expected"), [("y[1]", "force"), ("z[:, 0]", "x")])
def test_a_row_or_a_column_of_a_matrix_is_a_signal(tmp_path, column, expected):
    data = table()
    rows = np.stack([data["x"], data["force"]])
    scipy.io.savemat(tmp_path / "m.mat", {"t": data["t"], "y": rows, "z": rows.T})
    trial = read(tmp_path / "m.mat", {"t": "t", "x": column}).trials[0]
    np.testing.assert_array_equal(trial.signals["x"], data[expected])


@pytest.mark.parametrize("name", ["a.mat", "a73.mat"])
def test_the_fields_of_a_struct_are_columns(tmp_path, name):
    data, path = table(), tmp_path / name
    if name == "a.mat":
        scipy.io.savemat(path, {"log": {"t": data["t"], "raw": {"x": data["x"]}}})
    else:
        write_hdf5_mat(path, {"log/t": data["t"], "log/raw/x": data["x"], "#refs#/a": data["x"]})
    assert columns_of(path) == (["log.t", "log.raw.x"] if name == "a.mat" else ["log.raw.x", "log.t"])
    trial = read(path, {"t": "log.t", "x": "log.raw.x"}).trials[0]
    np.testing.assert_array_equal(trial.signals["x"], data["x"])


def test_a_file_without_arrays_of_numbers_says_what_it_holds(tmp_path):
    laps = np.array([(1, 2), (3, 4)], dtype=[("t", "O"), ("x", "O")])
    scipy.io.savemat(tmp_path / "a.mat", {"laps": laps})
    refused(r"no columns: .*a\.mat is laps of shape \(1, 2\); allowed: arrays of", tmp_path / "a.mat")
    with pytest.raises(UserError, match="no columns"):
        columns_of(tmp_path / "a.mat")


def test_a_whole_matrix_or_a_row_that_it_lacks_is_refused(tmp_path):
    np.savez(tmp_path / "m.npz", t=np.arange(20.0), y=np.ones((2, 20)))
    for column in ("y", "y[2]"):
        refused(r"variable is not one column: .*\(2, 20\)", tmp_path / "m.npz", {"t": "t", "x": column})


def test_an_interrupted_mat_parquet_npz_or_gz_is_a_user_error(tmp_path):
    for name, writer in WRITERS.items():
        writer(tmp_path / name, table(2000))
        if name not in ("a.csv", "a.txt"):
            (tmp_path / name).write_bytes((tmp_path / name).read_bytes()[:-1000])
            refused("cannot", tmp_path / name)


@pytest.mark.parametrize(("byte", "value"), [(144, 5), (145, 15), (176, 0), (176, 15), (177, 255)])
def test_a_mat_file_with_damaged_type_codes_raises_instead_of_ending_the_process(tmp_path, byte, value):
    scipy.io.savemat(tmp_path / "a.mat", table())
    raw = bytearray((tmp_path / "a.mat").read_bytes())
    raw[byte] = value
    (tmp_path / "a.mat").write_bytes(raw)
    refused(r"cannot read as \.mat", tmp_path / "a.mat")


# ---- trials, units, gains


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


def test_dates_where_a_number_belongs_are_no_numbers(tmp_path):
    dates = pd.date_range("2026-05-01", periods=20, freq="s")
    pd.DataFrame(table() | {"x": dates}).to_parquet(tmp_path / "a.parquet")
    refused("not a number: .*column 'x', data row 1 is '2026-05-01", tmp_path / "a.parquet")
    path = write_csv(tmp_path / "a.csv", table() | {"t": [f"12:00:{k}" for k in range(20)]})
    refused("not a number: .*is '12:00:0'; .*write times as numbers, or as dates such as", path)


# ---- mistakes


def test_a_missing_file_lists_those_present(tmp_path):
    write_csv(tmp_path / "run_1.csv", table())
    refused(r"unknown file: data\.path is .*run_2\.csv; .*did you mean 'run_1\.csv'", tmp_path / "run_2.csv")
    refused(r"unknown file: .*walk\.csv; allowed: in .*run_1\.csv.*; check the path", tmp_path / "walk.csv")
    refused("the folder .* does not exist", tmp_path / "none" / "run_2.csv")
    refused("no recordings found", str(tmp_path / "*.mat"))


def test_an_unknown_format_names_the_known_ones(tmp_path):
    (tmp_path / "a.xlsx").write_bytes(b"x")
    refused(r"unknown file format.*\.xlsx.*\.parquet", tmp_path / "a.xlsx")


@pytest.mark.parametrize(
    ("columns", "units", "options", "pattern"),
    [
        ({"t": "t", "x": "y"}, SI, {}, r"unknown column: columns\.x in .*a\.csv is 'y'; allowed: t, x, force"),
        ({"t": "t", "forse": "x"}, SI, {}, r"unknown signal: columns is 'forse'.*did you mean 'force'"),
        ({"x": "x"}, SI, {}, "no time"),
        (COLUMNS, {"t": "s", "x": "newton"}, {}, "wrong dimension"),
        (COLUMNS, {"t": "s", "x": "milimeter"}, {}, "unknown unit.*did you mean 'millimeter'"),
        (COLUMNS, SI | {"y": "m"}, {}, "unknown signal: units is 'y'"),
        (COLUMNS, SI, {"gains": {"x": 0}}, r"gain is no factor: gains\.x is 0"),
        (COLUMNS, SI, {"trial_column": "run"}, "unknown column: trial_column in .* is 'run'"),
        ({"t": "t", "x": None}, SI, {}, r"no column: columns\.x is None"),
        ({"t": 3.0, "x": "x"}, SI, {}, r"no column: columns\.t is 3\.0"),
    ],
)
def test_a_mistake_in_the_options_is_named(tmp_path, columns, units, options, pattern):
    refused(pattern, write_csv(tmp_path / "a.csv", table()), columns, units, **options)


@pytest.mark.parametrize(
    ("row", "column", "value", "pattern"),
    [
        (4, "x", np.nan, r"missing value: .*column 'x', data row 5 is empty or NaN"),
        (4, "x", -np.inf, r"infinite value: .*column 'x', data row 5 is -inf"),
        (4, "t", -9.0, r"time goes backwards at row 5: .* is -9 s after 0\.03 s; .*; give trial_column, or split"),
        (4, "x", "n/c", r"not a number: .*column 'x', data row 5 is 'n/c'"),
    ],
)
@pytest.mark.parametrize("name", ["a.csv", "a.parquet"])
def test_the_first_bad_row_is_named(tmp_path, row, column, value, pattern, name):
    frame = pd.DataFrame(table())
    frame[column] = [value if k == row else old for k, old in enumerate(frame[column])]
    if name == "a.parquet":
        frame = frame.astype({column: str}) if isinstance(value, str) else frame
        frame.to_parquet(tmp_path / name)
    else:
        frame.to_csv(tmp_path / name, index=False, na_rep="")
    refused(pattern, tmp_path / name)


def test_missing_values_of_all_columns_are_told_at_once(tmp_path):
    gaps = table()
    gaps["t"][2] = gaps["x"][4] = gaps["x"][9] = np.nan
    refused(
        r"column 't', data row 3 .*; fill or cut the 1 such row of trial 'a', and those of 'x' \(2\)",
        write_csv(tmp_path / "a.csv", gaps),
    )


def test_row_numbers_count_in_the_file_and_not_in_the_trial(tmp_path):
    both = {key: np.tile(values, 2) for key, values in table().items()} | {"run": np.repeat([1, 2], 20)}
    both["x"][30] = np.nan
    refused("data row 31 is", write_csv(tmp_path / "a.csv", both), trial_column="run")


@pytest.mark.parametrize(
    ("text", "pattern"),
    [
        ("", "empty file"),
        ("\n\n", "empty file"),
        ("t,x\n", "empty file|without data rows"),
        (
            "t,x\n" + "".join(f"{k},{k}\n" for k in range(9)),
            "too few samples: .* is 9 samples long; allowed: at least 10",
        ),
        ("t,x\n" + "".join(f"{k},7\n" for k in range(20)), "signal never changes: .*'x' is 7 in every row"),
        ("t,x,x\n" + "".join(f"{k},{k},{k}\n" for k in range(20)), "duplicate column: .*'x' 2 times"),
        ("t,x\n" + "".join(f"{k},{k}\n" for k in range(15)) + "15,15,15\n", "cannot read as a table.*line 16"),
        ("".join(f"{k},{k}\n" for k in range(20)), "no header row"),
    ],
)
def test_a_file_that_cannot_be_learned_from_is_refused(tmp_path, text, pattern):
    (tmp_path / "a.csv").write_text(text)
    refused(pattern, tmp_path / "a.csv")


def test_a_constant_signal_may_be_allowed(tmp_path):
    path = write_csv(tmp_path / "a.csv", table() | {"n": np.full(20, 5.0)})
    columns = COLUMNS | {"force": "n"}
    refused("never changes", path, columns)
    assert read(path, columns, allow_constant={"force"}).names == ["a"]
    assert read(path, columns, required=["x"]).names == ["a"]


def test_two_files_of_one_name_are_refused(tmp_path):
    paths = [write_csv(tmp_path / name, table()) for name in ("a.csv", "a.csv.gz")]
    refused("two trials with one name: .* is 'a'", paths)


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


@pytest.mark.parametrize(
    ("above", "sep"),
    [
        ("# t,x,force\n", ","),
        ("# t x force\n", " "),
        ("# logger v1.0\n# 3 channels\n# t,x,force\n", ","),
        ("# logger v1.0\nt,x,force\n", ","),
        ("Logger: ACME\n\nt,x,force\n", ","),
        ("Logger;ACME\nRate;100\nt;x;force\n", ";"),
        ("#,t,x,force\n", ","),
    ],
)
def test_what_stands_above_the_header_is_not_taken_for_it(tmp_path, above, sep):
    data, path = table(), tmp_path / "a.txt"
    counter = [str(k) for k in range(20)] if above.startswith("#,") else None
    rows = zip(*([counter] if counter else []), *(map(repr, values.tolist()) for values in data.values()), strict=True)
    path.write_text(above + "\n".join(sep.join(row) for row in rows))
    names = ["t", "x", "force"]
    assert columns_of(path) == [*(["#"] if counter else []), *names]
    assert columns_of(path, sep)[-3:] == names
    (trial,) = read(path, {name: name for name in names}).trials
    np.testing.assert_array_equal(trial.t, data["t"])
    np.testing.assert_array_equal(trial.signals["force"], data["force"])


def test_a_comment_above_numbers_without_a_header_names_none_of_them(tmp_path):
    np.savetxt(tmp_path / "a.txt", np.transpose([*table().values()]), header="logger v1.0")
    assert columns_of(tmp_path / "a.txt") == ["c1", "c2", "c3"]
    assert len(read(tmp_path / "a.txt", {"t": "c1", "x": "c2"})) == 20


# ---- properties of the text reader

finite = st.floats(allow_nan=False, allow_infinity=False, width=64).map(lambda value: value + 0.0)
quick = settings(
    max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
)


@quick
@given(
    values=st.lists(finite, min_size=10, max_size=25).filter(lambda values: len(set(values)) > 1),
    layout=st.sampled_from([(",", "."), (";", "."), ("\t", "."), (";", ","), ("\t", ",")]),
    bom=st.booleans(),
    packed=st.booleans(),
    line_end=st.sampled_from(["\n", "\r\n", "\r"]),
    quoted=st.booleans(),
    final=st.booleans(),
)
def test_numbers_survive_any_text_layout_exactly(tmp_path, values, layout, bom, packed, line_end, quoted, final):
    sep, point = layout
    names = ["time (s)", "Weg ä"]
    header = sep.join(f'"{name}"' if quoted else name for name in names)
    # The last digit of time keeps a decimal mark in every file.
    rows = [f"{k + 0.5!r}{sep}{value!r}".replace(".", point) for k, value in enumerate(values)]
    text = line_end.join([header, *rows]) + (line_end if final else "")
    raw = (b"\xef\xbb\xbf" if bom else b"") + text.encode()
    path = tmp_path / ("a.csv.gz" if packed else "a.csv")
    path.write_bytes(gzip.compress(raw) if packed else raw)
    trial = read(path, {"t": names[0], "x": names[1]}).trials[0]
    assert trial.signals["x"].tolist() == values
    assert trial.t.tolist() == [k + 0.5 for k in range(len(values))]


garbage = st.one_of(
    st.binary(max_size=300),
    st.text(max_size=300).map(lambda text: text.encode("utf-8", "surrogatepass")),
    st.text(alphabet="tx,;\t \n\r\"'0123456789.-+eEnaif#", max_size=300).map(lambda text: b"t,x\n" + text.encode()),
)


@quick
@given(raw=garbage, name=st.sampled_from(["a.csv", "a.txt", "a.csv.gz", "a.mat", "a.npz", "a.parquet"]))
def test_garbage_ends_in_a_recording_or_a_user_error(tmp_path, raw, name):
    (tmp_path / name).write_bytes(raw)
    with contextlib.suppress(UserError):
        assert isinstance(read(tmp_path / name), Recording)


@quick
@given(data=st.data())
def test_a_damaged_file_ends_in_a_recording_or_a_user_error(tmp_path, data):
    name = data.draw(st.sampled_from(sorted(WRITERS)))
    WRITERS[name](tmp_path / name, table())
    raw = bytearray((tmp_path / name).read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        raw[data.draw(st.integers(0, len(raw) - 1))] = data.draw(st.integers(0, 255))
    (tmp_path / name).write_bytes(raw)
    with contextlib.suppress(UserError):
        assert isinstance(read(tmp_path / name), Recording)


def test_a_variable_of_a_mat_file_whose_name_is_no_text_is_told_by_its_letters(tmp_path):
    with h5py.File(tmp_path / "a.mat", "w") as file:
        file.create_dataset(b"\xe4", data=np.arange(3.0))
    refused("unknown column", tmp_path / "a.mat", {"t": "t"})
    assert columns_of(tmp_path / "a.mat") == ["ä"]
