"""What a recording must satisfy before anything is learned from it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Mapping

import numpy as np

from frictionpinn.data.recording import Recording, Trial
from frictionpinn.data.thresholds import LARGEST, MIN_SAMPLES
from frictionpinn.errors import UserError


def check_trial(
    trial: Trial,
    where: str,
    required: Iterable[str] = (),
    *,
    rows: np.ndarray | None = None,
    columns: Mapping[str, str] | None = None,
    split: str = "give trial_column, or split the file",
) -> None:
    """Check one trial: enough samples, finite values, and time that increases.

    Args:
        trial: the trial, in SI units.
        where: the file that errors shall name.
        required: signals that must be present.
        rows: row of the file that each sample came from, shape (n,), counted from 1 without the header.
        columns: signal name -> column of the file, for errors.
        split: advice where time goes backwards.

    Raises:
        UserError: the first thing found wrong.
    """
    columns = columns or {}
    rows = np.arange(1, len(trial) + 1) if rows is None else rows
    _check_present(trial, where, required)
    if len(trial) < MIN_SAMPLES:
        raise UserError(
            "too few samples",
            where=f"{where}, trial '{trial.name}'",
            received=f"{len(trial)} samples long",
            allowed=f"at least {MIN_SAMPLES}",
            fix="record longer, or leave this trial out",
        )
    table = {columns.get(n, n): y for n, y in {"t": trial.t, **trial.signals}.items()}
    _check_finite(table, rows, where, trial.name)
    _check_time(trial, rows, f"{where}, column '{columns.get('t', 't')}'", split)


def check_recording(
    recording: Recording, where: str, required: Iterable[str], allow_constant: Collection[str] = ()
) -> None:
    """Check that trials are distinct and that no required signal is constant over the whole recording.

    Args:
        recording: the recording, in SI units.
        where: the file or files that errors shall name.
        required: signals to look at.
        allow_constant: signals that may be constant, such as a normal force.

    Raises:
        UserError: a trial name occurs twice, or a signal never changes.
    """
    for name, count in Counter(recording.names).items():
        if count > 1:
            raise UserError(
                "two trials with one name",
                where=where,
                received=repr(name),
                allowed="names that differ",
                fix="rename one of the files, or number the trials differently",
            )
    for signal in required:
        if signal in allow_constant:
            continue
        parts = [trial.signals[signal] for trial in recording.trials if signal in trial.signals]
        if parts and min(part.min() for part in parts) == max(part.max() for part in parts):
            raise UserError(
                "signal never changes",
                where=f"{where}, signal '{signal}'",
                received=f"{parts[0][0]:g} in every row",
                allowed="values that vary",
                fix=f"check which column '{signal}' reads, or leave it out: a number in place of a column stands for a "
                f"constant, data.columns={{..., {signal}: {parts[0][0]:g}}}",
            )


def check_sizes(recording: Recording) -> None:
    """Raise :class:`UserError` for a value, SI units, whose powers are no numbers any more."""
    for trial in recording.trials:
        for name, values in trial.signals.items():
            largest = float(np.nanmax(np.abs(values), initial=0.0))
            if largest > LARGEST:
                raise UserError("value that no mechanism has", where=f"{name}, trial {trial.name}",
                                received=f"{largest:.3g}", allowed=f"up to {LARGEST:g} in SI units",
                                fix="check the column and its unit")  # fmt: skip


def _check_present(trial: Trial, where: str, required: Iterable[str]) -> None:
    for signal in required:
        if signal != "t" and signal not in trial.signals:
            raise UserError(
                "missing signal",
                where=f"{where}, trial '{trial.name}'",
                received=f"without '{signal}'",
                allowed=f"present are {', '.join(trial.signals)}",
                fix=f"name the column of '{signal}' in columns",
            )


def _check_finite(table: Mapping[str, np.ndarray], rows: np.ndarray, where: str, trial: str) -> None:
    """``table`` has the samples of every column in a trial, shape (n,) each."""
    bad = {name: found for name, values in table.items() if len(found := np.flatnonzero(~np.isfinite(values)))}
    if not bad:
        return
    name, *others = bad
    first, count = table[name][bad[name][0]], len(bad[name])
    beside = ", ".join(f"'{other}' ({len(bad[other])})" for other in others)
    raise UserError(
        "missing value" if np.isnan(first) else "infinite value",
        where=f"{where}, column '{name}', data row {rows[bad[name][0]]}",
        received="empty or NaN" if np.isnan(first) else f"{first:g}",
        allowed="finite numbers",
        fix=f"fill or cut the {count} such row{'s' if count > 1 else ''} of trial '{trial}'"
        + (f", and those of {beside}" if others else ""),
    )


def _check_time(trial: Trial, rows: np.ndarray, where: str, split: str) -> None:
    bad = np.flatnonzero(np.diff(trial.t) <= 0)
    if not len(bad):
        return
    k = bad[0]
    before, after = trial.t[k], trial.t[k + 1]
    repeats = before == after
    raise UserError(
        f"time repeats at row {rows[k + 1]}" if repeats else f"time goes backwards at row {rows[k + 1]}",
        where=where,
        received=f"{after:.9g} s after {before:.9g} s",
        allowed="strictly increasing time within a trial",
        fix="drop the repeated row" if repeats else split,
    )
