"""From recordings to what a friction model sees: the signals of the contact, two-sided and causal."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from ..numerics.smoothing import Signal, Smoother
from ..numerics.torch_functions import contact_signals
from ..physics import System
from .recording import Recording, Trial

BASE = ("v_slip", "normal_force", "a_frictionless")


@dataclass(frozen=True)
class ContactTrial:
    """The contact of one trial; every array has shape (n,) and SI units.

    Attributes:
        offline: v_slip, normal_force, a_slip, a_frictionless, friction_force (implied by the equation of motion),
            from signals smoothed by a method that may look ahead: for training and scoring.
        online: the same from signals that were filtered causally: what a controller has at that instant.
        rates: time derivatives of the ``BASE`` signals of ``online``, by backward differences.
        truth: noise-free values of simulated data, for scoring alone.
        measured: the recorded signals as they are.
        smoothed: the recorded signals smoothed in both directions, what was not measured derived.
        filtered: the same, filtered causally.
    """

    name: str
    t: np.ndarray
    offline: dict[str, np.ndarray]
    online: dict[str, np.ndarray]
    rates: dict[str, np.ndarray]
    truth: dict[str, np.ndarray] = field(default_factory=dict)
    measured: dict[str, np.ndarray] = field(default_factory=dict)
    smoothed: dict[str, np.ndarray] = field(default_factory=dict)
    filtered: dict[str, np.ndarray] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.t)


def contact_trials(
    recording: Recording, system: System, offline: Smoother, online: Smoother, fit_on: Iterable[str]
) -> list[ContactTrial]:
    """Smooth every coordinate, offline and causally, and derive the signals of the contact.

    Args:
        recording: measured signals in SI units; velocities and accelerations may be missing.
        system: gives coordinates and equations.
        offline, online: smoothers (see :mod:`frictionpinn.numerics.smoothing`); their free parameters are found on
            the trials named in ``fit_on`` only, so that held-out trials stay unseen.
    """
    names = {str(name) for name in fit_on}
    fitting = [trial for trial in recording.trials if trial.name in names]
    smoothed = [smooth_trials(recording, fitting, system, method) for method in (offline, online)]
    trials = []
    for trial, two_sided, causal in zip(recording.trials, *smoothed, strict=True):
        on = contact_signals(system, causal)
        rates = {name: backward_difference(trial.t, on[name]) for name in BASE}
        rates["v_slip"] = on["a_slip"]
        off = contact_signals(system, two_sided)
        trials.append(ContactTrial(trial.name, trial.t, off, on, rates, trial.truth, trial.signals, two_sided, causal))
    return trials


def smooth_trials(
    recording: Recording, fitting: list[Trial], system: System, method: Smoother
) -> list[dict[str, np.ndarray]]:
    """Signals of every trial, positions, velocities and accelerations smoothed; the smoother is fitted to some."""
    result = [dict(trial.signals) for trial in recording.trials]
    for coordinate in system.moving:
        fitted = method.fit([(trial.t, *_signals(trial, coordinate.signals)) for trial in fitting])
        for signals, trial in zip(result, recording.trials, strict=True):
            q, v, a, _ = fitted(trial.t, *_signals(trial, coordinate.signals))
            signals.update(zip(coordinate.signals, (q, v, a), strict=True))
    return result


def _signals(trial: Trial, names: tuple[str, str, str]) -> tuple[Signal, Signal, Signal]:
    position, velocity, acceleration = (trial.signals.get(name) for name in names)
    return position, velocity, acceleration


def backward_difference(t: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Causal time derivative, shape (n,): (x_k - x_{k-1}) / (t_k - t_{k-1}), the first repeated."""
    rate = np.diff(values) / np.diff(t)
    return np.concatenate([rate[:1], rate])
