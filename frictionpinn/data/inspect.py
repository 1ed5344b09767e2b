"""The check of a recording before any fit: every finding, the grave ones first."""

from __future__ import annotations

from collections.abc import Sequence

from ..errors import UserError
from ..physics import System
from .balance import balance_findings, explained_by
from .channels import channel_findings, dead_findings, moving_trials, one_way_findings, slip_findings
from .check import check_trial
from .consistency import derivative_findings
from .filters import Sampled, noises, sampled
from .findings import NO_SLIP, Finding
from .recording import Recording


def inspect(recording: Recording, system: System, inertia_free: bool = False) -> list[Finding]:
    """What speaks against a recording of a system, the grave findings first.

    Args:
        recording: measured, SI units.
        system: that it is said to be of, with the values of its parameters.
        inertia_free: masses are estimated with the friction.

    Returns:
        The findings: single channels, whether derivatives are the derivatives of their signals, and, where these hold,
        whether forces and motion balance.
    """
    if not recording.trials:
        return [Finding("the recording has no trial", "select some of its trials", grave=True)]
    for trial in recording.trials:  # files were checked as they were read; others may come from anywhere
        try:
            check_trial(trial, recording.source or "recording")
        except UserError as error:
            return [Finding(str(error), grave=True)]
    names = [name for name in system.signal_units if name != "t"]
    trials, sigmas = sampled(recording, names)
    findings = channel_findings(system, recording, trials)
    if not trials:
        return findings
    still = slip_findings(system, trials, sigmas)
    findings += still or (dead := dead_findings(system, trials))
    if not still and not dead:
        spoilt = {f.spoilt for f in findings}
        trials = [t for t in (t.without(spoilt) for t in trials) if t.signals]
        sigmas = {name: sigma for name, sigma in sigmas.items() if name not in spoilt}
        balance = not any(f.grave for f in findings)
        found = _together(system, trials, sigmas, balance, inertia_free)
        findings += _one_by_one(system, trials, balance, inertia_free, {f.what for f in found}) or found
    return sorted(findings, key=lambda f: not f.grave)


def _together(
    system: System, trials: Sequence[Sampled], sigmas: dict[str, float], balance: bool, inertia_free: bool
) -> list[Finding]:
    """What derivatives say and, where these hold, forces and motion."""
    rates = derivative_findings(system, trials, sigmas)
    if rates or not balance:
        return rates
    found = balance_findings(system, trials, sigmas, inertia_free)
    return found + one_way_findings(system, trials, sigmas)


def _one_by_one(
    system: System, trials: Sequence[Sampled], balance: bool, inertia_free: bool, told: set[str]
) -> list[Finding]:
    """What is wrong of some trials alone, and what is odd of the others; none where these are wrong, too: taken
    together one wrong trial of several is hidden by the others, or spoils what is said of them. What is ``told`` of all
    of them is no fault of one."""
    if len(trials) < 2:
        return []
    wrong: dict[str, list[Finding]] = {}
    for trial in moving_trials(system, trials):

        def graves(forces: bool, trial: Sampled = trial) -> list[Finding]:
            found = _together(system, [trial], noises([trial]), forces, inertia_free)
            return [f for f in found if f.grave and f.what not in told]

        own = graves(balance)
        if own and balance and explained_by(system, trial, [t for t in trials if t is not trial]):
            own = graves(False)  # its own windows are too few to tell what all together do not
        wrong |= {trial.name: own} if own else {}
    others = [t for t in trials if t.name not in wrong]
    if not wrong or len(wrong) > len(others):  # of most trials it is the recording that is wrong
        return []
    rest = _together(system, others, noises(others), balance, inertia_free)
    if any(f.grave for f in rest):
        return []
    pairs = [(name, f) for name, own in wrong.items() for f in own]
    return [Finding(f"in trial '{name}' {f.what}", f"read that trial by itself: {f.fix}; or leave it out", grave=True)
            for name, f in pairs] + rest  # fmt: skip


def no_slip(recording: Recording, system: System) -> str:
    """Why a recording tells no friction at all: nothing moves where it acts, or only as a spring does; else empty."""
    found = (f.what for f in inspect(recording, system, inertia_free=False) if f.what.startswith(NO_SLIP))
    return next(found, "")
