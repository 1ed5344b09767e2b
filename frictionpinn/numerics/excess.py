"""The error of models beyond the noise that no model can explain, with intervals.

A signal's error beyond the noise is e = sqrt(max(0, mean r^2 - sigma^2)), r its residuals and sigma its noise: where
noise is most of the error, the error itself hardly moves. The 95 % interval of e is that of a circular block bootstrap
(Politis and Romano 1992): blocks of several correlation times of the residual, drawn over all trials, the same for all
models that are compared; sigma is drawn along with its own standard error.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .smoothing import difference_sigma

NEIGHBOURS, RESIDUAL = "differences of neighbouring samples", "residual of the model"
MOVES = 1.15  # times the residual: differences above it show motion between samples, not noise
APART = 1.5  # factor from which both levels are told: the noise is correlated in time, or the model is far off
# Standard error of a level, relative to it, times sqrt(samples): of a median of differences (simulated), of an rms.
STATISTICAL = {NEIGHBOURS: 1.6, RESIDUAL: 0.71}
DRAWS = 1000  # of the bootstrap: 25 beyond either end of a 95 % interval
TIMES = 3.0  # correlation times of the residual in a block: one block then tells little of the next
SMOOTH = 5  # lags over which an autocorrelation is averaged: single ones are noise
FEW = 10  # samples in a block at least, where the residual is white
MANY = 6.0  # blocks in all trials together at least: fewer make no distribution
FADED = 0.05  # autocorrelation below which a residual counts as uncorrelated


def rms(own: Sequence[np.ndarray]) -> float:
    """Root mean square over all trials, NaN left out; NaN where nothing else is there."""
    r = np.concatenate(own)
    return float(np.sqrt(np.mean(r[~np.isnan(r)] ** 2))) if not np.isnan(r).all() else np.nan


@dataclass(frozen=True)
class Level:
    """Noise of a signal.

    Attributes:
        sigma: standard deviation, in the signal's unit.
        error: its standard error relative to it.
        source: NEIGHBOURS or RESIDUAL.
        other: what the other of the two says, where it is far from sigma.
    """

    sigma: float
    error: float
    source: str
    other: float | None = None


def noise_level(measured: Sequence[tuple[np.ndarray, np.ndarray]], residual: float) -> Level:
    """Noise of one signal from pairs (t, y) of shape (n,), NaN where missing, and the level of its residual.

    A model that is far off leaves a residual much larger than the noise; what a sample differs by from its neighbours,
    cubics cancelled, does not depend on any model. The residual counts only where the signal itself moves faster than
    it was sampled. Steps of an encoder, values taken again and again, are noise of a twelfth of their square.
    """
    y = np.concatenate([np.zeros(0), *(y[~np.isnan(y)] for _, y in measured)])
    values = np.unique(y)
    step = float(np.median(np.diff(values))) if 1 < len(values) < len(y) / 2 else 0.0
    near = max(difference_sigma(measured), step / np.sqrt(12))
    source = NEIGHBOURS if 0 < near < MOVES * residual else RESIDUAL
    own, other = (near, residual) if source == NEIGHBOURS else (residual, near)
    return Level(own, STATISTICAL[source] / np.sqrt(max(len(y), 1)), source, if_apart(own, other))


def if_apart(own: float, other: float) -> float | None:
    return other if other > 0 and not 1 / APART < own / other < APART else None


@dataclass(frozen=True)
class Excess:
    """Squared errors beyond the noise of k models, the declared one first, on the same samples.

    Attributes:
        squared: max(0, mean r^2 - sigma^2), shape (k,).
        drawn: the same of every bootstrap draw, the noise level drawn along, shape (draws, k).
        fixed: the same at the noise level as told, shape (draws, k).
        block_s: length of a block, s.
    """

    squared: np.ndarray
    drawn: np.ndarray
    fixed: np.ndarray
    block_s: float

    @classmethod
    def of(cls, t: Sequence[np.ndarray], residuals: Sequence[Sequence[np.ndarray]], level: Level) -> Excess:
        """From the residuals of each model on each trial, shape (n,), NaN where missing; t the trials' times, s."""
        block, floor = block_length(t, residuals[0]), level.sigma**2
        squares = [np.stack(own, axis=1) ** 2 for own in zip(*residuals, strict=True)]
        means = block_means(squares, [max(1, round(block / max(_interval([x]), 1e-300))) for x in t])
        luck = 1 + level.error * np.random.default_rng(1).standard_normal((len(means), 1))
        mean = np.nanmean(np.concatenate(squares), axis=0)
        squared, drawn, fixed = (np.maximum(x, 0.0) for x in (mean - floor, means - floor * luck**2, means - floor))
        return cls(squared, drawn, fixed, block)

    def told(self, k: int) -> dict[str, Any]:
        """Error beyond the noise of model k in the signal's unit, with its 95 % interval."""
        return {"value": float(np.sqrt(self.squared[k])), "ci95": _ci95(np.sqrt(self.drawn[:, k]))}

    @property
    def drop_over_error(self) -> float:
        """Drop of the error beyond the noise from the first model to the last, over its standard error."""
        drop = float(np.sqrt(self.squared[0]) - np.sqrt(self.squared[-1]))
        spread = float(np.std(np.sqrt(self.drawn[:, 0]) - np.sqrt(self.drawn[:, -1])))
        return drop / spread if spread > 0 else 0.0

    def share(self, k: int) -> dict[str, Any]:
        """What model k takes off beyond model k - 1, relative to the first's squared excess; k = 0: what is left."""
        if self.squared[0] <= 0:
            return {"value": None, "ci95": [None, None]}
        drawn = self.fixed[self.fixed[:, 0] > 0]
        value, draws = (x[..., -1] if k == 0 else x[..., k - 1] - x[..., k] for x in (self.squared, drawn))
        return {"value": float(value / self.squared[0]), "ci95": _ci95(draws / drawn[:, 0])}


def block_length(t: Sequence[np.ndarray], residuals: Sequence[np.ndarray]) -> float:
    """Length of a block, s: long against the residual's correlation time, and short against the recording.

    The correlation time is that after which the autocorrelation has faded, not its integral: of a slow error in much
    white noise that is short.

    Args:
        t, residuals: of each trial, shape (n,), NaN where missing.
    """
    length = max(len(r) for r in residuals)
    products = np.zeros(length)
    for r in residuals:
        spectrum = np.abs(np.fft.rfft(np.nan_to_num(r), 2 * len(r))) ** 2
        products[: len(r)] += np.fft.irfft(spectrum)[: len(r)]
    correlated = 0
    if products[0] > 0 and length > SMOOTH:
        rho = np.convolve(products[1:] / products[0], np.ones(SMOOTH) / SMOOTH, "valid")
        faded = np.flatnonzero(rho < FADED)
        correlated = 1 + int(faded[0]) if len(faded) else length
    return min(max(TIMES * correlated, FEW) * _interval(t), sum(float(x[-1] - x[0]) for x in t) / MANY)


def block_means(squares: Sequence[np.ndarray], spans: Sequence[int]) -> np.ndarray:
    """Means over samples of blocks drawn with replacement, shape (DRAWS, k).

    Args:
        squares: of each trial, shape (n, k), NaN where missing: k models on the same samples.
        spans: samples in a block of each trial.
    """
    sums = []  # over every block of a trial, which goes on at its start: of the squares, and of the samples there are
    for y, span in zip(squares, spans, strict=True):
        size = min(max(span, 1), len(y))
        both = np.stack([np.nan_to_num(y), ~np.isnan(y)])
        total = np.cumsum(np.concatenate([np.zeros_like(both[:, :1]), both, both[:, : size - 1]], axis=1), axis=1)
        sums.append(total[:, size:] - total[:, :-size])
    S, N = np.concatenate(sums, axis=1)
    blocks = max(1, round(len(S) / float(np.mean(spans))))
    at = np.random.default_rng(0).integers(len(S), size=(DRAWS, blocks))
    return S[at].sum(axis=1) / np.maximum(N[at].sum(axis=1), 1.0)


def _interval(t: Sequence[np.ndarray]) -> float:
    return float(np.median(np.concatenate([np.diff(x) for x in t])))


def _ci95(values: np.ndarray) -> list[float]:
    return [float(x) for x in np.quantile(values, [0.025, 0.975])]
