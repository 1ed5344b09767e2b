"""Signals and their rates seen through one smooth window, so that they can be compared whatever their noise.

With a bump w of width T, (w * q)' = w' * q and w * q' are the same thing: no noisy signal is ever differenced, and a
jump between two samples does no harm.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.signal import oaconvolve

from ..numerics.smoothing import difference_sigma
from .recording import Recording

FEWEST = 8  # samples of a window: below, its derivative is no longer smooth
WINDOWS = 6  # of a trial's length at least
MOST_SAMPLES = 60_000  # of a recording that are looked at: seconds of computing; the others are of the same kind


@dataclass(frozen=True)
class Sampled:
    """A trial's signals on an even grid: the interval, s, and samples by name, SI units."""

    dt: float
    signals: dict[str, np.ndarray]

    @property
    def span(self) -> float:
        """Its length, s."""
        return self.dt * len(next(iter(self.signals.values())))


def sampled(recording: Recording, names: Sequence[str]) -> tuple[list[Sampled], dict[str, float]]:
    """The trials on even grids, and the noise of every signal, SI units; of a long recording the first part."""
    trials, left, sigmas = [], MOST_SAMPLES, {}
    for name in names:
        series = [(t.t[:left], t.signals[name][:left]) for t in recording.trials if name in t.signals]
        if series:
            sigmas[name] = difference_sigma(series)
    for trial in recording.trials:
        own = {name: np.asarray(trial.signals[name][:left], float) for name in names if name in trial.signals}
        t = trial.t[:left]
        if len(t) < FEWEST or not own:
            continue
        left -= len(t)
        dt = float(np.median(np.diff(t)))
        grid = np.arange(t[0], t[-1] + 0.5 * dt, dt) if np.ptp(t) / dt < 4 * len(t) else t
        trials.append(Sampled(dt, {name: np.interp(grid, t, values) for name, values in own.items()}))
        if left < FEWEST:
            break
    return trials, sigmas


@lru_cache(maxsize=256)
def bump(count: int, order: int) -> np.ndarray:
    """Weights of ``count`` samples that give the smoothed value (order 0), its rate or acceleration per sample."""
    x = (np.arange(count) + 0.5) / count
    smooth = np.sin(np.pi * x) ** 4  # three continuous derivatives at its ends
    smooth = smooth / smooth.sum()
    k = np.arange(count) - (count - 1) / 2
    if order == 0:
        return smooth
    if order == 1:
        w = np.sin(np.pi * x) ** 3 * np.cos(np.pi * x)
        return w / (w @ -k)
    w = 3 * (np.sin(np.pi * x) * np.cos(np.pi * x)) ** 2 - np.sin(np.pi * x) ** 4
    w = w - w.sum() * smooth  # of a constant and a line it makes nothing
    return w / (w @ k**2 * 0.5)


def filtered(trial: Sampled, name: str, width: float, order: int = 0) -> np.ndarray:
    """A signal through the window of that width, s, or its first or second rate."""
    weights = bump(max(round(width / trial.dt), FEWEST), order) / trial.dt**order
    return oaconvolve(trial.signals[name], weights, mode="valid")


def noise_gain(trial: Sampled, width: float, order: int = 0) -> float:
    """Variance of the filtered signal for white noise of variance 1."""
    weights = bump(max(round(width / trial.dt), FEWEST), order) / trial.dt**order
    return float(weights @ weights)


def widths(trials: Sequence[Sampled]) -> list[float]:
    """Widths to look through, s, each twice the one before."""
    shortest, longest = FEWEST * max(t.dt for t in trials), max(t.span for t in trials) / WINDOWS
    count = int(np.log2(max(longest / shortest, 1.0)))
    return [shortest * 2.0**k for k in range(count + 1)]


def clear(trials: Sequence[Sampled], name: str, sigma: float, width: float, order: int) -> tuple[float, float]:
    """Share of the filtered signal's variance that is no noise, and that variance without noise."""
    parts = [filtered(t, name, width, order) for t in trials if name in t.signals and t.span > 2 * width]
    if not parts:
        return 0.0, 0.0
    noise = float(np.mean([noise_gain(t, width, order) for t in trials])) * sigma**2
    whole = float(np.var(np.concatenate(parts)))
    return max(1 - noise / whole, 0.0) if whole > 0 else 0.0, max(whole - noise, 0.0)


def pooled(trials: Sequence[Sampled], table: Mapping[str, float]) -> list[Sampled]:
    """The trials that have every signal of a table."""
    return [t for t in trials if all(name in t.signals for name in table)]
