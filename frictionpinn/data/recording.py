"""Trials and recordings: what a mechanism did, as arrays in SI units."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import UserError, nearest, unwritten
from ..numerics.session import Session
from ..show import Shown, Table, folder_at, readable_unit

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SHOWN_TRIALS = 16  # in the legend of a figure


@dataclass(frozen=True, repr=False)
class Trial:
    """One uninterrupted run of a mechanism.

    Attributes:
        name: what identifies it among its recording's trials ("1", "0.25Hz_30lb_0.5in").
        t: time, s, shape (n,), strictly increasing, not necessarily uniform.
        signals: name -> array of shape (n,), SI units.
        truth: noise-free signals and forces of simulated data, for scoring alone; empty for measured data.
        start: time of the session at the first sample, s; None: its recording tells, see :class:`Recording`.
        number: place among the trials of the session, from 1; None: its recording tells.
        notes: what was done to it when it was read, a sentence each.
        derived: signals that were differentiated from another of it: they are no measurements of their own.
    """

    name: str
    t: np.ndarray
    signals: dict[str, np.ndarray]
    truth: dict[str, np.ndarray] = field(default_factory=dict)
    start: float | None = None
    number: int | None = None
    notes: tuple[str, ...] = ()
    derived: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.t)

    def __repr__(self) -> str:
        span = f"{self.t[0]:.4g} to {self.t[-1]:.4g} s" if len(self) else "empty"
        return f"Trial({self.name}: {len(self)} samples, {span}; {', '.join(self.signals)})"

    @property
    def session(self) -> Session:
        """Place in the session; alone it is a session of its own, whose time is that of the trial."""
        offset = 0.0 if self.start is None else self.start - float(self.t[0])
        return Session(offset, self.number or 1)

    @property
    def end(self) -> float | None:
        """Time of the session at the last sample, s; None where ``start`` is."""
        return self.start_at(-1)

    def start_at(self, sample: int) -> float | None:
        """Time of the session at a sample, s; None where ``start`` is."""
        return None if self.start is None else self.start + float(self.t[sample] - self.t[0])

    def with_signals(self, **signals: np.ndarray) -> Trial:
        """Return a copy in which the given signals are added or replaced."""
        return replace(self, signals={**self.signals, **signals})

    def part(self, samples: slice, name: str | None = None) -> Trial:
        """Return some of the samples, at their place in the session, as a trial of the same or another name."""
        return replace(
            self,
            name=self.name if name is None else name,
            t=self.t[samples],
            signals={key: values[samples] for key, values in self.signals.items()},
            truth={key: values[samples] for key, values in self.truth.items()},
            start=self.start_at(samples.indices(len(self))[0]),
        )


@dataclass(frozen=True, repr=False)
class Recording(Shown):
    """Several trials of one mechanism, recorded in one session.

    Trials without a place in the session get one here, and keep it in every selection. Where no two of them overlap in
    time their clocks run on from trial to trial: the time of the session is theirs, less that at which the first began.
    Else each is taken to begin where the one before it ended: pauses are not known.

    Attributes:
        trials: in the order of the file.
        units: signal name -> SI unit as text ("m/s").
        source: where it came from, for reports.
        checksum: sha256 of the data, for ``result.json``.
        notes: how it was read: columns used, ignored and derived.
    """

    trials: tuple[Trial, ...]
    units: dict[str, str]
    source: str = ""
    checksum: str = ""
    notes: tuple[str, ...] = ()

    def __post_init__(self):
        object.__setattr__(self, "trials", tuple(_placed(self.trials)))

    @property
    def names(self) -> list[str]:
        """Names of the trials."""
        return [trial.name for trial in self.trials]

    def select(self, names: Iterable[str]) -> Recording:
        """Return the recording that holds only the named trials, in their original order.

        Raises:
            UserError: a name that no trial has.
        """
        if isinstance(names, str):
            raise UserError("not a list of names", where="select", received=repr(names), allowed=f"[{names!r}]")
        wanted = {str(name) for name in names}
        for name in sorted(wanted.difference(self.names)):
            raise UserError("no such trial", where="select", received=repr(name), allowed=", ".join(self.names),
                            fix=nearest(name, self.names) or "use the names of the trials")  # fmt: skip
        return replace(self, trials=tuple(trial for trial in self.trials if trial.name in wanted))

    def cut(self, length_s: float | None, longest: int, least: int) -> list[Trial]:
        """Every trial in equal windows of about ``length_s``; None: of about half of ``longest`` where it is longer.

        Args:
            length_s: length of a window, s.
            longest: samples of a trial that is left whole.
            least: samples that a window must have.

        Raises:
            UserError: a window with fewer.
        """
        windows = []
        for trial in self.trials:
            count = 1 if len(trial) <= longest else -(-2 * len(trial) // longest)
            if length_s:
                count = max(round((trial.t[-1] - trial.t[0]) / length_s), 1)
            edges = np.linspace(0, len(trial), count + 1).round().astype(int).tolist()
            for k, (first, end) in enumerate(pairwise(edges)):
                if end - first < least:
                    raise UserError("window too short", where="windows", received=f"{end - first} samples",
                                    allowed=f"at least {least} samples", fix="lengthen the windows")  # fmt: skip
                windows.append(trial.part(slice(first, end), trial.name if count == 1 else f"{trial.name}[{k}]"))
        return windows

    def spread(self, share: float, windows: Sequence[Trial]) -> Recording:
        """Return about this share of the ``windows`` that it was cut into, spread evenly over the session: of as many
        equal parts one window each, drawn at random so that no cycle of the trials is met in step, always the same."""
        edges = np.linspace(0, len(windows), max(round(share * len(windows)), 1) + 1).round().astype(int)
        generator = np.random.default_rng(0)
        drawn = [windows[generator.integers(first, end)] for first, end in pairwise(edges) if end > first]
        return replace(self, trials=tuple(drawn))

    def __len__(self) -> int:
        return sum(len(trial) for trial in self.trials)

    # how it shows itself ---------------------------------------------------------------------------------------
    def tables(self) -> list[Table]:
        """Its trials, and the range of every signal over all of them."""
        trials = []
        for trial in self.trials:
            length = float(trial.t[-1] - trial.t[0]) if len(trial) else 0.0
            trials.append((trial.name, len(trial), length, (len(trial) - 1) / length if length else None))
        signals = []
        for name in dict.fromkeys(name for trial in self.trials for name in trial.signals):
            values = np.concatenate([trial.signals[name] for trial in self.trials if name in trial.signals])
            ends = (float(values.min()), float(values.max())) if len(values) else (None, None)
            signals.append((name, readable_unit(self.units.get(name, "")), *ends))
        count = f"{len(self.trials)} trial{'s' if len(self.trials) != 1 else ''}"
        title = f"{self.source or 'recording'}: {len(self)} samples of {count}"
        notes = (*self.notes, *(note for trial in self.trials for note in trial.notes))
        return [
            Table(("trial", "samples", "length (s)", "rate (Hz)"), tuple(trials), title, notes),
            Table(("signal", "unit", "smallest", "largest"), tuple(signals)),
        ]

    def figures(self) -> dict[str, Figure]:
        """Every signal over the time of its trial, a line for each trial."""
        from matplotlib.figure import Figure

        names = list(dict.fromkeys(name for trial in self.trials for name in trial.signals))
        figure = Figure(figsize=(8, 0.8 + 1.3 * max(len(names), 1)), layout="constrained")
        rows = figure.subplots(max(len(names), 1), 1, sharex=True, squeeze=False)[:, 0]
        for axes, name in zip(rows, names, strict=False):
            for trial in self.trials:
                if name in trial.signals:
                    axes.plot(trial.t - trial.t[0], trial.signals[name], lw=0.9, label=trial.name)
            unit = readable_unit(self.units.get(name, ""))
            axes.set_ylabel(f"{name} ({unit})" if unit else name)
            axes.margins(x=0.01)
        rows[-1].set_xlabel("time in the trial (s)")
        if 1 < len(self.trials) <= SHOWN_TRIALS:
            figure.legend(*rows[0].get_legend_handles_labels(), loc="outside upper center", ncols=8, frameon=False,
                          title="trial", fontsize=8)  # fmt: skip
        return {"signals": figure}

    def to_dict(self) -> dict[str, Any]:
        """Source, units and, by trial, time and signals as lists."""
        trials = {trial.name: {"t": trial.t.tolist()} | {n: y.tolist() for n, y in trial.signals.items()}
                  for trial in self.trials}  # fmt: skip
        return {"source": self.source, "sha256": self.checksum, "units": dict(self.units), "trials": trials}

    def save(self, path: str | Path) -> Path:
        """Write a table with the columns trial, start, t and the signals, SI units; ``frictionpinn.read`` reads it.

        Args:
            path: ending in .csv or .parquet.

        Raises:
            UserError: no trials, another ending, or a place that cannot be written.
        """
        import pandas as pd

        path = Path(path)
        if path.suffix not in (".csv", ".parquet"):
            raise UserError("unknown file format", where="path", received=str(path), allowed=".csv, .parquet")
        if not self.trials:
            raise UserError("nothing to save", where="save", received="a recording without trials")
        parts = [{"trial": trial.name, "start": trial.start, "t": trial.t, **trial.signals} for trial in self.trials]
        table = pd.concat([pd.DataFrame(part) for part in parts], ignore_index=True)
        folder_at(path.parent)
        try:
            table.to_csv(path, index=False) if path.suffix == ".csv" else table.to_parquet(path, index=False)
        except OSError as error:
            raise unwritten(error, path, "name another file") from error
        return path


def _placed(trials: Sequence[Trial]) -> list[Trial]:
    """The trials, each with its start and number."""
    running = _run_on(trials)
    first = min((float(trial.t[0]) for trial in trials), default=0.0)
    made: list[Trial] = []
    for trial in trials:
        start, number = trial.start, trial.number
        if start is None:
            before = made[-1].end if made else 0.0
            start = float(trial.t[0]) - first if running else before
        if number is None:
            number = (made[-1].number or 0) + 1 if made else 1
        made.append(replace(trial, start=start, number=number))
    return made


def _run_on(trials: Sequence[Trial]) -> bool:
    """Whether one clock ran through the trials, whatever their order: none has a place yet, and no two overlap."""
    spans = sorted((float(trial.t[0]), float(trial.t[-1])) for trial in trials)
    return all(trial.start is None for trial in trials) and all(a[1] <= b[0] for a, b in pairwise(spans))
