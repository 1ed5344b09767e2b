"""Whether residuals are white noise, by tests that ask for no noise level, and how long they stay correlated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.stats import chi2, norm

LAGS = 20  # of the portmanteau test: ringing that a model places wrongly is as fast as the samples
SPANS = 4  # spans of the slow test: the longest given, each a fourth of the one before
OUTLYING = 5.0  # robust standard deviations at which residuals are cut: an outlier is no correlation
FEWEST = 20  # samples of a series whose correlation time is worth asking for
NORMAL_95 = 1.959964  # standard deviations to either side that hold 95 %
SIGNIFICANCE = 1e-4  # of all tests together: one recording of white noise in 10,000 is called something else


def whiteness(residuals: Mapping[str, Sequence[np.ndarray]], span: int) -> float:
    """Probability that residuals of white noise would depart from it as far, the least of these tests over all
    signals, times their number.

    With the autocorrelation rho_l of a signal of n samples: fast, n sum_{l<=20} rho_l^2, chi-squared with 20 degrees
    of freedom (Box and Pierce); slow, sqrt(n / L) sum_{l<=L} rho_l, normal, for spans L up to ``span`` samples: what a
    model lacks keeps its sign for a while.

    Args:
        residuals: signal -> residuals of every trial, NaN where nothing was measured.
        span: samples over which the slowest may be correlated.
    """
    values = [value for own in residuals.values() for value in _of_signal(own, span)]
    return min(1.0, len(values) * min(values)) if values else 1.0


def _of_signal(series: Sequence[np.ndarray], span: int) -> list[float]:
    joined = np.concatenate([r[~np.isnan(r)] for r in series]) if len(series) else np.zeros(0)
    size = float(np.median(np.abs(joined))) / 0.6745 if len(joined) else 0.0
    if size == 0.0:
        return []
    rows = [np.clip(np.nan_to_num(r) / size, -OUTLYING, OUTLYING) for r in series]
    count, longest = len(joined), min(max(span, LAGS), max(map(len, rows)) - 1)
    products = np.sum([_autocovariance(r, longest) for r in rows], axis=0)
    rho = products[1:] / products[0]
    spans = {max(1, longest // 4**k) for k in range(SPANS)}
    fast = float(chi2.sf(count * float(np.sum(rho[:LAGS] ** 2)), LAGS))
    return [fast, *(float(norm.sf(float(np.sqrt(count / L) * rho[:L].sum()))) for L in spans)]


def _autocovariance(r: np.ndarray, longest: int) -> np.ndarray:
    """sum_k r_k r_{k+l} for lags l from 0 to ``longest``, by the fast Fourier transform."""
    size = 1 << int(np.ceil(np.log2(2 * len(r))))
    power = np.abs(np.fft.rfft(r, size)) ** 2
    result = np.zeros(longest + 1)
    own = np.fft.irfft(power, size)[: min(longest + 1, len(r))]
    result[: len(own)] = own
    return result


def correlation_time(residuals: Sequence[np.ndarray]) -> float:
    """Number of samples over which residuals stay correlated, 1 for white noise: 1 + 2 sum of autocorrelations.

    The sum ends at the first autocorrelation below two standard errors.
    """
    rows = [r for r in residuals if len(r) > FEWEST]
    power = sum(float(r @ r) for r in rows)
    if not rows or power == 0:
        return 1.0
    count, total = sum(len(r) for r in rows), 1.0
    for lag in range(1, min(len(r) for r in rows) // 4):
        rho = sum(float(r[lag:] @ r[:-lag]) for r in rows) / power
        if rho < 2 / np.sqrt(count):
            break
        total += 2 * rho
    return total
