"""How much noise a signal has: from what its neighbouring samples differ by, else from the model's residual."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..identify.trial import TrialModel
from ..numerics.smoothing import difference_sigma
from .bench import Bench
from .excess import Level

NEIGHBOURS, RESIDUAL = "differences of neighbouring samples", "residual of the model"
MOVES = 1.15  # times the residual: differences above it show motion between samples, not noise
APART = 1.5  # factor from which both levels are told: the noise is correlated in time, or the model is far off
ORDER = 4
STATISTICAL = {NEIGHBOURS: 1.6, RESIDUAL: 0.71}  # standard error of a level, relative to it, times sqrt(samples)


def levels(bench: Bench, sigmas: Mapping[str, float]) -> dict[str, Level]:
    """Noise of every signal, over all trials.

    A model that is far off leaves a residual much larger than the noise; what a sample differs by from its neighbours,
    cubics cancelled, does not depend on any model. The residual counts only where the signal itself moves faster than
    it was sampled. Steps of an encoder are noise of a twelfth of their square.

    Args:
        sigmas: levels of the model's residual with everything explained that a candidate or a variable can, SI units.
    """
    trials = [*bench.problem.trials, *(bench.checked.trials if bench.checked is not None else ())]
    return {name: level(_measured(trials, name), sigma) for name, sigma in sigmas.items()}


def level(measured: Sequence[tuple[np.ndarray, np.ndarray]], residual: float) -> Level:
    """Noise of one signal from pairs (t, y) of shape (n,), NaN where missing, and the level of its residual."""
    measured = [(t[~np.isnan(y)], y[~np.isnan(y)]) for t, y in measured]
    count = max(sum(len(y) for _, y in measured), 1)
    near = max(difference_sigma(measured, ORDER), _step(measured) / np.sqrt(12)) if measured else 0.0
    source = NEIGHBOURS if 0 < near < MOVES * residual else RESIDUAL
    own, other = (near, residual) if source == NEIGHBOURS else (residual, near)
    far = other > 0 and not 1 / APART < own / other < APART
    return Level(own, STATISTICAL[source] / np.sqrt(count), source, other if far else None)


def _step(measured: Sequence[tuple[np.ndarray, np.ndarray]]) -> float:
    """Resolution of a signal that takes few values again and again; 0 where it does not."""
    values = np.concatenate([y for _, y in measured])
    unique = np.unique(values)
    return float(np.median(np.diff(unique))) if 1 < len(unique) < len(values) / 2 else 0.0


def _measured(trials: Sequence[TrialModel], name: str) -> list[tuple[np.ndarray, np.ndarray]]:
    found = []
    for model in trials:
        rows = dict(zip(model.outputs, model.y, strict=True))
        for item in model.inputs:
            rows |= dict(zip(item.names, item.y, strict=True))
        if name in rows:
            found.append((model.t, rows[name]))
    return found
