"""From a recording of a robot to what its balance is fitted to: smooth motions, regressors, filtered torques.

Positions pass a zero-phase low-pass and a quintic spline, which gives their rates. The balance holds at every instant,
so it holds filtered, too: model and measured torque pass the same low-pass and are thinned to what that leaves
(parallel filtering). Source: Gautier, Dynamic identification of robots with power model, ICRA (1997).

Public: :func:`prepare` and :class:`Prepared`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.signal import butter, sosfiltfilt

from ..data.recording import Recording, Trial
from ..data.thresholds import AS_MEASURED
from ..errors import UserError
from ..numerics.smoothing import difference_sigma
from ..physics.robot import Base, Robot

RIGID_HZ = 20.0  # links and gears of arms are no longer rigid above
PER_PERIOD = 10.0  # samples a period of the fastest motion that is kept: derivatives then err by less than 1 %
WORKING = 25.0  # samples a period of the cutoff at which friction is computed: bristles break loose within some of them
WIDER = 5.0  # times the torque's cutoff is that of positions, lest they be filtered twice, and breakaway with them
THINNED = 2.5  # samples kept a period of the cutoff: at half that rate the filter passes less than 2 %
EDGE = 2.0  # periods of the cutoff at either end of a trial, where filters and derivatives have but one side


@dataclass(frozen=True)
class Prepared:
    """A trial as the balance sees it; n samples at the working rate, m where torques are compared.

    Attributes:
        name: of the trial.
        t, session: time of the trial and of the session, s, shape (n,), even steps.
        q, v, a: of the joints, shape (n, joints).
        Y: regressor of the base parameters, shape (n, joints, base).
        tau: measured torques, filtered, shape (m, joints).
        covariate: what friction may depend on, less its mean over the recording; shape (n, joints), or None.
        cutoff_hz, keep: of the low-pass, and the samples that are kept of n.
        full: regressor of all inertial parameters, shape (n, joints, 10 bodies).
    """

    name: str
    t: np.ndarray
    session: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    Y: np.ndarray
    tau: np.ndarray
    covariate: np.ndarray | None
    cutoff_hz: float
    keep: slice
    full: np.ndarray

    def filtered(self, values: np.ndarray) -> np.ndarray:
        """Values at the working rate, shape (n, ...), as torques are compared, shape (m, ...)."""
        return _lowpass(values, 1 / (self.t[1] - self.t[0]), self.cutoff_hz)[self.keep]

    @cached_property
    def Y_filtered(self) -> np.ndarray:
        """The regressor as torques are compared, shape (m, joints, base)."""
        return self.filtered(self.Y)

    @property
    def compared(self) -> np.ndarray:
        """Times at which torques are compared, s, shape (m,)."""
        return self.t[self.keep]


def prepare(
    recording: Recording, robot: Robot, base: Base, cutoff_hz: float | None = None, common: Recording | None = None
) -> list[Prepared]:
    """Every trial, ready for the balance.

    Args:
        recording: signals q_k and tau_k, SI units; temperature_k where there is one.
        robot, base: that it is of, and its base parameters.
        cutoff_hz: of the torques' low-pass, Hz; None: see :func:`cutoff`.
        common: the recording that cutoff and mean covariate are taken from; None: this one.

    Raises:
        UserError: a cutoff above what the sampling rate allows, a trial shorter than filters need.
    """
    common = common or recording
    hz = cutoff(common, len(robot.joints)) if cutoff_hz is None else float(cutoff_hz)
    highest = min(rate_of(trial) for trial in recording.trials) / PER_PERIOD
    if not 0 < hz <= 2 * highest:
        raise UserError(
            "cutoff out of range",
            where="robot.cutoff_hz",
            received=f"{hz:g} Hz",
            allowed=f"above 0 and up to {2 * highest:.3g} Hz, a fifth of the sampling rate",
            fix="leave it out",
        )
    return [_prepared(trial, robot, base, hz, _mean_covariate(common)) for trial in recording.trials]


def rate_of(trial: Trial) -> float:
    """Usual sampling rate, Hz."""
    return 1 / float(np.median(np.diff(trial.t)))


def cutoff(recording: Recording, joints: int) -> float:
    """Frequency, Hz, up to which accelerations stand clear of the positions' noise, and links are rigid.

    Noise of ``AS_MEASURED`` of an acceleration's variance makes inertias too small by that share. Noise of standard
    deviation s, sampled at rate f, leaves s^2 (2 pi)^4 h^5 2 / (5 f) in accelerations up to h.
    """
    highest = min(RIGID_HZ, min(rate_of(trial) for trial in recording.trials) / PER_PERIOD)
    for k in range(1, joints + 1):
        series = [(trial.t, trial.signals[f"q_{k}"]) for trial in recording.trials]
        sigma, rate = difference_sigma(series), float(np.median([rate_of(t) for t in recording.trials]))
        smooth = [_spline(trial, [f"q_{k}"], highest)[2][:, 0] for trial in recording.trials]
        moved = float(np.mean(np.concatenate(smooth) ** 2))
        if sigma > 0 and moved > 0:
            highest = min(highest, (AS_MEASURED * moved * 5 * rate / (2 * sigma**2 * (2 * np.pi) ** 4)) ** 0.2)
    return highest


def _spline(trial: Trial, names: Sequence[str], hz: float, factor: int = 1) -> tuple[np.ndarray, ...]:
    """Position, velocity and acceleration of signals at even steps, low-passed, and the times, shape (n, names)."""
    rate = rate_of(trial)
    t = trial.t[0] + np.arange(int((trial.t[-1] - trial.t[0]) * rate) + 1) / rate
    even = make_interp_spline(trial.t, np.stack([trial.signals[name] for name in names], axis=1), k=3)(t)
    smooth = make_interp_spline(t, _lowpass(even, rate, hz), k=5)
    t = t[::factor]
    return smooth(t), smooth(t, 1), smooth(t, 2), t


@lru_cache(maxsize=64)
def _sections(relative: float) -> np.ndarray:
    """A Butterworth low-pass of 4th order, its cutoff a share of the sampling rate."""
    return butter(4, relative, fs=1.0, output="sos")


def _lowpass(values: np.ndarray, rate: float, hz: float) -> np.ndarray:
    sections = _sections(hz / rate)
    pad = min(len(values) - 1, int(3 * rate / hz))
    return sosfiltfilt(sections, values, axis=0, padlen=pad)


def _prepared(trial: Trial, robot: Robot, base: Base, hz: float, mean: np.ndarray | None) -> Prepared:
    joints, rate = range(1, len(robot.joints) + 1), rate_of(trial)
    if (trial.t[-1] - trial.t[0]) * hz < 4 * EDGE:
        raise UserError(
            "trial too short",
            where=f"trial '{trial.name}'",
            received=f"{trial.t[-1] - trial.t[0]:.3g} s long",
            allowed=f"at least {4 * EDGE / hz:.3g} s",
            fix="leave it out, or record longer",
        )
    factor = max(int(rate / (WORKING * hz)), 1)
    q, v, a, t = _spline(trial, [f"q_{k}" for k in joints], min(WIDER * hz, 0.4 * rate), factor)
    even = np.arange(t[0], t[-1] + 0.5 / rate, 1 / rate)
    measured = make_interp_spline(trial.t, np.stack([trial.signals[f"tau_{k}"] for k in joints], axis=1), k=1)(even)
    edge, thin = round(EDGE / hz * rate / factor), max(int(rate / factor / (THINNED * hz)), 1)
    keep = slice(edge, len(t) - edge, thin)
    tau = _lowpass(measured, rate, hz)[::factor][: len(t)][keep]
    covariate = None
    if mean is not None:
        table = [np.interp(t, trial.t, trial.signals[f"temperature_{k}"]) for k in joints]
        covariate = np.stack(table, axis=1) - mean
    full = robot.regressor(q, v, a)
    session = (trial.start or 0.0) + t - t[0]
    return Prepared(trial.name, t, session, q, v, a, base.reduced(full), tau, covariate, hz, keep, full)


def _mean_covariate(recording: Recording) -> np.ndarray | None:
    names = [name for name in recording.units if name.startswith("temperature_")]
    if not names:
        return None
    return np.array([np.mean(np.concatenate([t.signals[name] for t in recording.trials])) for name in sorted(names)])
