"""Signals and their rates seen through one smooth window, so that they can be compared whatever their noise.

With a bump w of width T, (w * q)' = w' * q and w * q' are the same thing: no noisy signal is ever differenced, and a
jump between two samples does no harm.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy.signal import oaconvolve

from ..numerics.placing import placed
from ..numerics.smoothing import difference_sigma
from ..physics import System
from .recording import Recording
from .thresholds import CLEAR, FEWEST, HALF, MOST_SAMPLES, WINDOWS

Motion = dict[str, np.ndarray]  # signals by name, and what is known of the window


@dataclass(frozen=True)
class Sampled:
    """A trial's signals on an even grid, SI units.

    Attributes:
        name: of the trial.
        dt: interval, s.
        signals: samples by name.
        recorded: times and samples by name, as they were before: between these an even grid averages noise away.
    """

    name: str
    dt: float
    signals: dict[str, np.ndarray]
    recorded: dict[str, tuple[np.ndarray, np.ndarray]]

    @property
    def span(self) -> float:
        """Its length, s."""
        return self.dt * len(next(iter(self.signals.values())))

    def last(self, count: int) -> Sampled:
        """Its last samples, so many."""
        recorded = {name: (t, t > t[-1] - count * self.dt, y) for name, (t, y) in self.recorded.items()}
        return replace(self, signals={name: values[len(values) - count :] for name, values in self.signals.items()},
                       recorded={name: (t[late], y[late]) for name, (t, late, y) in recorded.items()})  # fmt: skip

    def without(self, names: Collection[str]) -> Sampled:
        """It without some of its signals."""
        return replace(self, signals={name: values for name, values in self.signals.items() if name not in names})


def sampled(recording: Recording, names: Sequence[str]) -> tuple[list[Sampled], dict[str, float]]:
    """The trials on even grids, and the noise of every signal, SI units; of a long recording the first part."""
    trials, left = [], MOST_SAMPLES
    for trial in recording.trials:
        own = {name: np.asarray(trial.signals[name][:left], float) for name in names if name in trial.signals}
        t = trial.t[:left]
        if len(t) < FEWEST or not own:
            continue
        left -= len(t)
        dt = float(np.median(np.diff(t)))
        grid = np.arange(t[0], t[-1] + 0.5 * dt, dt) if np.ptp(t) / dt < 4 * len(t) else t
        even = {name: np.interp(grid, t, values) for name, values in own.items()}
        trials.append(Sampled(trial.name, dt, even, {name: (t, values) for name, values in own.items()}))
        if left < FEWEST:
            break
    return trials, noises(trials)


def noises(trials: Sequence[Sampled]) -> dict[str, float]:
    """The noise of every signal of some of the trials, SI units; none where it has one value."""
    series: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {}
    for trial in trials:
        for name in trial.signals:
            series.setdefault(name, []).append(trial.recorded[name])
    varies = {name: min(y.min() for _, y in own) < max(y.max() for _, y in own) for name, own in series.items()}
    return {name: difference_sigma(own) if varies[name] else 0.0 for name, own in series.items()}


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


def noise_gain(trial: Sampled, width: float, order: int = 0, average: float = 0.0) -> float:
    """Variance of the filtered signal for white noise of variance 1; averaged again over ``average``, s."""
    weights = bump(max(round(width / trial.dt), FEWEST), order) / trial.dt**order
    if (count := round(average / trial.dt)) > 1:
        weights = np.convolve(weights, bump(count, 0))
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


def smooth_motion(
    system: System, trials: Sequence[Sampled], sigmas: dict[str, float], wide: bool = False
) -> list[Motion]:
    """Every coordinate's position, velocity and acceleration and the inputs, through one window for all.

    Args:
        wide: through the shorter window that velocities need; what follows is to be averaged over the wide one.
    """
    whole = _width(system, trials, sigmas)
    width = _width(system, trials, sigmas, 1) if wide else whole
    motions, recorded = [], []
    for trial in trials:
        if width is None or whole is None or trial.span < 3 * (whole + wide * width):
            continue
        own: Motion = {}
        for c in system.moving:
            for k, name in enumerate(c.signals):
                source = next((j for j in range(k, -1, -1) if c.signals[j] in trial.signals), None)
                if source is not None:
                    own[name] = filtered(trial, c.signals[source], width, k - source)
                elif k < 2 and (above := [j for j in (1, 2) if j > k and c.signals[j] in trial.signals]):
                    rate = filtered(trial, c.signals[above[0]], width)
                    for _ in range(above[0] - k):
                        rate = np.cumsum(rate - (rate.mean() if above[0] == 2 else 0.0)) * trial.dt
                    own[name] = rate
            top = max((j for j in range(3) if c.signals[j] in trial.signals), default=None)
            if top is not None:  # of the noise that the acceleration brings
                gain = noise_gain(trial, width, 2 - top, whole if wide else 0.0)
                own[f"_noise_{c.name}"] = np.full(len(own[c.signals[2]]), sigmas[c.signals[top]] ** 2 * gain)
        for item in system.inputs:
            if item.name in trial.signals:
                own[item.name] = filtered(trial, item.name, width)
        own["_independent"] = np.full(len(next(iter(own.values()))), trial.dt / whole)
        own["_width"] = np.full(1, max(round(width / trial.dt), FEWEST))
        own["_average"] = np.full(1, round(whole / trial.dt) if wide else 1)
        motions.append(own)
        recorded.append(set(trial.signals))
    places = placed(system, motions, recorded, system.values)
    return [own | positions for own, positions in zip(motions, places, strict=True)]


def _width(system: System, trials: Sequence[Sampled], sigmas: dict[str, float], highest: int = 2) -> float | None:
    """The shortest window through which accelerations (``highest`` = 1: velocities) and inputs stand clear of noise, or
    the clearest."""
    best: tuple[float, float | None] = (0.0, None)
    wanted = [(c.signals[j], max(highest - j, 0)) for c in system.moving for j in (2, 1, 0) if c.signals[j] in sigmas]
    seen: dict[str, tuple[str, int]] = {}
    for name, order in wanted:  # of each coordinate the highest derivative that was measured
        seen.setdefault(next(c.name for c in system.moving if name in c.signals), (name, order))
    parts = [*seen.values(), *((i.name, 0) for i in system.inputs if i.name in sigmas)]
    for width in widths(trials):
        shares = [clear(trials, name, sigmas[name], width, order)[0] for name, order in parts if sigmas[name] > 0]
        worst = min(shares, default=1.0)
        if worst >= CLEAR:
            return width
        best = max(best, (worst, width), key=lambda item: item[0])
    return best[1] if best[0] > HALF else None
