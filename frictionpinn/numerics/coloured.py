"""The colour of measurement noise: an autoregression of each signal's residuals, and the filter that whitens them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import solve_toeplitz
from scipy.signal import lfilter

MOST = 8  # order of the autoregression tried at most
WHITE = 0.05  # autocorrelation that is left alone: it changes a statistic by less than a tenth


@dataclass(frozen=True)
class Noise:
    """Noise of each signal: e_t = sum_k a_k e_{t-k} + scale * white; a signal that is not named has white unit noise.

    Attributes:
        coefficients: signal -> a, shape (order,); order 0 is white noise.
        scale: signal -> innovation's standard deviation, in units of the noise level that weighted the residuals.
        level: signal -> the noise's standard deviation, in the same units.
    """

    coefficients: dict[str, np.ndarray] = field(default_factory=dict)
    scale: dict[str, float] = field(default_factory=dict)
    level: dict[str, float] = field(default_factory=dict)

    @property
    def coloured(self) -> tuple[str, ...]:
        """Signals whose noise is correlated in time."""
        return tuple(name for name, a in self.coefficients.items() if len(a))

    def scaled(self, signals: Sequence[str], values: np.ndarray) -> np.ndarray:
        """Values, shape (signals, n, ...), in units of each signal's noise."""
        levels = np.array([self.level.get(name, 1.0) for name in signals])
        return values / levels.reshape(-1, *[1] * (values.ndim - 1))

    def spread(self, signals: Sequence[str], values: np.ndarray) -> np.ndarray:
        """W with W'W = C'RC, C the scaled values, shape (signals, n, ...), and R the autocorrelation of the noise.

        R is that of an autoregression driven by white noise: C is passed through it backwards in time.
        """
        result = values.copy()
        for k, name in enumerate(signals):
            a = self.coefficients.get(name, np.zeros(0))
            if len(a) and values[k].size:
                gain = self.scale[name] / self.level[name]
                denominator = np.concatenate([[1.0], -a])
                result[k] = gain * lfilter([1.0], denominator, values[k][::-1], axis=0)[::-1]
        return result


def fit_noise(residuals: Sequence[Mapping[str, np.ndarray]], freedom: float) -> Noise:
    """Autoregressions by Yule and Walker, the order of each by Akaike's criterion.

    Args:
        residuals: of each trial by signal, shape (n,), 0 where nothing was measured: what is left when everything that
            a model could explain is taken out.
        freedom: degrees of freedom left, over the number of samples.

    Source: Box, Jenkins and Reinsel, Time Series Analysis (1994), chapters 6 and 7.
    """
    coefficients, scale, level = {}, {}, {}
    for name in dict.fromkeys(name for signals in residuals for name in signals):
        own = [signals[name] for signals in residuals if name in signals]
        count = max(sum(int(np.count_nonzero(e)) for e in own), 1)
        gamma = np.array([sum(float(e[lag:] @ e[: len(e) - lag]) for e in own) / count for lag in range(MOST + 1)])
        a = _autoregression(gamma, count) if gamma[0] > 0 else np.zeros(0)
        innovation = gamma[0] - float(a @ gamma[1 : len(a) + 1])
        coefficients[name], scale[name] = a, float(np.sqrt(max(innovation, 1e-12) / freedom))
        level[name] = float(np.sqrt(max(gamma[0], 1e-12) / freedom))
    return Noise(coefficients, scale, level)


def _autoregression(gamma: np.ndarray, count: int) -> np.ndarray:
    """Coefficients from the autocovariances at lags 0, 1, ... of so many samples; none where the noise is white."""
    # A filter or a slow sensor shows from one sample to the next, by more than four standard errors; what was taken out
    # of white noise leaves it a little negative.
    if gamma[1] < max(WHITE, 4 / np.sqrt(count)) * gamma[0]:
        return np.zeros(0)
    best, least = np.zeros(0), count * np.log(gamma[0])
    for order in range(1, len(gamma)):
        a = solve_toeplitz(gamma[:order], gamma[1 : order + 1])
        variance = gamma[0] - float(a @ gamma[1 : order + 1])
        value = count * np.log(max(variance, 1e-300)) + 2 * order
        if value < least:
            best, least = a, value
    return best


def outliers(residuals: Mapping[str, Mapping[str, np.ndarray]]) -> float:
    """Largest share among the signals that lone residuals beyond five robust standard deviations have in the sum of
    squares.

    Args:
        residuals: trial -> signal -> samples.
    """
    shares = [0.0]
    for name in {name for signals in residuals.values() for name in signals}:
        rows = [signals[name] for signals in residuals.values() if name in signals]
        spread = 1.4826 * float(np.nanmedian(np.abs(np.concatenate(rows))))
        total = sum(float(np.nansum(r**2)) for r in rows)
        shares.append(sum(float(np.sum(r[lone(r, spread)] ** 2)) for r in rows) / max(total, 1e-300))
    return max(shares)


def lone(residuals: np.ndarray, sigma: float) -> np.ndarray:
    """Which residuals, shape (n,), lie beyond five standard deviations with neighbours within three.

    What a model lacks shows over several samples.
    """
    z = np.pad(np.abs(np.nan_to_num(residuals)) / max(sigma, 1e-300), 1)
    return (z[1:-1] > 5) & (z[:-2] < 3) & (z[2:] < 3)
