"""What smoothing leaves of the measurement noise in the inputs of a simulation, found by smoothing once more."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..numerics.smoothing import Smoother
from ..numerics.torch_functions import contact_signals
from ..physics import System
from .contact import ContactTrial, smooth_trials
from .recording import Recording

SEED = 20  # of the noise that is added; the figures are means over thousands of samples


def input_noise(recording: Recording, system: System, smoother: Smoother, trials: Sequence[ContactTrial]) -> dict:
    """Errors of the frictionless acceleration and the slip velocity that smoothing leaves, at a system's only contact.

    The smoothed trials, with as much white noise as was smoothed away, are smoothed again: what comes out differs from
    what went in as the smoothed signals differ from the true ones.

    Args:
        recording: as measured.
        smoother: with which ``trials`` were smoothed.
        trials: training trials.

    Returns:
        ``input_error``: root mean square error of a_frictionless; ``input_time``: s, over which it stays alike (its
        autocorrelation falls to a half); ``start_error``: of v_slip; ``slip_noise``, ``force_noise``: of v_slip and
        friction_force as measured. All 0 where nothing was smoothed.
    """
    off = {
        name: np.concatenate([trial.seen[name] - trial.offline[name] for trial in trials]) for name in trials[0].seen
    }
    found = {"slip_noise": _rms(off["v_slip"]), "force_noise": _rms(off["friction_force"])}
    rng, again = np.random.default_rng(SEED), []
    names = [name for c in system.moving for name in c.signals if name in trials[0].measured]
    sigmas = {name: _rms(np.concatenate([t.measured[name] - t.smoothed[name] for t in trials])) for name in names}
    if not any(sigmas.values()):
        return found | {"input_error": 0.0, "input_time": 0.0, "start_error": 0.0}
    for trial in trials:
        noisy = {name: trial.smoothed[name] + sigmas[name] * rng.standard_normal(len(trial.t)) for name in names}
        own = recording.select([trial.name]).trials[0]
        again.append(replace(own, signals={**own.signals, **noisy}))
    twice = smooth_trials(Recording(tuple(again), recording.units), again, system, smoother)
    wrong = [
        {name: x - trial.offline[name] for name, x in contact_signals(system, signals).items() if name in trial.offline}
        for trial, signals in zip(trials, twice, strict=True)
    ]
    error = [own["a_frictionless"] for own in wrong]
    start = _rms(np.concatenate([own["v_slip"] for own in wrong]))
    step = float(np.median(np.diff(trials[0].t)))
    told = {"input_error": _rms(np.concatenate(error)), "input_time": step * _alike(error), "start_error": start}
    return found | told


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.nanmean(values**2)))


def _alike(errors: Sequence[np.ndarray]) -> float:
    """Samples after which the mean autocorrelation has fallen to a half, at least 1."""
    whole = sum(float(np.mean(error**2)) for error in errors)
    for lag in range(1, min(map(len, errors)) // 2):
        if sum(float(np.mean(error[lag:] * error[:-lag])) for error in errors) < whole / 2:
            return float(lag)
    return 1.0
