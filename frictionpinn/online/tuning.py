"""What an online estimator must know of the sensors and the motion, estimated from training trials."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import sympy as sp

from ..data.recording import Recording, Trial
from ..errors import UserError
from ..numerics.kalman import KalmanFilter, KalmanSmoother
from ..numerics.kalman_recursions import PRIOR
from ..numerics.placing import unplaced
from ..numerics.smoothing import difference_sigma
from ..physics import System
from ..physics.mechanism import Mechanism

MOTION_ORDER, INPUT_ORDER = 4, 3  # states of a chain: up to the jerk of a coordinate, the second derivative of an input
START = 3.0  # first standard deviation of what the first sample does not show, in root mean squares


@dataclass(frozen=True)
class Chain:
    """A driven coordinate or an input as a Wiener process of its highest derivative.

    Attributes:
        signals: measured names of its value and, for a coordinate, its rate and acceleration.
        order: number of states.
        density: spectral density of the highest derivative's rate, (SI unit)^2/s.
        spread: standard deviation of every state before the first sample, shape (order,).
    """

    signals: tuple[str, ...]
    order: int
    density: float
    spread: tuple[float, ...]


@dataclass(frozen=True)
class Tuning:
    """Noise of the sensors, smoothness of the inputs, scale of the motion. All from data, none of it friction.

    Attributes:
        sigmas: measured signal -> standard deviation of its noise, SI units.
        chains: by the name of the driven coordinate or input.
        scales: free coordinate -> root mean square of position, velocity and acceleration.
        interval: typical time between samples, s.
    """

    sigmas: dict[str, float]
    chains: dict[str, Chain]
    scales: dict[str, tuple[float, float, float]]
    interval: float


def tune(mechanism: Mechanism, recording: Recording, sigmas: Mapping[str, float] | None = None) -> Tuning:
    """Estimate the tuning from trials of the same mechanism and sensors.

    Noise levels come from differences of neighbouring samples; densities of driven coordinates and inputs maximise
    the likelihood of a Kalman filter's innovations on these trials.

    Args:
        sigmas: noise levels that are known, SI units.

    Raises:
        UserError: no trial, nothing measured of a driven coordinate or of the mechanism's own motion, or no position
            where forces bend with it.
    """
    if not recording.trials:
        raise UserError("no trial to tune the estimator on", where="recording", fix="give the training trials")
    trials, system = recording.trials, mechanism.system
    names = [name for c in system.moving for name in c.signals] + [item.name for item in system.inputs]
    applied = {item.name for item in system.inputs}  # one that a trial has not is 0 there
    with_it = {name: [trial for trial in trials if name in trial.signals] for name in names}
    present = [name for name in names if with_it[name] and (name in applied or len(with_it[name]) == len(trials))]
    levels = {name: difference_sigma([(trial.t, trial.signals[name]) for trial in with_it[name]]) for name in present}
    levels = {name: max(value, 1e-12) for name, value in levels.items()} | dict(sigmas or {})
    chains = {}
    for c in mechanism.driven:
        _require(c.signals, present, c.name)
        chains[c.name] = _chain(trials, c.signals, levels, MOTION_ORDER)
    inputs = [item.name for item in system.inputs if item.symbol in system.acting and item.name in present]
    for name in [] if system.massless else inputs:
        chains[name] = _chain(with_it[name], (name,), levels, INPUT_ORDER)
    scales = {}
    for c in mechanism.free:
        _require(c.signals, present, c.name)
        scales[c.name] = _scale(trials, c.signals)
    _require_places(system, present)
    interval = float(np.median(np.concatenate([np.diff(trial.t) for trial in trials])))
    return Tuning({name: levels[name] for name in present}, chains, scales, interval)


def _require(signals: Sequence[str], present: Sequence[str], coordinate: str) -> None:
    if not any(name in present for name in signals):
        raise UserError(
            f"nothing measured of coordinate {coordinate}",
            where="recording",
            received=", ".join(present),
            allowed=f"at least one of {', '.join(signals)} in every trial",
        )


def _require_places(system: System, present: Sequence[str]) -> None:
    """An estimator that is linearised where it is comes back from a wrong place where the forces are linear in it."""
    for c in unplaced(system, present):
        q = c.symbols[0]
        if any(sp.diff(system.residual(row), q, 2) != 0 for row in system.free):
            raise UserError(f"where {c.name} is was not measured, and it acts", where="recording",
                            received=", ".join(present),
                            allowed=f"{c.signals[0]} in every trial: a rate alone does not tell an estimator where it "
                            "began")  # fmt: skip


def _columns(trial: Trial, signals: Sequence[str]) -> tuple:
    q, v, a = (*(trial.signals.get(name) for name in signals), None, None)[:3]
    return trial.t, q, v, a


def _chain(trials: Sequence[Trial], signals: tuple[str, ...], levels: Mapping[str, float], order: int) -> Chain:
    sigmas = [*(levels.get(name) for name in signals), None, None][:3]
    fitted = KalmanFilter(order=order).fit([_columns(trial, signals) for trial in trials], sigmas)
    assert fitted.prior is not None and fitted.density is not None
    spread = tuple(max(START / PRIOR * value, START * (level or 0.0)) for value, level in zip(
        fitted.prior, [*sigmas, *[0.0] * order], strict=False))  # fmt: skip
    return Chain(signals, order, fitted.density, spread)


def _scale(trials: Sequence[Trial], signals: Sequence[str]) -> tuple[float, float, float]:
    smoother = KalmanSmoother(order=3, jump_threshold=None).fit([_columns(trial, signals) for trial in trials])
    smooth = [np.array(smoother(*_columns(trial, signals))[:3]) for trial in trials]
    return tuple(np.sqrt(np.mean(np.concatenate(smooth, axis=1) ** 2, axis=1)).tolist())  # type: ignore[return-value]
