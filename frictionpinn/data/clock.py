"""A log's clock as loggers write it: repeated and late rows, gaps, angles that wrap; mended, and said in a line."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from itertools import pairwise

import numpy as np

from ..errors import UserError
from .recording import Trial
from .thresholds import (
    BEHIND,
    BRIDGED,
    FEW,
    JITTER,
    LOOKED_AT,
    MIN_SAMPLES,
    STEPS,
    TURN_ROUNDED,
    TURN_SPREAD,
    USUAL,
)


def mended(trial: Trial, rows: np.ndarray, angles: Collection[str], where: str) -> list[tuple[Trial, np.ndarray]]:
    """The trial without the slips of its clock, in parts where it has gaps.

    Args:
        trial: as read, SI units; ``notes`` of the parts say what was done.
        rows: of the file, by sample.
        angles: signals in rad that are positions.
        where: file, for messages.
    """
    if len(trial) < 2 or not np.isfinite(trial.t).all():
        return [(trial, rows)]
    notes: list[str] = []
    trial, rows = _ordered(trial, rows, notes)
    trial, rows = _once(trial, rows, notes, where)
    if np.all(np.diff(trial.t) > 0) and len(trial) > 2:
        for name in sorted(set(angles) & set(trial.signals)):
            values, count = unwrapped(trial.signals[name])
            if count:
                trial = trial.with_signals(**{name: values})
                notes.append(f"{name} wraps {count} times: unwrapped")
        parts = _between_gaps(trial, rows, notes)
        step = np.diff(trial.t)
        usual = float(np.median(step))
        if len(parts) == 1 and np.max(np.abs(step - usual)) > JITTER * usual:
            notes.append(f"sampled unequally, {step.min():.3g} to {step.max():.3g} s: taken at the times as they are")
    else:
        parts = [(trial, rows)]
    told = tuple(f"trial {trial.name}: {note}" for note in notes)
    return [(replace(part, notes=told if k == 0 else ()), own) for k, (part, own) in enumerate(parts)]


def _taken(trial: Trial, keep: np.ndarray) -> Trial:
    return replace(trial, t=trial.t[keep], signals={name: values[keep] for name, values in trial.signals.items()})


def _ordered(trial: Trial, rows: np.ndarray, notes: list[str]) -> tuple[Trial, np.ndarray]:
    """Rows that came a little late, in their place."""
    step = np.diff(trial.t)
    back = np.flatnonzero(step < 0)
    usual = float(np.median(np.abs(step)))
    behind = np.maximum.accumulate(trial.t) - trial.t
    if not len(back) or behind.max() > BEHIND * usual or len(back) > FEW * len(step):
        return trial, rows
    order = np.argsort(trial.t, kind="stable")
    notes.append(f"{len(back)} rows came late: put in their place")
    return _taken(trial, order), rows[order]


def _once(trial: Trial, rows: np.ndarray, notes: list[str], where: str) -> tuple[Trial, np.ndarray]:
    """Every time once: of rows that repeat one the first."""
    again = np.concatenate([[False], np.diff(trial.t) == 0])
    count = int(again.sum())
    if not count:
        return trial, rows
    if count > FEW * len(again):
        raise UserError(
            f"time repeats at row {rows[np.flatnonzero(again)[0]]}",
            where=f"{where}, trial '{trial.name}'",
            received=f"{100 * count / len(again):.0f} % of the rows at a time that was there before",
            allowed=f"up to {100 * FEW:.0f} %",
            fix="write the time with more digits",
        )
    notes.append(f"{count} rows repeat a time: the first of them taken")
    return _taken(trial, ~again), rows[~again]


def unwrapped(values: np.ndarray) -> tuple[np.ndarray, int]:
    """An angle, rad, without its jumps by a turn, and how many there were."""
    jumps = np.abs(np.diff(values))
    there = jumps > np.pi
    # Jumps by a turn stand far apart from what the angle moves between two samples else.
    usual = float(np.quantile(jumps[~there], USUAL)) if np.any(~there) else np.inf
    turns = np.abs(jumps[there] - 2 * np.pi) <= TURN_SPREAD * usual + TURN_ROUNDED
    if not there.any() or not turns.all() or usual > np.pi / 2:
        return values, 0
    return np.unwrap(values), int(there.sum())


def _between_gaps(trial: Trial, rows: np.ndarray, notes: list[str]) -> list[tuple[Trial, np.ndarray]]:
    step = np.diff(trial.t)
    usual = float(np.median(step))
    wide = np.flatnonzero(step > STEPS * usual)
    wide = wide[step[wide] > _bridgeable(trial, usual)] if len(wide) else wide
    if not len(wide):
        return [(trial, rows)]
    edges = [0, *(wide + 1).tolist(), len(trial)]
    spans = [slice(a, b) for a, b in pairwise(edges) if b - a >= MIN_SAMPLES]
    if not spans:
        return [(trial, rows)]
    left = len(trial) - sum(span.stop - span.start for span in spans)
    short = f", {left} samples in parts shorter than {MIN_SAMPLES} left out" if left else ""
    into = f"{len(spans)} trials" if len(spans) > 1 else "one trial"
    notes.append(f"{len(wide)} gaps of up to {step[wide].max():.3g} s: cut there into {into}{short}")
    names = [trial.name] if len(spans) == 1 else [f"{trial.name}[{k}]" for k in range(len(spans))]
    return [(trial.part(span, name), rows[span]) for name, span in zip(names, spans, strict=True)]


def _bridgeable(trial: Trial, usual: float) -> float:
    """Length of a gap, s, over which a straight line errs by ``BRIDGED``: of the signal that changes as most do.

    A sine of angular frequency w is missed by (w gap)^2 / 8 of its amplitude, and has half of its spread after pi/3/w.
    """
    t = trial.t[:LOOKED_AT]
    grid = np.arange(t[0], t[-1], usual)[:LOOKED_AT]
    halves = []
    for values in trial.signals.values():
        y = np.interp(grid, t, values[:LOOKED_AT])
        spread = float(np.var(y))
        if not np.isfinite(spread) or spread == 0:
            continue
        lags = np.unique(np.geomspace(1, max(len(y) // 2, 2), 60).astype(int))
        changes = [float(np.mean((y[lag:] - y[:-lag]) ** 2)) for lag in lags if lag < len(y)]
        above = [lag for lag, change in zip(lags, changes, strict=False) if change >= spread]
        halves.append((above[0] if above else len(y)) * usual)
    w = np.pi / 3 / float(np.median(halves)) if halves else 1 / usual
    return float(np.sqrt(8 * BRIDGED) / w)
