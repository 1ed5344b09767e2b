"""The check of a recording before any fit: every finding, the grave ones first."""

from __future__ import annotations

from ..errors import UserError
from ..physics import System
from .balance import balance_findings
from .channels import channel_findings, one_way_findings, slip_findings
from .check import check_trial
from .consistency import derivative_findings
from .filters import sampled
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
    for trial in recording.trials:  # files were checked as they were read; others may come from anywhere
        try:
            check_trial(trial, recording.source or "recording")
        except UserError as error:
            return [Finding(str(error), grave=True)]
    names = [name for name in system.signal_units if name != "t"]
    trials, sigmas = sampled(recording, names)
    if not trials:
        return []
    findings = channel_findings(system, recording, trials)
    still = slip_findings(system, trials, sigmas)
    findings += still
    if not still:
        findings += (rates := derivative_findings(system, trials, sigmas))
        if not rates and not any(f.grave for f in findings):
            findings += balance_findings(system, trials, sigmas, inertia_free)
            findings += one_way_findings(system, trials, sigmas)
    return sorted(findings, key=lambda f: not f.grave)


def no_slip(recording: Recording, system: System) -> str:
    """Why a recording tells no friction at all: nothing moves where it acts, or only as a spring does; else empty."""
    found = (f.what for f in inspect(recording, system, inertia_free=False) if f.what.startswith(NO_SLIP))
    return next(found, "")
