"""Recordings and options as they come from the field: a kept list, and strategies that make more of them."""

from __future__ import annotations

import gzip
from collections.abc import Callable

import numpy as np
import pandas as pd
from hypothesis import strategies as st

SIGNALS = ("x", "v", "a", "theta", "omega", "alpha")


def swing(rows: int = 40, trials: int = 2) -> pd.DataFrame:
    """A made-up recording of a pendulum on a box: smooth, consistent, every signal varies."""
    t = np.arange(rows) * 0.01
    parts = []
    for k in range(trials):
        w = 9.0 + k
        x, theta = 0.02 * np.sin(w * t), 0.8 * np.sin(6.0 * t + 0.3 * k)
        columns = {"x": x, "v": 0.02 * w * np.cos(w * t), "a": -0.02 * w * w * np.sin(w * t)}
        columns |= {"theta": theta, "omega": 4.8 * np.cos(6.0 * t + 0.3 * k), "alpha": -36.0 * theta}
        parts.append(pd.DataFrame({"trial": k + 1, "t": t, **columns}))
    return pd.concat(parts, ignore_index=True)


def text(table: pd.DataFrame, **options) -> str:
    return table.to_csv(index=False, **options)


def changed(**columns) -> pd.DataFrame:
    return swing().assign(**columns)


def _put(column: str, row: int, value: object) -> pd.DataFrame:
    table = swing().astype({column: object})
    table.loc[row, column] = value
    return table


def _cut_rows(first: int, last: int) -> pd.DataFrame:
    return swing().drop(index=range(first, last))


def _mixed_ends() -> bytes:
    lines = text(swing()).splitlines()
    return "".join(line + ("\r\n" if k % 3 else "\n") for k, line in enumerate(lines)).encode()


def _held(column: str) -> pd.DataFrame:
    """A coarse sensor: long stretches of one value, as encoders give them."""
    table = swing()
    table[column] = np.round(table[column] / 0.01) * 0.01
    return table


# name -> content of run.csv, and a pattern of the line that refuses it (None: it is read)
KEPT: dict[str, tuple[Callable[[], bytes | str], str | None]] = {
    "as it should be": (lambda: text(swing()), None),
    "byte order mark": (lambda: b"\xef\xbb\xbf" + text(swing()).encode(), None),
    "utf-16": (lambda: text(swing()).encode("utf-16"), None),
    "decimal commas": (lambda: text(swing(), sep=";", decimal=","), None),
    "decimal commas between commas": (lambda: text(swing(), decimal=","), "never changes|not a number|read as a table"),
    "semicolons": (lambda: text(swing(), sep=";"), None),
    "tabs and spaces": (lambda: text(swing(), sep="\t").replace("\t", " \t "), None),
    "mixed line ends": (_mixed_ends, None),
    "old Macintosh line ends": (lambda: text(swing()).replace("\n", "\r"), None),
    "blank lines in between": (lambda: text(swing()).replace("\n", "\n   \n\n"), None),
    "no end to the last line": (lambda: text(swing()).rstrip(), None),
    "Latin-1 header": (lambda: text(swing().assign(Weg=1.0)).replace("Weg", "Weg ä").encode("latin-1"), None),
    "quoted everything": (lambda: text(swing(), quoting=1), None),
    "duplicate columns": (lambda: text(swing()).replace("omega", "theta"), "duplicate column: .*'theta' 2 times"),
    "spaces around names": (lambda: text(swing()).replace(",", " , ", 7), None),
    "a row of units": (
        lambda: text(swing()).replace("\n", "\n-,s,m,m/s,m/s2,rad,rad/s,rad/s2\n", 1),
        "not a number: .*data row 1",
    ),
    "no header": (lambda: text(swing()).partition("\n")[2], "no header row"),
    "header alone": (lambda: text(swing()[:0]), "empty|without data rows"),
    "empty": (lambda: "", "empty file"),
    "white space alone": (lambda: " \n\t\n \r\n", "empty file"),
    "zeros of a crashed logger": (lambda: text(swing()).encode() + b"\0" * 4096, "not a text file: .*zero bytes"),
    "cut in the middle of a row": (lambda: text(swing())[:-30], "missing value: .*data row 80"),
    "a field too many": (lambda: text(swing()) + "2,9,9,9,9,9,9,9,9\n", "cannot read as a table: .*line 81"),
    "NaN as text": (lambda: text(_put("v", 7, "NaN")), "missing value: .*column 'v', data row 8"),
    "n/a": (lambda: text(_put("v", 7, "n/a")), "missing value: .*column 'v', data row 8"),
    "overflow of a spreadsheet": (lambda: text(_put("v", 7, "#####")), "not a number: .*data row 8 is '#####'"),
    "infinity": (lambda: text(_put("a", 7, "inf")), "infinite value: .*column 'a', data row 8"),
    "beyond double precision": (lambda: text(_put("a", 7, "1e999")), "infinite value: .*column 'a', data row 8"),
    "an integer beyond any float": (lambda: text(_put("a", 7, "9" * 400)), "column 'a', data row 8"),
    "thousands separated": (lambda: text(_put("x", 7, "1 000.5")), "not a number: .*data row 8 is '1 000.5'"),
    "times of day": (
        lambda: text(changed(t=[f"12:00:{k:02d}" for k in range(80)])),
        "not a number: .*column 't', data row 1",
    ),
    "true and false": (lambda: text(changed(x=[k % 3 == 0 for k in range(80)])), None),
    "gap of a second": (lambda: text(swing().assign(t=swing().t + (swing().index % 40 > 20))), None),
    "samples lost": (lambda: text(_cut_rows(10, 15)), None),
    "trial of one sample": (lambda: text(_cut_rows(41, 80)), "too few samples: .*trial '2' is 1 samples? long"),
    "trials without names": (lambda: text(_put("trial", 50, None)), "missing value: .*column 'trial', data row 51"),
    "trials interleaved": (lambda: text(swing().sort_values("t", kind="stable")), None),
    "a trial for every row": (lambda: text(changed(trial=np.arange(80) / 7)), "too few samples"),
    "time starts anew without a trial column": (
        lambda: text(swing().drop(columns="trial")),
        "time goes backwards at row 41: .*give trial_column, or split the file",
    ),
    "time repeats": (lambda: text(_put("t", 12, 0.11)), None),
    "time with one digit": (lambda: text(swing().round({"t": 1})), "time repeats at row .*more digits"),
    "time in one place": (lambda: text(changed(t=1.0)), "time repeats at row 2"),
    "coarse sensor": (lambda: text(_held("x")), None),
    "dead sensor": (lambda: text(changed(v=0.0)), "signal never changes: .*'v' is 0"),
    "nothing moves": (lambda: text(changed(x=0.5)), "signal never changes: .*'x' is 0.5"),
    "gzip that is none": (lambda: b"\x1f\x8b" + text(swing()).encode(), "cannot|no header|not a text|no signal|read"),
    "a picture": (lambda: b"\x89PNG\r\n\x1a\n" + bytes(range(256)) * 20, "not a text file|cannot|no signal"),
    "a web page": (lambda: "<!DOCTYPE html>\n<html><body>404, not found</body></html>\n", "no signal|cannot"),
    "one endless line": (lambda: "t,x," * 20000, "no signal|duplicate|empty|without data"),
    "open quote": (lambda: text(swing()).replace("0.0,", '"0.0,', 1), "cannot read|missing|not a number|EOF|no signal"),
}  # fmt: skip


# ---- more of them

columns = st.sampled_from(["t", *SIGNALS, "trial"])
values = st.one_of(
    st.sampled_from(["", "NaN", "inf", "-inf", "1e999", "-0", "0x1F", "1,5", "1 000", "--", "#N/A", "true", "12:30",
                     "\u2212 1", "1e-320", "9" * 400, "'", '"', "a,b", ";", "\t", "\u00a0", "1_000", "None", "1.2.3"]),
    st.floats(width=64).map(repr),
    st.integers(-(10**25), 10**25).map(str),
    st.text(max_size=6),
)  # fmt: skip


@st.composite
def recordings(draw) -> tuple[str, bytes]:
    """A recording with a few things wrong: name of the file, its bytes."""
    rows, trials = draw(st.integers(0, 40)), draw(st.integers(1, 3))
    table = swing(rows, trials).astype(object)
    for _ in range(draw(st.integers(0, 3))):
        change = draw(st.sampled_from(["value", "drop", "double", "rename", "shuffle", "constant", "scale", "repeat"]))
        name = draw(columns)
        if list(table.columns).count(name) != 1 or not len(table):
            continue
        if change == "value":
            column = list(table[name])
            column[draw(st.integers(0, len(column) - 1))] = draw(values)
            table[name] = pd.Series(column, index=table.index, dtype=object)
        elif change == "drop":
            table = table.drop(columns=name)
        elif change == "double":
            table.insert(0, draw(st.sampled_from([name, f"{name}."])), table[name], allow_duplicates=True)
        elif change == "rename":
            table = table.rename(columns={name: draw(st.text(max_size=8))})
        elif change == "shuffle":
            table = table.sample(frac=1.0, random_state=draw(st.integers(0, 99)))
        elif change == "constant":
            table[name] = draw(values)
        elif change == "scale":
            factor = draw(st.sampled_from([0.0, 1e-300, 1e300, -1.0, 1e9]))
            table[name] = [value * factor if isinstance(value, int | float) else value for value in table[name]]
        elif change == "repeat":
            table = pd.concat([table, table.iloc[: draw(st.integers(1, 5))]])
    sep = draw(st.sampled_from([",", ";", "\t", " ", "|"]))
    content = table.to_csv(index=False, sep=sep, decimal=draw(st.sampled_from([".", ","])))
    content = content.replace("\n", draw(st.sampled_from(["\n", "\r\n", "\r", "\n\n"])))
    raw = content.encode(draw(st.sampled_from(["utf-8", "utf-8-sig", "utf-16"])), "surrogatepass")
    raw = raw[: draw(st.integers(0, len(raw)))] if draw(st.booleans()) and draw(st.booleans()) else raw
    packed = draw(st.booleans()) and draw(st.booleans())
    return ("run.csv.gz", gzip.compress(raw)) if packed else ("run.csv", raw)
