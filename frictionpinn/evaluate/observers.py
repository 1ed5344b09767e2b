"""Observers that carry the bristle through the equation of motion, beside the networks: identified, learned, true."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..data.contact import ContactTrial
from ..data.recording import Recording, Trial
from ..errors import UserError
from ..identify.likelihood import maximum_likelihood
from ..identify.problem import Problem
from ..online import OnlineEstimator, Tuning
from ..physics import LAWS, System
from ..physics.base import at_contact
from ..physics.contacts import law_named
from ..physics.mechanism import Mechanism
from .yardsticks import Candidate, Joint, simulated_law

log = logging.getLogger(__name__)

WIDEST = 0.3  # largest standard deviation of a parameter's logarithm that the sigma points take


class Observer:
    """The online estimator over the recorded signals of a trial, at one of its contacts.

    Args:
        estimator: of all contacts.
        contact: whose force is read.
        seen: readings of trials that were filtered already, shared by the observers of all contacts.
    """

    def __init__(self, estimator: OnlineEstimator, contact: str = "", seen: dict | None = None):
        self.estimator, self.contact = estimator, contact
        self._seen: dict[int, tuple[dict, dict[str, np.ndarray]]] = {} if seen is None else seen

    def _readings(self, trial: ContactTrial) -> dict[str, np.ndarray]:
        key = id(trial.measured)
        if key not in self._seen:
            known = {name: trial.measured[name] for name in self.estimator.signals if name in trial.measured}
            self._seen[key] = trial.measured, self.estimator.filter(Trial(trial.name, trial.t, known))
        return self._seen[key][1]

    def __call__(self, trial: ContactTrial) -> np.ndarray:
        """Friction force, shape (n,)."""
        return self._readings(trial)[at_contact(self.contact, "force")]

    def interval(self, trial: ContactTrial) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper end of the 95 % interval, shape (n,)."""
        found = self._readings(trial)
        return found[at_contact(self.contact, "low")], found[at_contact(self.contact, "high")]


@dataclass(frozen=True)
class Known:
    """A law (with several contacts one for each) with parameters, SI units, and where they are estimates the covariance
    of some parameters' logarithms."""

    label: str
    law: str | dict[str, str]
    parameters: dict[str, float]
    uncertain: tuple[str, ...] = ()
    covariance: np.ndarray | None = None


def identify(system: System, law: str | dict[str, str], recording: Recording) -> Known | None:
    """The law, or those of several contacts, by maximum likelihood on these trials; None where no simulation succeeds.

    Parameters that the data do not tell keep the value that the search ended with: together they fit the data.
    """
    try:
        problem = Problem(_mechanism(system, law), recording)
        found = maximum_likelihood(problem)
    except UserError as error:
        log.warning(f"no observer with identified parameters: {error}")
        return None
    if found.minimum is None:
        log.warning(f"no observer with identified parameters: {'; '.join(found.advice)}")
        return None
    own = [par.name for par in problem.mechanism.law.parameters]
    values = {name: value for name, value in problem.values(found.minimum.state.u).items() if name in own}
    told = [k for k, name in enumerate(found.names) if np.isfinite(found.covariance[k, k])]
    uncertain = tuple(found.names[k] for k in told)
    scale = np.array([values[name] for name in uncertain])
    relative = found.covariance[np.ix_(told, told)] / np.outer(scale, scale)
    reach = np.minimum(1.0, WIDEST / np.sqrt(np.diag(relative)))
    kinds = {law} if isinstance(law, str) else set(law.values()) - {"none"}
    label = f"identified {' and '.join(LAWS[kind].__name__ for kind in sorted(kinds))} (online: an observer)"
    return Known(label, law, values, uncertain, relative * np.outer(reach, reach))


def _mechanism(system: System, law: str | dict[str, str]) -> Mechanism:
    return Mechanism(system, law_named(law, "friction"))  # type: ignore[arg-type]


def observers(system: System, recording: Recording, known: Mapping[str, Known]) -> dict[str, Candidate]:
    """Observers and, of the identified parameters, the simulation, by key.

    Args:
        system: that is observed, with one contact.
        recording: training trials on this system: noise levels and smoothness of the inputs come from them.
        known: key -> what the observer of that key knows of the friction.
    """
    return observers_at_contacts(system, recording, known)[system.contacts[0].name]


def observers_at_contacts(
    system: System, recording: Recording, known: Mapping[str, Known]
) -> dict[str, dict[str, Candidate]]:
    """Contact -> :func:`observers` there, of a system with any number of contacts."""
    recording = _without_measured_force(recording, system)
    found: dict[str, dict[str, Candidate]] = {contact.name: {} for contact in system.contacts}
    tuning: Tuning | None = None
    for key, item in known.items():
        mechanism, adapt = _mechanism(system, item.law), dict.fromkeys(item.uncertain, 0.0)
        estimator = OnlineEstimator.fit(
            mechanism, item.parameters, recording, adapt, tuning=tuning, covariance=item.covariance
        )
        tuning, seen = estimator.tuning, dict[int, Any]()
        simulate = Joint(simulated_law(system, item.law, item.parameters)) if key == "identified" else None
        for contact, table in found.items():
            observer = Observer(estimator, contact, seen)
            part = simulate.at(contact) if simulate else None
            table[key] = Candidate(item.label, observer, part, observer.interval)
    return found


def _without_measured_force(recording: Recording, system: System) -> Recording:
    """Where the measured force is the friction force itself, an observer that saw it would have nothing to do."""
    if not system.massless:
        return recording
    hidden = {item.name for item in system.inputs}
    trials = tuple(
        Trial(trial.name, trial.t, {name: values for name, values in trial.signals.items() if name not in hidden})
        for trial in recording.trials
    )
    return Recording(trials, recording.units, recording.source, recording.checksum)
