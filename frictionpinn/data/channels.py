"""What single channels show: saturation, coarse steps, constants, angles beyond reason, a contact that never slips."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ..numerics.motion_function import motion_function
from ..numerics.quantisation import quantisation_step
from ..physics import System
from ..show import readable_unit
from .filters import Sampled, clear, filtered, noises, smooth_motion, widths
from .findings import NO_SLIP, Finding
from .recording import Recording
from .thresholds import AT_REST, CLEAR, DEAD, HELD, LEVELS, NEAR_END, ONE_WAY, PILED, REPEATED, SURE, TURNS

ROUNDED = 1e-6  # of a step: even grids interpolate


def channel_findings(system: System, recording: Recording, trials: Sequence[Sampled]) -> list[Finding]:
    """Findings of every signal of the system by itself."""
    units, positions = system.signal_units, {c.signals[0] for c in system.moving}
    findings: list[Finding] = []
    inputs = {item.name for item in system.inputs}
    companions = {name: other for c in system.moving for name, other in
                  [(c.signals[0], c.signals[1]), (c.signals[1], c.signals[2])]}  # fmt: skip
    for c in system.moving:
        if not any(name in t.signals for name in c.signals for t in recording.trials):
            fix = f"record at least one of {', '.join(c.signals)}, or take a system without it"
            findings.append(Finding(f"nothing of {c.name} was recorded", fix, grave=True))
    for name in units:
        parts = [np.asarray(t.signals[name], float) for t in recording.trials if name in t.signals]
        if not parts:
            continue
        values = np.concatenate(parts)
        low, high = float(values.min()), float(values.max())
        if low == high:
            what = f"{name} is {low:g} in every row"
            findings.append(Finding(what, "right if nothing acts there; else check its column") if name in inputs
                            else Finding(what, "leave the column out, or check it", grave=True))  # fmt: skip
            continue
        findings += _clipped(name, parts, trials, companions.get(name), name in inputs)
        step = quantisation_step(parts)
        if step and (high - low) / step < LEVELS:
            findings.append(Finding(
                f"{name} was recorded in steps of {step:.3g} {readable_unit(units[name])}, "
                f"{round((high - low) / step)} in its range",
                "record it with a finer resolution, or leave it out where another signal tells the same"))  # fmt: skip
        if units[name] == "rad" and name in positions and (high - low) > TURNS * 2 * math.pi:
            findings.append(Finding(f"{name} goes through {(high - low) / 2 / math.pi:.3g} turns",
                                    f"if it is in degrees say data.units={{{name}: deg, default: SI}}"))  # fmt: skip
    return findings


def _clipped(
    name: str, parts: list[np.ndarray], trials: Sequence[Sampled], companion: str | None, command: bool
) -> list[Finding]:
    """A signal that stays at its largest or smallest value while it should go on."""
    values = np.concatenate(parts)
    ends = []
    for end in (float(values.max()), float(values.min())):
        beside = [v for v in (values.max(), values.min()) if v != end]
        at = np.concatenate([_held(part == end) for part in parts])
        span = abs(end - beside[0]) if beside else 0.0
        near = np.count_nonzero((values != end) & (np.abs(values - end) < NEAR_END * span))
        share = float(np.mean(at))
        if share < HELD or np.count_nonzero(at) < PILED * near or end == 0.0:
            continue
        if companion and not _moves_while(name, end, companion, trials):
            continue
        ends.append(f"{end:.4g} ({100 * share:.0f} % of the time)")
    if not ends:
        return []
    what = f"{name} stays at its very end, {' and '.join(ends)}"
    if command:
        return [Finding(f"{what}: saturated, or commanded so", "check the sensor's range if it was measured")]
    return [Finding(f"{what}: clipped", "record with a larger range, or leave the column out", True, spoilt=name)]


def _held(at: np.ndarray) -> np.ndarray:
    """Samples that equal the one before or after them, too; not those with which a trial begins or ends, at rest."""
    pairs = at[1:] & at[:-1]
    inside = np.logical_or.accumulate(~at) & np.logical_or.accumulate(~at[::-1])[::-1]
    return inside & (np.concatenate([[False], pairs]) | np.concatenate([pairs, [False]]))


def _moves_while(name: str, end: float, companion: str, trials: Sequence[Sampled]) -> bool:
    """Whether a signal's rate moves while the signal holds its end; without one, whether it runs into its end as what
    is cut off does: what comes to rest there slows down before."""
    rates = [(t.signals[companion], t.signals[name] == end) for t in trials if {name, companion} <= set(t.signals)]
    if not rates:
        parts = [np.asarray(t.signals[name], float) for t in trials if name in t.signals]
        steps = np.concatenate([np.abs(np.diff(part)) for part in parts])
        whole = float(np.sqrt(np.mean(steps[steps > 0] ** 2)))
        into = np.concatenate([np.diff(np.abs(part - end) < ROUNDED * whole) for part in parts])
        return not into.any() or float(np.median(steps[into])) > AT_REST * whole
    rate, at = (np.concatenate(column) for column in zip(*rates, strict=True))
    whole = float(np.sqrt(np.mean(rate**2)))
    return bool(at.any() and np.sqrt(np.mean(rate[at] ** 2)) > AT_REST * whole)


def dead_findings(system: System, trials: Sequence[Sampled]) -> list[Finding]:
    """Signals of one value throughout a trial, or from some time on, in which another of their coordinate says that it
    moves."""
    findings = []
    for c in system.moving:
        for k, name in enumerate(c.signals):
            own = [t for t in trials if name in t.signals]
            usual = max((float(np.std(t.signals[name])) for t in own), default=0.0)
            for t in own if usual > 0 else ():
                values, held = t.signals[name], _held_last(t.signals[name])
                last = t.last(held)
                others = [(j, other) for j, other in enumerate(c.signals) if other in t.signals and j != k]
                telling = [other for j, other in others if held and _implied(last, other, k - j) > AT_REST * usual]
                if telling:
                    when = "in every row" if held == len(values) else f"in the last {held * t.dt:.3g} s"
                    what = f"{name} is {values[-1] + 0.0:g} {when} of trial '{t.name}', where {telling[0]} moves"
                    findings.append(Finding(what, "check its column and its sensor, or leave that trial out", True))
    return findings


def _held_last(values: np.ndarray) -> int:
    """How many samples at the end have one value: all of them, or so many that a signal whose values else hardly ever
    repeat, its noise, is no longer measured; else 0."""
    changes = np.flatnonzero(np.diff(values))
    if not len(changes):
        return len(values)
    held, before = len(values) - 1 - changes[-1], changes[-1] + 1
    return int(held) if held > DEAD * len(values) and len(changes) > (1 - REPEATED) * before else 0


def moving_trials(system: System, trials: Sequence[Sampled]) -> list[Sampled]:
    """The trials in which a coordinate moves by what is no rest beside its motion in the others."""
    names = [name for c in system.moving for name in c.signals]
    sizes = [{name: float(np.std(t.signals[name])) for name in names if name in t.signals} for t in trials]
    usual = {name: max(own.get(name, 0.0) for own in sizes) for name in names}
    moved = (any(size > AT_REST * usual[name] for name, size in own.items()) for own in sizes)
    return [t for t, moves in zip(trials, moved, strict=True) if moves]


def _implied(trial: Sampled, name: str, order: int) -> float:
    """Standard deviation of a signal's rate of that order, of its integral where that is negative, as far as it is
    clear of noise; else 0."""
    sigma = noises([trial])[name]
    for width in widths([trial]):
        share, varied = clear([trial], name, sigma, width, max(order, 0))
        if share < CLEAR:
            continue
        if order >= 0:
            return math.sqrt(varied)
        integral = filtered(trial, name, width)
        for _ in range(-order):
            integral = np.cumsum(integral - integral.mean()) * trial.dt
        return float(np.std(integral))
    return 0.0


def slip_findings(system: System, trials: Sequence[Sampled], sigmas: dict[str, float]) -> list[Finding]:
    """Nothing moves where the friction acts: as far as the noise shows."""
    slipping = [c for c in system.moving if any(at.jacobian[c.name] != 0 for at in system.each)]
    told: list[str] = []
    for c in slipping:
        present = [(k, name) for k, name in enumerate(c.signals) if name in sigmas]
        for k, name in present:
            order = max(1 - k, 0)
            usual = [t for t in trials if name in t.signals]
            if not any(t.span > 2 * w for t in usual for w in widths(usual)[:1]):
                return []  # too short to tell
            if any(_stands_out(usual, name, sigmas[name], w, order) for w in widths(usual) if usual):
                return []
            told.append(name)
    if not told:
        return []
    rms = {n: np.sqrt(np.mean(np.concatenate([t.signals[n] for t in trials if n in t.signals]) ** 2)) for n in told}
    sizes = ", ".join(f"{n} {value:.2g}" for n, value in rms.items())
    return [Finding(f"{NO_SLIP}: no friction can be told ({sizes} rms, no more than noise)",
                    "record a motion that breaks loose, or check the columns", grave=True)]  # fmt: skip


def one_way_findings(system: System, trials: Sequence[Sampled], sigmas: dict[str, float]) -> list[Finding]:
    """Contacts that slip in one direction: there dry friction, its asymmetry and a constant force are the same."""
    told = [any(name in sigmas for name in c.signals[:2]) for c in system.moving]  # an acceleration tells no direction
    motions = smooth_motion(system, trials, sigmas) if all(told) else []
    values = {name: value for name, value in system.values.items() if value is not None}
    findings = []
    for at in system.each if motions else ():
        slip = motion_function(system, at.v_slip)
        if one_way(np.concatenate([slip(motion, values) for motion in motions])):
            where = f"{at.contacts[0].name} slips" if len(system.contacts) > 1 else "the contact slips"
            what = f"{where} one way only: its dry friction, an asymmetry and a constant force are one"
            findings.append(Finding(what, "record both directions, or take mu_c for their sum"))
    return findings


def one_way(v: np.ndarray) -> bool:
    """Whether a velocity has one sign wherever it is no stop."""
    fast = np.abs(v) > max(AT_REST * float(np.quantile(np.abs(v), 0.99)), 1e-12)
    return bool(fast.any() and not ONE_WAY < np.mean(v[fast] > 0) < 1 - ONE_WAY)


def _stands_out(trials: Sequence[Sampled], name: str, sigma: float, width: float, order: int) -> bool:
    """Whether a filtered signal varies by more than its noise would."""
    share, _ = clear(trials, name, sigma, width, order)
    independent = max(sum(t.span for t in trials) / width, 1.0)
    return share / max(1 - share, 1e-300) > SURE * math.sqrt(2 / independent)
