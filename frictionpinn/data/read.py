"""Reading of recordings: files of columns become trials of SI signals."""

from __future__ import annotations

import glob
import hashlib
import os
import re
from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from frictionpinn.data.check import check_recording, check_trial
from frictionpinn.data.clock import mended
from frictionpinn.data.dates import since_first
from frictionpinn.data.recording import Recording, Trial
from frictionpinn.data.tables import ENDINGS, Table, ending, load_table, numbers
from frictionpinn.data.units import DIMENSIONLESS, to_si
from frictionpinn.errors import UserError, nearest

Paths = str | os.PathLike | Iterable[str | os.PathLike]
_CLOCKS = ("t", "start")


def read_recording(
    paths: Paths,
    *,
    columns: Mapping[str, str | float],
    units: Mapping[str, str],
    signal_units: Mapping[str, str],
    trial_column: str | None = None,
    gains: Mapping[str, float] | None = None,
    required: Iterable[str] | None = None,
    allow_constant: Collection[str] = (),
    delimiter: str | None = None,
    decimal: str | None = None,
) -> Recording:
    """Read one or several files into a recording in SI units, checked.

    Args:
        paths: a file, a folder, a glob pattern, or a list of these. Formats: .csv, .txt, .tsv (also .gz), .parquet,
            .mat (all versions), .npz. Without ``trial_column`` each file is one trial, named by its stem.
        columns: signal name -> column or variable of the file; ``"t"`` is required, numbers or dates. ``"var[0]"`` is
            a row and ``"var[:, 0]"`` a column of a two-dimensional variable, counted from 0. A number stands for a
            signal that has this value throughout. ``"start"`` is no signal: its value in the first row of a
            trial is when in the session that began (see :class:`Recording` for recordings without it).
        units: signal name -> unit of its column ("mm/s"); ``"default": "SI"`` covers the signals not named.
        signal_units: signal name -> SI unit that the signal wants; "" for dimensionless, which needs no unit.
        trial_column: column whose values name the trials.
        gains: signal name -> factor by which the column is multiplied before its unit is read (N/V).
        required: signals that must vary; by default all that are read from columns.
        allow_constant: signals that may be constant, such as a normal force.
        delimiter: of text files; found from the file if None.
        decimal: decimal mark of text files, "." or ","; found from the file if None.

    Returns:
        The recording; its checksum is the sha256 of the bytes of all files in order.

    Raises:
        UserError: unknown file, column or unit; text, NaN or infinity among the numbers; time that goes backwards or
            is too coarse; fewer than 10 samples in a trial; a signal that never changes.
    """
    gains = gains or {}
    _check_mappings(columns, units, signal_units, gains)
    files = find_files(paths)
    trials: list[Trial] = []
    digest = hashlib.sha256()
    for file in files:
        _add_bytes(digest, file)
        table = load_table(file, delimiter, decimal, trial_column)
        trials += _trials(table, columns, units, signal_units, gains, trial_column)
    where = str(files[0]) if len(files) == 1 else f"{files[0]} and {len(files) - 1} more"
    read = [name for name, column in columns.items() if name not in _CLOCKS and isinstance(column, str)]
    if any(trial.start is not None for trial in trials):
        trials = _from_first(trials, where)
    recording = Recording(
        trials=tuple(trials),
        units={name: signal_units[name] for name in columns if name not in _CLOCKS},
        source=", ".join(str(file) for file in files),
        checksum=digest.hexdigest(),
    )
    check_recording(recording, where, read if required is None else required, allow_constant)
    return recording


def tells_starts(paths: Paths, trial_column: str | None, delimiter: str | None, decimal: str | None) -> bool:
    """Whether the column ``start`` is one time in every trial, as a saved recording has it: elsewhere it may be a flag,
    a text or a place."""
    for file in find_files(paths):
        table = load_table(file, delimiter, decimal, trial_column)
        try:
            values, _ = _raw(table, "start", "start", None)
        except UserError:
            return False
        trials = (values[rows] for _, rows in _groups(table, trial_column, len(values)))
        if not all(np.isfinite(own).all() and np.ptp(own) == 0 for own in trials):
            return False
    return True


def find_files(paths: Paths) -> list[Path]:
    """Return the files that ``paths`` names, each once; of a folder or pattern as names and numbers count.

    Raises:
        UserError: a path that names no file; the message lists similar names that exist.
    """
    if isinstance(paths, str | os.PathLike):
        paths = [paths]
    files: list[Path] = []
    for item in paths:
        files += _expand(Path(item).expanduser())
    if not files:
        raise UserError("no files", where="data.path", received="an empty list", allowed="at least one file")
    return list(dict.fromkeys(files))


def _expand(path: Path) -> list[Path]:
    if path.is_file():
        return [path]
    if path.is_dir():
        found = sorted((file for file in path.iterdir() if file.is_file() and ending(file)), key=_counted)
    else:
        found = sorted(filter(Path.is_file, map(Path, glob.glob(str(path), recursive=True))), key=_counted)
    if found:
        return found
    if path.is_dir() or glob.has_magic(str(path)):
        raise UserError(
            "no recordings found",
            where="data.path",
            received=str(path),
            allowed=f"files ending in {', '.join(ENDINGS)}",
        )
    folder = path.parent
    if not folder.is_dir():
        raise UserError(
            "unknown file", where="data.path", received=str(path), fix=f"the folder {folder} does not exist"
        )
    present = sorted(file.name for file in folder.iterdir() if ending(file))
    listed = ", ".join(present[:8]) + (f" and {len(present) - 8} more" if len(present) > 8 else "")
    alike = [name for name in present if nearest(path.stem, [Path(name).stem])]  # that both end in .csv says nothing
    raise UserError(
        "unknown file",
        where="data.path",
        received=str(path),
        allowed=f"in {folder} are {listed}" if present else "",
        fix=nearest(path.name, alike) or "check the path",
    )


def _counted(path: Path) -> list[tuple[int, str]]:
    """Sorting key by which lap_2 comes before lap_10."""
    parts = re.split(r"(\d+)", str(path))
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in parts]


def _add_bytes(digest: Any, path: Path) -> None:
    try:
        with path.open("rb") as file:
            while piece := file.read(1 << 20):
                digest.update(piece)
    except OSError as error:
        raise UserError(
            "cannot open file", where=str(path), received=error.strerror, fix="check its permissions"
        ) from error


def _check_mappings(
    columns: Mapping[str, str | float],
    units: Mapping[str, str],
    signal_units: Mapping[str, str],
    gains: Mapping[str, float],
) -> None:
    known = {*signal_units, *_CLOCKS}
    for option, names, valid in (
        ("columns", set(columns), known),
        ("units", set(units), {*known, "default"}),
        ("gains", set(gains), known),
    ):
        for name in sorted(names - valid, key=str):
            raise UserError(
                "unknown signal",
                where=option,
                received=repr(name),
                allowed=", ".join(sorted(valid)),
                fix=nearest(name, valid) or "use one of the allowed names",
            )
    if "t" not in columns:
        raise UserError("no time", where="data.columns", received=", ".join(columns) or "empty",
                        allowed="an entry for t", fix="name its column: data.columns={t: time, ...}")  # fmt: skip
    for name, gain in gains.items():
        number = isinstance(gain, int | float) and not isinstance(gain, bool)
        if not number or not np.isfinite(gain) or gain == 0:
            raise UserError("gain is no factor", where=f"gains.{name}", received=repr(gain), allowed="a number not 0")


def _unit(name: str, units: Mapping[str, str], wanted: str) -> str:
    """Return the unit of a signal's column."""
    if name in units:
        return str(units[name])
    if wanted in DIMENSIONLESS:
        return wanted
    if str(units.get("default", "")) == "SI":
        return "SI"
    raise UserError(
        "missing unit",
        where=f"units.{name}",
        allowed=f"the unit of its column, convertible to {wanted}",
        fix=f"add 'units.{name}: {wanted}', or 'units.default: SI' where all columns are in SI",
    )


def _trials(
    table: Table,
    columns: Mapping[str, str | float],
    units: Mapping[str, str],
    signal_units: Mapping[str, str],
    gains: Mapping[str, float],
    trial_column: str | None,
) -> list[Trial]:
    """Split one file into its trials, in SI units and checked."""
    wanted = {**dict.fromkeys(_CLOCKS, "s"), **signal_units}
    labels = {name: str(column) for name, column in columns.items()}
    data: dict[str, np.ndarray] = {}
    began: float | None = None  # of dates: they tell the pauses between files, too
    for name in ["t", *(name for name in columns if name != "t")]:
        raw, first = _raw(table, name, columns[name], len(data["t"]) if data else None)
        unit = _unit(name, units, wanted[name]) if first is None else "s"
        data[name] = to_si(raw * float(gains.get(name, 1.0)), unit, wanted[name], f"units.{name}")
        if first and name == "start":
            data[name] += first
        elif first:
            began = first
    t, starts = data.pop("t"), data.pop("start", None)
    if starts is None and began is not None:
        starts = began + t
    angles = [name for name in data if wanted[name] == "rad"]
    split = "give trial_column, or split the file" if trial_column is None else f"check the values of '{trial_column}'"
    trials = []
    for label, rows in _groups(table, trial_column, len(t)):
        start = None if starts is None else float(starts[rows[0]])
        whole = Trial(label, t[rows], {name: values[rows] for name, values in data.items()}, start=start)
        for trial, own in mended(whole, rows + 1, angles, str(table.path)):
            check_trial(trial, str(table.path), data, rows=own, columns=labels, split=split)
            trials.append(trial)
    return trials


def _from_first(trials: list[Trial], where: str) -> list[Trial]:
    """The trials with their starts counted from the first one's."""
    starts = [float(trial.start or 0.0) for trial in trials]
    for trial, start in zip(trials, starts, strict=True):
        if not np.isfinite(start):
            raise UserError("missing value", where=f"{where}, trial '{trial.name}', column of 'start'",
                            received=f"{start}", allowed="when the trial began")  # fmt: skip
    return [replace(trial, start=start - min(starts)) for trial, start in zip(trials, starts, strict=True)]


def _raw(table: Table, name: str, column: str | float, length: int | None) -> tuple[np.ndarray, float | None]:
    """A signal's column as numbers, before gain and unit; of dates s from the first, and when that was, else None."""
    if not isinstance(column, str):
        if isinstance(column, bool) or not isinstance(column, int | float) or length is None:
            raise UserError(
                "no column", where=f"columns.{name}", received=repr(column), allowed="the name of a column, in quotes"
            )
        return np.full(length, float(column)), None
    picked, where = table.pick(column, f"columns.{name}"), f"{table.path}, column '{column}'"
    dated = since_first(picked) if name in _CLOCKS else None
    fix = "write times as numbers, or as dates such as 2026-05-01T12:00:00.25" if name in _CLOCKS else ""
    values, first = dated or (numbers(picked, where, fix), None)
    if length is not None and len(values) != length:
        raise UserError(
            "columns of different length",
            where=where,
            received=f"{len(values)} long",
            allowed=f"{length}, as time",
            fix="check which variables belong together",
        )
    if not len(values):
        raise UserError("empty file", where=str(table.path), received="without data rows", allowed="at least 10 rows")
    return values, first


def _groups(table: Table, trial_column: str | None, length: int) -> list[tuple[str, np.ndarray]]:
    """Return (trial name, row indices from 0) in order of first appearance."""
    if trial_column is None:
        end = ending(table.path) or table.path.suffix
        return [(table.path.name[: -len(end)], np.arange(length))]
    values = table.pick(trial_column, "trial_column")
    if len(values) != length:
        raise UserError(
            "columns of different length", where=f"{table.path}, column '{trial_column}'", allowed=f"{length}, as time"
        )
    return _split(values, f"{table.path}, column '{trial_column}'")


def _split(values: np.ndarray, where: str) -> list[tuple[str, np.ndarray]]:
    """Label of each trial and its rows, from the column that names the trials."""
    import pandas as pd

    codes, present = pd.factorize(values)
    if len(bad := np.flatnonzero(codes < 0)):
        raise UserError(
            "missing value",
            where=f"{where}, data row {bad[0] + 1}",
            received="empty or NaN",
            allowed="the name or number of the trial",
        )
    labels: dict[str, int] = {}
    merged = np.array([labels.setdefault(_label(value), len(labels)) for value in present.tolist()], dtype=np.intp)
    trial = merged[codes]
    order = np.argsort(trial, kind="stable")
    ends = np.cumsum(np.bincount(trial, minlength=len(labels)))[:-1]
    return list(zip(labels, np.split(order, ends), strict=True))


def _label(value: Any) -> str:
    """A trial's name: 2 also where its numbers are written as 2.0."""
    name = str(value).strip()
    number = float(name.replace(",", ".")) if re.fullmatch(r"-?\d+[.,]\d*(?:[eE][-+]?\d+)?", name) else 0.5
    return str(int(number)) if number.is_integer() else name
