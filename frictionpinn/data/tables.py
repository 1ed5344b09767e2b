"""Reading of one file of columns: text, Parquet, MAT and NumPy archives."""

from __future__ import annotations

import csv
import re
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from frictionpinn.data.mat import load_mat
from frictionpinn.data.text import open_text
from frictionpinn.errors import UserError, nearest

TEXT_ENDINGS = (".csv", ".csv.gz", ".txt", ".txt.gz", ".tsv")
ENDINGS = (*TEXT_ENDINGS, ".parquet", ".mat", ".npz")

_INDEXED = re.compile(r"^(?P<name>.+?)\[\s*(?P<column>:\s*,\s*)?(?P<index>\d+)\s*(?:,\s*:\s*)?\]$")
_DELIMITERS = ("\t", ";", ",", " ")  # the comma comes last but one because it can also mark decimals
_NUMBER = re.compile(r"[-+]?[\d.,]+(?:[eE][-+]?\d+)?")
_ROW = re.compile(r"(?=.*\d)[-+\d.,;eE\s]+")  # of numbers, whatever is between them
# Written for no number; a trial may be called so.
_MISSING = ("", "NA", "N/A", "n/a", "#N/A", "#NA", "<NA>", "NaN", "nan", "-NaN", "-nan", "NULL", "null", "None",
            "1.#QNAN", "-1.#QNAN", "1.#IND", "-1.#IND")  # fmt: skip
_MARK = re.compile(r"^\s*#+ *(?=[^\W\d])")  # of a comment, before a name: a column may itself be called #


@dataclass(frozen=True)
class Table:
    """The columns of one file.

    Attributes:
        path: the file.
        names: column or variable names in the order of the file; a name can occur twice.
        arrays: one array for each name; two-dimensional variables are reached by ``"name[row]"`` or
            ``"name[:, column]"``, counted from 0.
    """

    path: Path
    names: list[str]
    arrays: list[np.ndarray]

    def pick(self, name: str, where: str) -> np.ndarray:
        """Return the column ``name``, shape (n,), as stored; :class:`UserError` where there is no single such one."""
        found = _INDEXED.match(name)
        base = name if name in self.names or not found else found["name"]
        if base not in self.names:
            raise UserError(
                "unknown column",
                where=f"{where} in {self.path}",
                received=repr(name),
                allowed=", ".join(self.names) or "none, the file holds no columns",
                fix="there is no header row: c1 is the first column"
                if self.names[:1] == ["c1"]
                else nearest(name, self.names) or "use one of the columns present",
            )
        if self.names.count(base) > 1:
            raise UserError(
                "duplicate column",
                where=str(self.path),
                received=f"'{base}' {self.names.count(base)} times in the header",
                allowed="one column of that name",
                fix="rename the others",
            )
        values = self.arrays[self.names.index(base)]
        if base != name and found and values.ndim == 2:
            index, axis = int(found["index"]), 1 if found["column"] else 0
            if index < values.shape[axis]:
                return values[:, index] if axis else values[index]
        elif base == name and sum(size > 1 for size in values.shape) <= 1:
            return values.reshape(-1)
        raise UserError(
            "variable is not one column",
            where=f"{where} in {self.path}",
            received=f"{name} of a variable of shape {values.shape}",
            allowed="a one-dimensional variable, 'name[row]' or 'name[:, column]' counted from 0",
            fix=f"write for instance '{base}[0]'",
        )


def numbers(values: np.ndarray, where: str, fix: str = "") -> np.ndarray:
    """Return a column as float64, shape (n,); :class:`UserError` with the first row that is not a number."""
    if values.dtype.kind in "fiub":
        return values.astype(float)
    if values.dtype.kind in "mM":  # as integers they would pass for numbers
        values = values.astype(str)
    out = np.empty(len(values))
    for row, value in enumerate(values, start=1):
        try:
            out[row - 1] = np.nan if value is None else float(value)
        except (TypeError, ValueError, OverflowError):
            raise UserError(
                "not a number",
                where=f"{where}, data row {row}",
                received=repr(str(value))[:60],
                allowed="numbers",
                fix=fix
                or "remove rows of text (such as units), or say 'data.decimal=\",\"' where commas mark decimals",
            ) from None
    return out


def ending(path: Path) -> str | None:
    """Return which of :data:`ENDINGS` the file name has, or None."""
    name = path.name.lower()
    return next((end for end in sorted(ENDINGS, key=len, reverse=True) if name.endswith(end)), None)


def load_table(
    path: Path, delimiter: str | None = None, decimal: str | None = None, labels: str | None = None
) -> Table:
    """Read the file at ``path`` by its ending; of a text file the column ``labels`` as text, 001 is not 1.

    Raises:
        UserError: unknown ending, empty file, or content that does not fit the ending.
    """
    _check_marks(delimiter, decimal)
    end = ending(path)
    if end is None:
        raise UserError(
            "unknown file format",
            where=str(path),
            received=f"of ending '{path.suffix}'",
            allowed=", ".join(ENDINGS),
            fix="export the recording to one of these",
        )
    if path.stat().st_size == 0:
        raise _empty(path)
    reader = _READERS.get(end)
    if reader is None:
        return _load_text(path, delimiter, decimal, labels)
    try:
        return reader(path)
    except UserError:
        raise
    except Exception as error:  # on a damaged file these parsers raise errors of almost any kind
        reason = str(error).split("\n", 1)[0][:120]
        raise UserError(
            f"cannot read as {end}", where=str(path), received=reason, fix="export the file again"
        ) from error


def _check_marks(delimiter: object, decimal: object = None) -> None:
    if delimiter is not None and not (isinstance(delimiter, str) and len(delimiter) == 1):
        raise UserError("not a delimiter", where="data.delimiter", received=repr(delimiter),
                        allowed='one character such as ";", or null')  # fmt: skip
    if decimal not in (None, ".", ",") or decimal == delimiter is not None:
        raise UserError("not a decimal mark", where="data.decimal", received=repr(decimal),
                        allowed='"," or "." where that is not the delimiter, or null')  # fmt: skip


def _empty(path: Path) -> UserError:
    return UserError(
        "empty file", where=str(path), allowed="a header and at least 10 rows", fix="export the recording again"
    )


def _load_text(path: Path, delimiter: str | None, decimal: str | None, labels: str | None) -> Table:
    import pandas as pd

    with open_text(path) as text:
        lines = text.head(50)
        if not lines:
            raise _empty(path)
        try:
            above, line, sep = _top(lines, delimiter)
            header = _header(line, sep)
            named = [k for k, name in enumerate(header) if name == labels]
            text.skip(above if _headless(line, sep) else above + 1)
            with warnings.catch_warnings():
                warnings.simplefilter("error", pd.errors.ParserWarning)
                warnings.simplefilter("ignore", pd.errors.DtypeWarning)  # text among numbers: told with its row
                frame = pd.read_csv(
                    text,
                    sep=r"\s+" if sep == " " else sep,
                    decimal=decimal or _sniff_decimal(lines[above + 1 :], sep),
                    dtype=dict.fromkeys(named, str),
                    keep_default_na=False,
                    na_values={k: "" if k in named else _MISSING for k in range(len(header))},
                    header=None,
                    names=list(range(len(header))),
                    index_col=False,
                    skipinitialspace=True,
                    float_precision="round_trip",
                )
        except UserError:
            raise
        except (csv.Error, ValueError, OverflowError, pd.errors.ParserWarning) as error:
            raise _no_table(path, error) from error
    for k in named:
        frame[k] = frame[k].astype("category")  # each name once in memory, however many rows have it
    return Table(path, header, [frame.pop(column).to_numpy() for column in list(frame)])


def _no_table(path: Path, error: Exception) -> UserError:
    return UserError(
        "cannot read as a table",
        where=str(path),
        received=str(error).split("\n", 1)[0][:120],
        allowed="a header row, then rows with as many fields",
        fix="mend the row, or say data.delimiter and data.decimal",
    )


def _top(lines: list[str], delimiter: str | None) -> tuple[int, str, str]:
    """How many lines stand above the header, the header, and the delimiter.

    Loggers write above it who they are, with a # or without: it is the first line of names that has as many fields as
    the rows below it. Where none has, it is the first line without a #.
    """
    marked = next((k for k, line in enumerate(lines) if not line.lstrip().startswith("#")), 0)
    for k, line in enumerate(lines[:-1]):
        if k >= marked and _ROW.fullmatch(line):
            break
        text = _MARK.sub("", line)
        for sep in [delimiter] if delimiter else _DELIMITERS:
            fields = _fields(text, sep)
            alike = all(len(_fields(row, sep)) == len(fields) for row in lines[k + 1 : k + 20])
            if alike and len(fields) > 1 and not any(_NUMBER.fullmatch(name.strip()) for name in fields):
                return k, text, sep
    return marked, lines[marked], delimiter or _sniff_delimiter(lines[marked:])


def _header(line: str, sep: str) -> list[str]:
    """Names of the columns; c1, c2, ... where the first row holds numbers already."""
    header = [name.strip() for name in _fields(line, sep)]
    return [f"c{k + 1}" for k in range(len(header))] if _headless(line, sep) else header


def _headless(line: str, sep: str) -> bool:
    return all(_NUMBER.fullmatch(name.strip()) for name in _fields(line, sep))


def _fields(line: str, sep: str) -> list[str]:
    return line.split() if sep == " " else next(csv.reader([line], delimiter=sep))


def _sniff_delimiter(lines: list[str]) -> str:
    """Return the delimiter that splits the header and the first rows into equally many fields."""
    candidates = [sep for sep in _DELIMITERS if len(_fields(lines[0], sep)) > 1]
    for sep in candidates:
        count = len(_fields(lines[0], sep))
        if all(len(_fields(line, sep)) == count for line in lines[1:20]):
            return sep
    return candidates[0] if candidates else ","


def _sniff_decimal(lines: list[str], sep: str) -> str:
    cells = [cell.strip() for line in lines for cell in _fields(line, sep)]
    commas = any(re.fullmatch(r"[-+]?\d*,\d+(?:[eE][-+]?\d+)?", cell) for cell in cells)
    points = any(re.fullmatch(r"[-+]?\d*\.\d+(?:[eE][-+]?\d+)?", cell) for cell in cells)
    return "," if sep != "," and commas and not points else "."


def _load_parquet(path: Path) -> Table:
    import pyarrow.parquet as pq

    table = pq.read_table(path)
    columns = [column.to_pandas().to_numpy() for column in table.columns]
    return Table(path, [str(name) for name in table.column_names], columns)


def _load_npz(path: Path) -> Table:
    with np.load(path, allow_pickle=False) as archive:
        return _from_variables(path, {name: archive[name] for name in archive.files})


def _load_mat(path: Path) -> Table:
    return _from_variables(path, load_mat(path))


def _from_variables(path: Path, variables: dict[str, Any]) -> Table:
    """Keep what can be a column: arrays of numbers, text or dates with up to two dimensions."""
    kept = {
        name: value
        for name, value in variables.items()
        if isinstance(value, np.ndarray) and value.dtype.kind in "fiubUmM" and value.ndim <= 2
    }
    if not kept:
        held = ", ".join(f"{name} of shape {np.shape(value)}" for name, value in variables.items() if name[:2] != "__")
        raise UserError("no columns", where=str(path), received=held or "empty",
                        allowed="arrays of numbers, or a struct of them", fix="save each column so")  # fmt: skip
    return Table(path, list(kept), list(kept.values()))


_READERS: dict[str, Callable[[Path], Table]] = {".parquet": _load_parquet, ".mat": _load_mat, ".npz": _load_npz}


def columns_of(path: str | Path, delimiter: str | None = None) -> list[str]:
    """Names of the columns or variables of the first file that ``path`` names, in the order of the file."""
    from frictionpinn.data.read import find_files

    _check_marks(delimiter)
    file = find_files(path)[0]
    if ending(file) not in TEXT_ENDINGS or file.stat().st_size == 0:
        return load_table(file).names
    with open_text(file) as text:
        lines = text.head(50)
    if not lines:
        raise _empty(file)
    try:
        _, line, sep = _top(lines, delimiter)
        return _header(line, sep)
    except csv.Error as error:
        raise _no_table(file, error) from error
