"""What is wrong in the inputs of a simulation: what smoothing leaves, found by smoothing again, and noise of forces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..numerics.smoothing import Smoother, difference_sigma
from ..numerics.torch_functions import contact_signals
from ..physics import System
from .contact import ContactTrial, smooth_trials
from .recording import Recording

SEED = 20  # of the noise that is added
DRAWS = 16  # of it: what is said of the ends of trials rests on one sample of each
ONE_SIGMA = 0.6827  # share of normal errors within one standard deviation
CLEAN = 1e-3  # of its root mean square: error of a slip velocity as good as free of noise, which models do not undercut
FINER, REACH = 4, 16  # points of the errors' shape in the time over which they stay alike, and its reach in such times


# Of a contact that follows the measured motion: nothing is simulated, and compared over its noise.
UNTOLD: dict = {"slip_noise": 0.0, "force_noise": 0.0, "input_error": 0.0, "start_error": 0.0, "first_error": 0.0,
                "start_time": 0.0, "position_noise": 0.0, "assumed": 0.0, "input_shape": [], "input_step": 0.0,
                "input_ends": []}  # fmt: skip


def input_noise(
    recording: Recording, system: System, smoother: Smoother, trials: Sequence[ContactTrial], positions: bool = False
) -> dict:
    """Errors of the frictionless acceleration and the slip velocity that smoothing leaves, at a system's only contact.

    The smoothed trials, with as much white noise as was smoothed away, are smoothed again: what comes out differs from
    what went in as the smoothed signals differ from the true ones. Forces are not smoothed: theirs is the noise that
    their differences show.

    Args:
        recording: as measured.
        smoother: with which ``trials`` were smoothed.
        trials: training trials.
        positions: whether a simulation is compared with the slip position.

    Returns:
        ``input_error``: root mean square error of a_frictionless far from a trial's ends, 0 where nothing that moves
        the contact was measured; ``input_ends``: near them as multiples of it (:func:`ends`); ``start_error``: of
        v_slip; ``first_error``: at first samples; ``start_time``: that of the slip position over that of v_slip, s, as
        in the motion, 0 where a_frictionless does not depend on it and it is not compared; ``slip_noise``,
        ``force_noise``: of v_slip and friction_force as measured, where no velocity was measured ``start_error``;
        ``position_noise``: of the slip position, 0 where it is not compared. Where nothing was smoothed the force's is
        0, those of v_slip and its starts are ``CLEAN``, the position's is as much in the time ``start_time``, and
        ``assumed`` is 1.
        ``input_shape``, ``input_step``: see :func:`shape`.
    """
    off = {
        name: np.concatenate([trial.seen[name] - trial.offline[name] for trial in trials]) for name in trials[0].seen
    }
    place = np.concatenate([np.zeros(1) if trial.off_position is None else trial.off_position for trial in trials])
    speed, rate = (_rms(np.concatenate([trial.offline[name] for trial in trials])) for name in ("v_slip", "a_slip"))
    pulled = any(trial.feedback is not None and trial.feedback[:, 0].any() for trial in trials)
    found: dict = {"slip_noise": _size(off["v_slip"]), "force_noise": _size(off["friction_force"]),
                   "start_time": speed / rate if (pulled or positions) and rate > 0 else 0.0,
                   "position_noise": _size(place) if positions else 0.0}  # fmt: skip
    rng, again = np.random.default_rng(SEED), []
    names = [name for c in system.moving for name in c.signals if name in trials[0].measured]
    sigmas = {name: _size(np.concatenate([t.measured[name] - t.smoothed[name] for t in trials])) for name in names}
    if not any(sigmas.values()):
        clean = CLEAN * speed
        found |= {"slip_noise": clean, "start_error": clean, "first_error": clean, "assumed": 1.0}
        return UNTOLD | found | {"position_noise": clean * found["start_time"] if positions else 0.0}
    acting = [item.name for item in system.inputs if item.symbol in system.friction_implied.free_symbols]
    sigmas |= {name: difference_sigma([(trial.t, trial.measured[name]) for trial in trials])
               for name in acting if all(name in trial.measured for trial in trials)}  # fmt: skip
    own = [recording.select([trial.name]).trials[0] for trial in trials]
    for _ in range(DRAWS):
        for trial, recorded in zip(trials, own, strict=True):
            noisy = {name: trial.smoothed[name] + sigmas[name] * rng.standard_normal(len(trial.t)) for name in sigmas}
            again.append(replace(recorded, signals={**recorded.signals, **noisy}))
    twice = smooth_trials(Recording(tuple(again), recording.units), again[: len(own)], system, smoother)
    wrong = []
    for trial, signals in zip(DRAWS * list(trials), twice, strict=True):
        seen = contact_signals(system, signals)
        wrong.append([seen[name] - trial.offline[name] for name in ("a_frictionless", "v_slip")])
    errors, slips = zip(*wrong, strict=True)
    first = _rms(np.array([slip[0] for slip in slips]))
    found |= {"start_error": _rms(np.concatenate(slips)), "first_error": first}
    found["slip_noise"] = found["slip_noise"] or found["start_error"]
    if not np.concatenate(errors).any():  # nothing that was measured moves it
        return UNTOLD | found
    profile, size = ends(errors)
    kernel, every = shape([error[len(profile) : len(error) - len(profile)] for error in errors])
    found["input_error"] = size
    step = every * float(np.median(np.diff(trials[0].t)))
    return UNTOLD | found | {"input_shape": kernel.tolist(), "input_step": step, "input_ends": profile.tolist()}


def ends(errors: Sequence[np.ndarray]) -> tuple[np.ndarray, float]:
    """Root mean square of the errors far from a trial's ends, and near them as multiples of it, by distance.

    A smoother sees one side only of a trial's ends, and errs there several times as much.
    """
    most = min(map(len, errors)) // 2
    near = np.array([error[:most] for error in errors] + [error[::-1][:most] for error in errors])
    by_distance = np.sqrt(np.mean(near**2, axis=0))
    size = _rms(by_distance[most // 2 :])
    inside = np.flatnonzero(by_distance < size)
    reach = int(inside[0]) if len(inside) else 0  # until the errors are no larger than further inside
    return by_distance[:reach] / size, size


def shape(errors: Sequence[np.ndarray]) -> tuple[np.ndarray, float]:
    """Kernel that gives white noise the spectrum of the errors (sum of squares 1), and its step in samples.

    Where positions are measured the errors of an acceleration have next to no slow part: alike over a time, and the
    opposite after it. Were they taken for independent from one such time to the next, a simulation could drift where
    the measured one cannot. The spectrum is the autocovariance's, tapered (Blackman and Tukey, 1958).
    """
    whole = sum(float(error @ error) for error in errors)
    most = min(map(len, errors)) // 2
    alike = [sum(float(error[lag:] @ error[: len(error) - lag]) for error in errors) / whole for lag in range(most)]
    time = next((lag for lag, value in enumerate(alike) if value < 0.5), 1)  # until it has fallen to a half
    every = max(time / FINER, 1.0)
    lags = np.arange(min(REACH * max(time, FINER), most - 1) // every + 1)
    taper = 0.5 + 0.5 * np.cos(np.pi * lags / len(lags))
    half = taper * np.interp(every * lags, np.arange(most), alike)
    spectrum = np.fft.rfft(np.concatenate([half, half[:0:-1]])).real
    kernel = np.fft.fftshift(np.fft.irfft(np.sqrt(np.maximum(spectrum, 0.0)), 2 * len(lags) - 1))
    return kernel / np.sqrt(kernel @ kernel), every


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.nanmean(values**2)))


def _size(values: np.ndarray) -> float:
    """Standard deviation of normal noise; the few samples at a stop, which smoothing rounds off, do not count."""
    return float(np.nanquantile(np.abs(values), ONE_SIGMA))
