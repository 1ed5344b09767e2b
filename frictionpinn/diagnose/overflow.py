"""Derivatives that overflow: simulated forward, an unstable motion makes of a tiny strength more than numbers hold."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..physics.base import Parameter
from .bench import Bench
from .fit import Fit
from .linear import Rows

BEYOND = 1e8  # times the range of the signals: squares of such columns and of others have no common digits


def limit(bench: Bench, fit: Fit) -> float:
    """Largest change of a signal, in units of its noise, that a parameter of usual size may make."""
    spans = [0.0]
    for model in fit.models:
        for name, y in zip(model.outputs, model.y, strict=True):
            own = y[~np.isnan(y)]
            spans.append(float(np.ptp(own)) / fit.sigmas[name] if len(own) else 0.0)
    return BEYOND * max(1.0, *spans)


def sizes(bench: Bench, parameters: Sequence[Parameter], names: Sequence[str]) -> np.ndarray:
    """Usual sizes of parameters, shape (names,)."""
    table = {par.name: par for par in parameters}
    return np.array([bench.sizes.of(table[name]) for name in names])


def overflowing(rows: Sequence[Rows], usual: np.ndarray, most: float) -> np.ndarray:
    """Mask of the columns that are no numbers, or that exceed ``most`` at the ``usual`` sizes, shape (columns,)."""
    wild = np.zeros(len(usual), bool)
    for row in rows:
        with np.errstate(over="ignore", invalid="ignore"):
            largest = np.abs(row.change).max(axis=(0, 1), initial=0.0) * usual
        wild |= ~(largest <= most)
    return wild


def without(rows: Sequence[Rows], wild: np.ndarray) -> list[Rows]:
    """The rows with these columns, and the trials' own unknowns that are no numbers, at zero."""
    result = []
    for row in rows:
        local = np.where(np.isfinite(row.local).all(axis=(0, 1)), row.local, 0.0) if row.local.size else row.local
        result.append(replace(row, change=np.where(wild, 0.0, row.change), local=local))
    return result
