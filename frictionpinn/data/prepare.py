"""Zero-phase filtering, differentiation and decimation of recorded signals."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from frictionpinn.data.recording import Trial
from frictionpinn.data.thresholds import FEWEST, JITTER
from frictionpinn.errors import UserError

_RIPPLE_DB = 0.05


def sample_rate(t: np.ndarray, where: str = "t") -> float:
    """Return the sampling rate, Hz, of times ``t`` (n,), s; :class:`UserError` where it is not uniform within 5 %."""
    steps = np.diff(t)
    mean = (t[-1] - t[0]) / max(len(t) - 1, 1) if len(t) else 0.0
    if not len(steps) or not mean > 0:
        raise UserError("no sampling rate", where=where, received=f"{len(t)} samples long", allowed="increasing times")
    worst = int(np.argmax(np.abs(steps - mean)))
    if abs(steps[worst] - mean) > JITTER * mean:
        raise UserError(
            "sampling is not uniform",
            where=f"{where}, step after row {worst + 1}",
            received=f"{steps[worst]:.6g} s long",
            allowed=f"within 5 % of the mean, {mean:.6g} s",
            fix="lower its rate with data.rate_hz, which makes it even",
        )
    return 1.0 / mean


def even(trial: Trial) -> Trial:
    """The trial as it is where its steps are within 5 % of their mean, else resampled at its usual rate."""
    steps = np.diff(trial.t)
    mean = float(np.mean(steps)) if len(steps) else 0.0
    if not mean > 0 or np.max(np.abs(steps - mean)) <= JITTER * mean:
        return trial
    return resample(trial, 1.0 / float(np.median(steps)))


def resample(trial: Trial, rate_hz: float) -> Trial:
    """Return the trial at a uniform rate, signals interpolated linearly; ``rate_hz`` in Hz."""
    if not rate_hz > 0:
        raise UserError("rate out of range", where="rate_hz", received=f"{rate_hz} Hz", allowed="above 0 Hz")
    t = trial.t[0] + np.arange(int(np.floor((trial.t[-1] - trial.t[0]) * rate_hz)) + 1) / rate_hz
    return _mapped(trial, t, lambda values: np.interp(t, trial.t, values))


def lowpass(values: np.ndarray, rate_hz: float, cutoff_hz: float, order: int = 4) -> np.ndarray:
    """Low-pass along the first axis by a Butterworth filter run forward and backward, so without delay.

    Args:
        values: shape (n, ...), any unit.
        rate_hz: sampling rate, Hz.
        cutoff_hz: cutoff of the single pass, Hz; each of the two passes attenuates it by 3 dB.
        order: order of the single pass.

    Returns:
        Array of the same shape and unit.

    Raises:
        UserError: the cutoff is not between 0 and half the rate, or there are too few samples.
    """
    from scipy.signal import butter, sosfiltfilt

    if not 0 < cutoff_hz < rate_hz / 2:
        raise UserError(
            "cutoff out of range",
            where="cutoff_hz",
            received=f"{cutoff_hz} Hz",
            allowed=f"above 0 and below {rate_hz / 2:.6g} Hz, half the sampling rate",
        )
    sections = butter(order, cutoff_hz, fs=rate_hz, output="sos")
    _check_length(values, 3 * (2 * len(sections) + 1))
    return sosfiltfilt(sections, values, axis=0)


def decimate(values: np.ndarray, factor: int) -> np.ndarray:
    """Low-pass without delay (Chebyshev, order 8, 0.8 of the new Nyquist rate) and keep every ``factor``-th sample.

    The operation is linear: applied to both sides of an equation of motion, it leaves the equation true. Applied to
    the state alone it does not, because friction is no linear function of it.

    Args:
        values: shape (n, ...), any unit.
        factor: 1 leaves the values as they are.

    Returns:
        Array of shape (ceil(n / factor), ...).
    """
    from scipy.signal import cheby1, sosfiltfilt

    if factor <= 1:
        return np.asarray(values)
    sections = cheby1(8, _RIPPLE_DB, 0.8 / factor, output="sos")
    # A Chebyshev filter of even order passes constants below unity: two passes would shrink every signal by 1.1 %.
    sections[0, :3] *= 10 ** (_RIPPLE_DB / 20)
    _check_length(values, 3 * (2 * len(sections) + 1))
    return sosfiltfilt(sections, values, axis=0)[::factor]


def differentiate(
    t: np.ndarray, x: np.ndarray, cutoff_hz: float | None, order: int = 4
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Low-pass a position and take its first and second derivative by central differences.

    Args:
        t: time, s, shape (n,), uniform within 5 %.
        x: position, m or rad, shape (n,).
        cutoff_hz: of the zero-phase Butterworth low-pass, Hz; None leaves the position as it is.
        order: order of the single pass.

    Returns:
        Position, rate and acceleration, each of shape (n,); one-sided differences at the ends.
    """
    rate = sample_rate(t)
    smooth = np.asarray(x, dtype=float) if cutoff_hz is None else lowpass(x, rate, cutoff_hz, order)
    rates = np.gradient(smooth, 1.0 / rate)
    return smooth, rates, np.gradient(rates, 1.0 / rate)


def thin(trial: Trial, rate_hz: float | None, cutoff_hz: float | None = None, edge_s: float = 0.0) -> Trial:
    """Drop the ends of a trial, low-pass every signal and keep about ``rate_hz`` samples a second.

    Args:
        trial: sampled evenly, or made so at its usual rate.
        rate_hz: wanted rate, Hz; the nearest whole fraction of the trial's own rate is taken; None keeps all samples.
        cutoff_hz: of a zero-phase 4th-order Butterworth low-pass, Hz; None takes the low-pass of :func:`decimate`.
        edge_s: time dropped at either end before the low-pass, s, where derivatives are one-sided.

    Returns:
        The trial with its time, signals and truth thinned alike.

    Raises:
        UserError: a rate that leaves fewer than ``FEWEST`` samples.
    """
    trial = even(trial)
    rate = sample_rate(trial.t, f"trial '{trial.name}', t")
    edge = round(edge_s * rate)
    inner = slice(edge, len(trial) - edge)
    if rate_hz is not None and not rate_hz * len(trial) >= FEWEST * rate:
        raise UserError(
            "rate that leaves hardly a sample",
            where=f"trial '{trial.name}', rate_hz",
            received=f"{rate_hz:g} Hz",
            allowed=f"at least {FEWEST * rate / len(trial):.3g} Hz, {FEWEST} samples of this trial",
        )
    factor = 1 if rate_hz is None else max(round(rate / rate_hz), 1)

    def reduced(values: np.ndarray) -> np.ndarray:
        if cutoff_hz is None:
            return decimate(values[inner], factor)
        return lowpass(values[inner], rate, cutoff_hz)[::factor]

    return _mapped(trial, trial.t[inner][::factor], reduced)


def prepare_trial(
    trial: Trial,
    *,
    position: str = "x",
    derivatives: tuple[str, str] = ("v", "a"),
    cutoff_hz: float | None = 100.0,
    rate_hz: float | None = 80.0,
    thin_cutoff_hz: float | None = None,
    edge_s: float = 0.02,
) -> Trial:
    """Prepare a recorded trial the way that is customary in robot identification.

    The position is low-passed without delay and differentiated twice; then all signals, forces too, pass the same
    low-pass and are decimated.

    Args:
        trial: holds the position and, commonly, forces at a uniform rate.
        position: signal to differentiate.
        derivatives: names that its rate and acceleration get; signals of these names are replaced.
        cutoff_hz: low-pass of the position, Hz.
        rate_hz: rate after decimation, Hz; None keeps all samples and leaves the other signals unfiltered.
        thin_cutoff_hz: low-pass of all signals before decimation, Hz; None takes that of :func:`decimate`.
        edge_s: time dropped at either end, s.

    Returns:
        The prepared trial.
    """
    x, v, a = differentiate(trial.t, trial.signals[position], cutoff_hz)
    full = trial.with_signals(**{position: x, derivatives[0]: v, derivatives[1]: a})
    return thin(replace(full, derived=derivatives), rate_hz, thin_cutoff_hz, edge_s)


def _mapped(trial: Trial, t: np.ndarray, function: Callable[[np.ndarray], np.ndarray]) -> Trial:
    signals = {name: function(values) for name, values in trial.signals.items()}
    truth = {name: function(values) for name, values in trial.truth.items()}
    start = None if trial.start is None else trial.start + float(t[0] - trial.t[0])
    return replace(trial, t=t, signals=signals, truth=truth, start=start)


def _check_length(values: np.ndarray, least: int) -> None:
    if len(values) <= least:
        raise UserError(
            "too few samples to filter",
            where="signal",
            received=f"{len(values)} samples long",
            allowed=f"above {least}",
            fix="record longer, or filter at a higher cutoff",
        )
