"""Before any fit: what is assumed of a recording, what speaks against it, how well its motion was measured."""

from __future__ import annotations

import logging
from collections.abc import Collection

from ..data.filters import clear, sampled
from ..data.findings import Finding
from ..data.inspect import inspect
from ..data.recording import Recording
from ..data.thresholds import AS_MEASURED, CLEAR, FEWEST
from ..errors import UserError, choose
from ..numerics.placing import unplaced
from ..physics import System
from ..show import readable_unit
from .build import Config

log = logging.getLogger(__name__)
GO_ON = 'data.check=warn, in Python check="warn", goes on all the same'


def vet(cfg: Config, system: System, recording: Recording, free: Collection[str] = ()) -> None:
    """:func:`admit` the recording of a command; what it has simulated itself needs no check."""
    if cfg["data"]["name"] != "simulated":
        admit(system, recording, cfg["data"].get("check", "refuse"), free)


def admit(system: System, recording: Recording, check: str = "refuse", free: Collection[str] = ()) -> None:
    """Say what is assumed of a recording, and what speaks against it, before anything is learned from it.

    Args:
        system, recording: what was measured, SI units, and of what.
        check: "refuse" or "warn".
        free: parameters that are to be estimated.

    Raises:
        UserError: a finding by which no answer would have a sense, unless ``check`` is "warn".
    """
    refuse = choose(check, {"refuse": True, "warn": False}, "data.check")
    for line in assumptions(system, recording, free):
        log.info(line)
    findings = findings_of(system, recording, free)
    for finding in findings:
        log.warning(in_words(finding))
    grave = [f for f in findings if f.grave]
    if grave and refuse:
        more = f" (and {len(grave) - 1} more)" if len(grave) > 1 else ""
        raise UserError(f"no answer from this recording has a sense{more}: {grave[0].what}", where=recording.source,
                        fix="; ".join(filter(None, [grave[0].fix, GO_ON])))  # fmt: skip


def in_words(finding: Finding) -> str:
    """A finding as it is printed."""
    return f"{'wrong' if finding.grave else 'odd'}: {finding}"


def findings_of(system: System, recording: Recording, free: Collection[str] = ()) -> list[Finding]:
    """Findings of a recording; masses that are estimated are not held against it."""
    own = {par.name for par in system.parameters}
    return inspect(recording, system, inertia_free=bool(own & set(free)))


def assumptions(system: System, recording: Recording, free: Collection[str] = ()) -> list[str]:
    """Parameters in force, columns used and ignored, what is derived, what is set to zero, what was mended."""
    present = set().union(*(trial.signals for trial in recording.trials))
    known = [(par.name, system.values[par.name], readable_unit(par.unit)) for par in system.parameters]
    values = [f"{name} = {value:g} {unit}" for name, value, unit in known if name not in free]
    lines = [f"assumed: {', '.join(values)} (system.parameters)"] if values else []
    if system.values.get("preload") == 1.0 and "preload" not in free:
        lines[-1] += f"; mu_c and mu_s read in {readable_unit(system.force_unit)}: the preload is 1"
    lines += list(recording.notes) or [f"signals used: {', '.join(n for n in system.signal_units if n in present)}"]
    shown = [c for c in system.moving if present & set(c.signals)]
    derived = [n for c in shown for n in c.signals if n and n not in present]
    zero = [item.name for item in system.inputs if item.name not in present and item.symbol in system.acting]
    lines += [f"derived: {', '.join(derived)}"] if derived else []
    found = [c.signals[0] for c in unplaced(system, present)]
    for c in (c for c in shown if c.symbols[0] in system.acting and c.signals[0] not in present):
        where = "where a trial begins is worked out from its forces" if c.signals[0] in found else "it begins near 0"
        lines.append(f"not recorded, though it acts: {c.signals[0]}; {where}")
    lines += [f"not recorded, taken as zero: {', '.join(zero)}"] if zero else []
    return lines + [note for trial in recording.trials for note in trial.notes]


def measured_well(system: System, recording: Recording) -> bool:
    """Whether force and slip were measured so well that the motion need not be simulated."""
    acting = [item.name for item in system.inputs]
    if system.massless or len(system.moving) != 1 or len(acting) != 1:
        return False
    (c,), (force,) = system.moving, acting
    names = [*c.signals, force]
    trials, sigmas = sampled(recording, names)
    if not trials or force not in sigmas or not all(force in t.signals for t in trials):
        return False
    width = FEWEST * max(t.dt for t in trials)
    shares: list[float] = []
    for order, name in ((0, c.signals[1]), (1, c.signals[0])):
        if name in sigmas and all(name in t.signals for t in trials):
            shares.append(clear(trials, name, sigmas[name], width, order)[0])
    return max(shares, default=0.0) > 1 - AS_MEASURED and clear(trials, force, sigmas[force], width, 0)[0] > CLEAR
