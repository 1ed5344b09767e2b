"""From a recording of a robot to what its balance is fitted to: smooth motions, regressors, filtered torques.

Positions pass a Kalman smoother, joint by joint: white noise of the encoder on a motion whose jerk is white, since
accelerations jump where friction does. Both densities are those of greatest likelihood on the positions themselves, so
its bandwidth follows from noise, sampling rate and the motion's own spectrum (:mod:`..numerics.kalman`).

The balance holds at every instant, so it holds filtered, too: model and measured torque pass the same low-pass and are
thinned to what that leaves (parallel filtering). Its cutoff is low enough that what the positions lost and kept of
noise is small in it. Source: Gautier, Dynamic identification of robots with power model, ICRA (1997).

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
from ..numerics.kalman import KalmanSmoother
from ..physics.robot import Base, Robot

RIGID_HZ = 20.0  # links and gears of arms are no longer rigid above
PER_PERIOD = 10.0  # samples a period of the fastest motion that is kept: derivatives then err by less than 1 %
# Samples a period of the fastest that the smoothers leave: where a velocity turns in between, dry friction errs, and is
# told too small by the square of the step: 0.15 % at half as many, more than a minute's noise.
WORKING = 10.0
ORDER = 3  # states of the smoother: position, velocity, acceleration
THINNED = 2.5  # samples kept a period of the cutoff: at half that rate the filter passes less than 2 %
KEPT = 0.01  # of an amplitude at the cutoff that smoothing of positions may take: as much as inertias err by then
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
        interval: between samples of the recording, s.
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
    interval: float
    cutoff_hz: float
    keep: slice
    full: np.ndarray

    def filtered(self, values: np.ndarray) -> np.ndarray:
        """Values at the working rate, shape (n, ...), as torques are compared, shape (m, ...)."""
        return self.filtered_at(self.cutoff_hz, values)[self.keep]

    def filtered_at(self, cutoff_hz: float, values: np.ndarray) -> np.ndarray:
        """Values at the working rate, shape (n, ...), behind another low-pass."""
        return _lowpass(values, 1 / (self.t[1] - self.t[0]), cutoff_hz)

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
    smoothers = fitted_smoothers(common, len(robot.joints))
    hz = cutoff(common, smoothers) if cutoff_hz is None else float(cutoff_hz)
    highest = min(rate_of(trial) for trial in recording.trials) / PER_PERIOD
    if not 0 < hz <= 2 * highest:
        raise UserError(
            "cutoff out of range",
            where="robot.cutoff_hz",
            received=f"{hz:g} Hz",
            allowed=f"above 0 and up to {2 * highest:.3g} Hz, a fifth of the sampling rate",
            fix="leave it out",
        )
    mean = _mean_covariate(common, len(robot.joints))
    return [_prepared(trial, robot, base, hz, smoothers, mean) for trial in recording.trials]


def rate_of(trial: Trial) -> float:
    """Usual sampling rate, Hz."""
    return 1 / float(np.median(np.diff(trial.t)))


def fitted_smoothers(recording: Recording, joints: int) -> list[KalmanSmoother]:
    """A smoother of each joint's position, its noise and density of jerk of greatest likelihood."""
    plain = KalmanSmoother(ORDER, jump_threshold=None)
    return [
        plain.fit([(trial.t, trial.signals[f"q_{k}"], None, None) for trial in recording.trials])
        for k in range(1, joints + 1)
    ]


def bandwidth(smoother: KalmanSmoother, rate: float) -> float:
    """Frequency, Hz, at which a smoother leaves half: there the motion's spectrum meets that of the noise.

    With jerk of density S and noise of standard deviation s, sampled at rate f, it leaves
    1 / (1 + (2 pi h)^6 s^2 / (S f)) of what has frequency h.
    """
    sigma, density = noise_of(smoother), smoother.density or 0.0
    return float((density * rate / sigma**2) ** (0.5 / ORDER) / (2 * np.pi)) if sigma else np.inf


def noise_of(smoother: KalmanSmoother) -> float:
    """Standard deviation of the position's noise that a smoother was fitted with."""
    return float((smoother.sigmas or (0.0,))[0] or 0.0)


def cutoff(recording: Recording, smoothers: Sequence[KalmanSmoother]) -> float:
    """Frequency, Hz, up to which accelerations stand clear of the positions' noise, and links are rigid.

    Noise of ``AS_MEASURED`` of an acceleration's variance makes inertias too small by that share. Noise of standard
    deviation s, sampled at rate f, leaves s^2 (2 pi)^4 h^5 2 / (5 f) in accelerations up to h; and the smoother takes
    (h / bandwidth)^6 of them.
    """
    rate = float(np.median([rate_of(t) for t in recording.trials]))
    highest = min(RIGID_HZ, min(rate_of(trial) for trial in recording.trials) / PER_PERIOD)
    for k, smoother in enumerate(smoothers, 1):
        series = [(trial.t, trial.signals[f"q_{k}"]) for trial in recording.trials]
        moved = float(np.mean(np.concatenate([smoother(t, q, None, None)[2] for t, q in series]) ** 2))
        sigma = noise_of(smoother)
        if sigma > 0 and moved > 0:
            noise = (AS_MEASURED * moved * 5 * rate / (2 * sigma**2 * (2 * np.pi) ** 4)) ** 0.2
            highest = min(highest, noise, bandwidth(smoother, rate) * KEPT ** (0.5 / ORDER))
    return highest


def _even(trial: Trial, rate: float, names: Sequence[str], degree: int) -> tuple[np.ndarray, np.ndarray]:
    """Even times of a trial, and its signals there, shape (n, names)."""
    t = trial.t[0] + np.arange(int((trial.t[-1] - trial.t[0]) * rate + 0.5) + 1) / rate
    t = t[t <= trial.t[-1] + 1e-6 / rate]
    return t, make_interp_spline(trial.t, np.stack([trial.signals[name] for name in names], axis=1), k=degree)(t)


@lru_cache(maxsize=64)
def _sections(relative: float) -> np.ndarray:
    """A Butterworth low-pass of 4th order, its cutoff a share of the sampling rate."""
    return butter(4, relative, fs=1.0, output="sos")


def _lowpass(values: np.ndarray, rate: float, hz: float) -> np.ndarray:
    sections = _sections(hz / rate)
    pad = min(len(values) - 1, int(3 * rate / hz))
    return sosfiltfilt(sections, values, axis=0, padlen=pad)


def _prepared(
    trial: Trial,
    robot: Robot,
    base: Base,
    hz: float,
    smoothers: Sequence[KalmanSmoother],
    mean: np.ndarray | None,
) -> Prepared:
    joints, rate = range(1, len(robot.joints) + 1), rate_of(trial)
    if (trial.t[-1] - trial.t[0]) * hz < 4 * EDGE:
        raise UserError(
            "trial too short",
            where=f"trial '{trial.name}'",
            received=f"{trial.t[-1] - trial.t[0]:.3g} s long",
            allowed=f"at least {4 * EDGE / hz:.3g} s",
            fix="leave it out, or record longer",
        )
    t, positions = _even(trial, rate, [f"q_{k}" for k in joints], 3)
    smooth = [smoother(t, x, None, None)[:3] for smoother, x in zip(smoothers, positions.T, strict=True)]
    fastest = max(bandwidth(smoother, rate) for smoother in smoothers)
    factor = max(int(rate / (WORKING * max(fastest, THINNED * hz))), 1)
    measured = _even(trial, rate, [f"tau_{k}" for k in joints], 1)[1]
    q, v, a = (np.stack([own[i][::factor] for own in smooth], axis=1) for i in range(3))
    t = t[::factor]
    edge, thin = round(EDGE / hz * rate / factor), max(int(rate / factor / (THINNED * hz)), 1)
    keep = slice(edge, len(t) - edge, thin)
    tau = _lowpass(measured, rate, hz)[::factor][keep]
    covariate = None
    if mean is not None:
        table = [np.interp(t, trial.t, trial.signals[f"temperature_{k}"]) for k in joints]
        covariate = np.stack(table, axis=1) - mean
    full = robot.regressor(q, v, a)
    session = (trial.start or 0.0) + t - t[0]
    return Prepared(trial.name, t, session, q, v, a, base.reduced(full), tau, covariate, 1 / rate, hz, keep, full)


def _mean_covariate(recording: Recording, joints: int) -> np.ndarray | None:
    names = [f"temperature_{k}" for k in range(1, joints + 1)]
    if not any(name in recording.units for name in names):
        return None
    return np.array([np.mean(np.concatenate([t.signals[name] for t in recording.trials])) for name in names])
