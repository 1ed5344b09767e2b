"""Formats of recordings and layouts of text: the numbers that were written."""

import gzip
import hashlib

import numpy as np
import pytest
import scipy.io
from hypothesis import given
from hypothesis import strategies as st
from written import WRITERS, quick, read, table, write_hdf5_mat

from frictionpinn.data.tables import columns_of


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


finite = st.floats(allow_nan=False, allow_infinity=False, width=64).map(lambda value: value + 0.0)


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
