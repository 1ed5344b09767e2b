"""Mistakes that a file, or what is asked of it, can hold: one line that says what to do."""

import contextlib

import h5py
import numpy as np
import pandas as pd
import pytest
import scipy.io
from hypothesis import given
from hypothesis import strategies as st
from written import COLUMNS, SI, WRITERS, quick, read, refused, table, write_csv

from frictionpinn.data.recording import Recording
from frictionpinn.data.tables import columns_of
from frictionpinn.errors import UserError


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


def test_dates_where_a_number_belongs_are_no_numbers(tmp_path):
    dates = pd.date_range("2026-05-01", periods=20, freq="s")
    pd.DataFrame(table() | {"x": dates}).to_parquet(tmp_path / "a.parquet")
    refused("not a number: .*column 'x', data row 1 is '2026-05-01", tmp_path / "a.parquet")
    path = write_csv(tmp_path / "a.csv", table() | {"t": [f"12:00:{k}" for k in range(20)]})
    refused("not a number: .*is '12:00:0'; .*write times as numbers, or as dates such as", path)


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


def test_two_files_of_one_name_are_refused(tmp_path):
    paths = [write_csv(tmp_path / name, table()) for name in ("a.csv", "a.csv.gz")]
    refused("two trials with one name: .* is 'a'", paths)


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


def test_a_variable_of_a_mat_file_whose_name_is_no_text_is_told_by_its_letters(tmp_path):
    with h5py.File(tmp_path / "a.mat", "w") as file:
        file.create_dataset(b"\xe4", data=np.arange(3.0))
    refused("unknown column", tmp_path / "a.mat", {"t": "t"})
    assert columns_of(tmp_path / "a.mat") == ["ä"]


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
