"""From recordings to what a friction model sees: the signals of the contacts, two-sided and causal."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from ..numerics.placing import placed
from ..numerics.smoothing import Signal, Smoother
from ..numerics.torch_functions import balance_slopes, contact_signals, motion_feedback
from ..physics import System
from ..physics.base import at_contact, contact_of, place_of, plain_name
from .recording import Recording, Trial

BASE = ("v_slip", "normal_force", "a_frictionless")


@dataclass(frozen=True)
class ContactTrial:
    """The contact of one trial; every array has shape (n,) and SI units.

    With several contacts the names of the first four tables carry the contact's, ``hinge.v_slip``; :meth:`at` gives
    what one of them is, with plain names.

    Attributes:
        offline: v_slip, normal_force, a_slip, a_frictionless, friction_force (implied by the equation of motion),
            from signals smoothed by a method that may look ahead: for training and scoring.
        online: the same from signals that were filtered causally: what a controller has at that instant.
        rates: time derivatives of the ``BASE`` signals of ``online``, by backward differences.
        truth: noise-free values of simulated data, for scoring alone.
        measured: the recorded signals as they are.
        smoothed: the recorded signals smoothed in both directions, what was not measured derived.
        filtered: the same, filtered causally.
        seen, felt: v_slip, friction_force as ``offline`` and ``online`` have them, but with the velocities and
            accelerations of the free coordinates as measured, their noise kept: what a simulation is compared with.
        feedback: slopes of a_frictionless in slip position and slip velocity along the smoothed motion, shape (n, 2),
            see :func:`motion_feedback`; None of several contacts.
        off_position: by how much the measured slip position is off the smoothed one, shape (n,); None of several
            contacts.
        derived: whether the slip velocity is no measurement of its own but differentiated from a position.
        contacts: names of the contacts with friction; one without a name where the system has no other.
        slopes: J along the smoothed motion, shape (n, equations, contacts), see :func:`balance_slopes`; of several.
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
    contacts: tuple[str, ...] = ("",)
    slopes: np.ndarray | None = None
    seen: dict[str, np.ndarray] = field(default_factory=dict)
    felt: dict[str, np.ndarray] = field(default_factory=dict)
    feedback: np.ndarray | None = None
    off_position: np.ndarray | None = None
    derived: bool = False

    def __len__(self) -> int:
        return len(self.t)

    @cached_property
    def _views(self) -> dict[str, ContactTrial]:
        views = {"": self} if self.contacts == ("",) else {}
        for contact in filter(None, self.contacts):
            own: dict[str, Any] = {
                key: {plain_name(name): x for name, x in getattr(self, key).items() if contact_of(name) == contact}
                for key in ("offline", "online", "rates", "truth", "seen", "felt")
            }
            views[contact] = replace(self, **own, contacts=("",), slopes=None)
        return views

    def at(self, contact: str) -> ContactTrial:
        """The trial as one contact sees it.

        Raises:
            UserError: it has no such contact, or none with friction.
        """
        return list(self._views.values())[place_of(contact, tuple(self._views))]


def contact_trials(
    recording: Recording,
    system: System,
    offline: Smoother,
    online: Smoother,
    fit_on: Iterable[str],
    contacts: Iterable[str] | None = None,
) -> list[ContactTrial]:
    """Smooth every coordinate, offline and causally, and derive the signals of the contacts.

    Args:
        recording: measured signals in SI units; velocities and accelerations may be missing.
        system: gives coordinates and equations.
        offline, online: smoothers (see :mod:`frictionpinn.numerics.smoothing`); their free parameters are found on
            the trials named in ``fit_on`` only, so that held-out trials stay unseen.
        contacts: names of the contacts with friction; None: all.

    Raises:
        UserError: the equations of motion do not tell the friction forces of these contacts apart.
    """
    names = {str(name) for name in fit_on}
    own = tuple(contact.name for contact in system.contacts) if contacts is None else tuple(contacts)
    several = len(system.contacts) > 1
    fitting = [trial for trial in recording.trials if trial.name in names]
    smoothed = [smooth_trials(recording, fitting, system, method) for method in (offline, online)]
    trials = []
    for trial, two_sided, causal in zip(recording.trials, *smoothed, strict=True):
        on, off = (contact_signals(system, signals, own) for signals in (causal, two_sided))
        rates = {name: backward_difference(trial.t, on[name]) for name in on if plain_name(name) in BASE}
        for contact in own if several else ("",):
            rates[at_contact(contact, "v_slip")] = on[at_contact(contact, "a_slip")]
        made = ContactTrial(trial.name, trial.t, off, on, rates, trial.truth, trial.signals, two_sided, causal)
        seen, felt = (_as_measured(system, trial, signals, own) for signals in (two_sided, causal))
        measured = set(trial.signals) - set(trial.derived)
        made = replace(made, seen=seen, felt=felt, derived=any(c.signals[1] not in measured for c in system.free))
        if several:
            made = replace(made, contacts=own, slopes=balance_slopes(system, two_sided, own))
        else:
            made = replace(made, feedback=motion_feedback(system, two_sided),
                           off_position=_off_position(system, trial, two_sided, off["v_slip"]))  # fmt: skip
        trials.append(made)
    return trials


def _as_measured(
    system: System, trial: Trial, signals: dict[str, np.ndarray], contacts: tuple[str, ...]
) -> dict[str, np.ndarray]:
    """Slip velocities and friction forces with velocity and acceleration of the free coordinates as recorded."""
    raw = dict(signals)
    for c in system.free:
        raw |= {name: trial.signals[name] for name in c.signals[1:] if name in trial.signals}
    found = contact_signals(system, raw, contacts)
    return {name: x for name, x in found.items() if plain_name(name) in ("v_slip", "friction_force")}


def _off_position(system: System, trial: Trial, smoothed: dict[str, np.ndarray], v_slip: np.ndarray) -> np.ndarray:
    """The measured slip position less the smoothed one: a slip velocity is linear in the velocities, so that the errors
    of the positions in their place give it."""
    off = dict(smoothed)
    for position, velocity, _ in (c.signals for c in system.moving):
        off[velocity] = smoothed[velocity] + trial.signals.get(position, smoothed[position]) - smoothed[position]
    return contact_signals(system, off)["v_slip"] - v_slip


def smooth_trials(
    recording: Recording, fitting: list[Trial], system: System, method: Smoother
) -> list[dict[str, np.ndarray]]:
    """Signals of every trial, positions, velocities and accelerations smoothed; the smoother is fitted to some.

    Positions that act and were not measured begin where the trial's forces put them, causally smoothed ones too: of a
    velocity alone no controller knows where it is.
    """
    result = [dict(trial.signals) for trial in recording.trials]
    for coordinate in system.moving:
        fitted = method.fit([(trial.t, *_signals(trial, coordinate.signals)) for trial in fitting])
        for signals, trial in zip(result, recording.trials, strict=True):
            q, v, a, _ = fitted(trial.t, *_signals(trial, coordinate.signals))
            signals.update(zip(coordinate.signals, (q, v, a), strict=True))
    recorded = [set(trial.signals) for trial in recording.trials]
    for signals, positions in zip(result, placed(system, result, recorded, system.values), strict=True):
        signals.update(positions)
    return result


def _signals(trial: Trial, names: tuple[str, str, str]) -> tuple[Signal, Signal, Signal]:
    position, velocity, acceleration = (trial.signals.get(name) for name in names)
    return position, velocity, acceleration


def backward_difference(t: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Causal time derivative, shape (n,): (x_k - x_{k-1}) / (t_k - t_{k-1}), the first repeated."""
    rate = np.diff(values) / np.diff(t)
    return np.concatenate([rate[:1], rate])
