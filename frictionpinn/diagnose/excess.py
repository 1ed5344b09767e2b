"""Error of a model beyond the noise, with intervals: where noise is most of a signal's error, the error hardly moves.

e = sqrt(max(0, mean r^2 - sigma^2)), r the residuals of a signal and sigma its noise. Its 95 % interval is that of a
circular block bootstrap (Politis and Romano 1992): blocks of several correlation times of the residual, drawn over all
trials, the same for all models that are compared; sigma is drawn along with its own standard error.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

DRAWS = 1000
TIMES = 3.0  # correlation times of the residual in a block
SMOOTH = 5  # lags over which an autocorrelation is averaged: single ones are noise
FEW = 10  # samples in a block at least
MANY = 6.0  # blocks in all trials together at least: fewer make no distribution
FADED = 0.05  # autocorrelation below which a residual counts as uncorrelated


@dataclass(frozen=True)
class Level:
    """Noise of a signal: standard deviation, its standard error relative to it, and where it is known from."""

    sigma: float
    error: float
    source: str
    other: float | None = None


def correlation_time(t: Sequence[np.ndarray], residuals: Sequence[np.ndarray]) -> float:
    """Time after which the autocorrelation has faded, s; shape (n,) of each trial, NaN where missing.

    Not its integral: of a slow error in much white noise that is short.
    """
    length = max(len(r) for r in residuals)
    products = np.zeros(length)
    for r in residuals:
        own = np.nan_to_num(r)
        spectrum = np.abs(np.fft.rfft(own, 2 * len(own))) ** 2
        products[: len(own)] += np.fft.irfft(spectrum)[: len(own)]
    if products[0] <= 0 or length <= SMOOTH:
        return 0.0
    rho = np.convolve(products[1:] / products[0], np.ones(SMOOTH) / SMOOTH, "valid")
    faded = np.flatnonzero(rho < FADED)
    return _interval(t) * (1 + int(faded[0]) if len(faded) else length)


def block_length(t: Sequence[np.ndarray], residuals: Sequence[np.ndarray]) -> float:
    """Length of a block, s: long against the residual's correlation time, and short against the recording."""
    total = sum(float(x[-1] - x[0]) for x in t)
    return min(max(TIMES * correlation_time(t, residuals), FEW * _interval(t)), total / MANY)


def _interval(t: Sequence[np.ndarray]) -> float:
    return float(np.median(np.concatenate([np.diff(x) for x in t])))


def block_means(squares: Sequence[np.ndarray], spans: Sequence[int], draws: int = DRAWS, seed: int = 0) -> np.ndarray:
    """Means over samples of blocks drawn with replacement, shape (draws, k).

    Args:
        squares: of each trial, shape (n, k), NaN where missing: k models on the same samples.
        spans: samples in a block of each trial.
    """
    sums: list[np.ndarray] = []
    counts: list[np.ndarray] = []
    for y, span in zip(squares, spans, strict=True):
        size = min(max(span, 1), len(y))
        for values, kept in ((np.nan_to_num(y), sums), ((~np.isnan(y)).astype(float), counts)):
            total = np.cumsum(np.concatenate([np.zeros((1, y.shape[1])), values, values[: size - 1]]), axis=0)
            kept.append(total[size:] - total[:-size])
    S, N = np.concatenate(sums), np.concatenate(counts)
    blocks = max(1, round(len(S) / float(np.mean(spans))))
    at = np.random.default_rng(seed).integers(len(S), size=(draws, blocks))
    return S[at].sum(axis=1) / np.maximum(N[at].sum(axis=1), 1.0)


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
        block = block_length(t, residuals[0])
        squares = [np.stack(own, axis=1) ** 2 for own in zip(*residuals, strict=True)]
        spans = [max(1, round(block / max(_interval([x]), 1e-300))) for x in t]
        means, floor = block_means(squares, spans), level.sigma**2
        luck = 1 + level.error * np.random.default_rng(1).standard_normal((len(means), 1))
        mean = np.nanmean(np.concatenate(squares), axis=0)
        return cls(np.maximum(mean - floor, 0.0), np.maximum(means - floor * luck**2, 0.0),
                   np.maximum(means - floor, 0.0), block)  # fmt: skip

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


def _ci95(values: np.ndarray) -> list[float]:
    return [float(x) for x in np.quantile(values, [0.025, 0.975])]
