"""Whether velocities are the rates of their positions, accelerations those of their velocities, and if not, why."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise

import numpy as np

from ..physics import System
from .filters import Sampled, clear, filtered, noise_gain, widths
from .findings import Finding, named_factor, rescaled, unit_for
from .thresholds import ANOTHER, CLEAR, HALF, LATE, OFF, SEARCHED, SURE

Pair = tuple[str, str]


@dataclass(frozen=True)
class Relation:
    """How a signal goes with the rate of another: rate = scale * signal(t + lag) + offset.

    Attributes:
        share: of the rate's variance that the signal explains, noise of both taken out.
        lag: by which the signal comes late, s; ``error`` its standard error.
        offset: in units of the signal's standard deviation.
        duration: in which the rate changes by its own size, s.
    """

    scale: float
    share: float
    lag: float
    error: float
    offset: float
    duration: float
    sure: float  # of the scale, in standard errors from 1

    @property
    def goes(self) -> bool:
        """Whether the one is the rate of the other, up to a factor."""
        return self.share >= CLEAR

    @property
    def right(self) -> bool:
        """Whether it is, as far as can be told."""
        return self.share >= HALF and not self.rescaled

    @property
    def rescaled(self) -> bool:
        """Whether it is up to a factor that is not 1."""
        off = not 1 / OFF < self.scale < OFF
        return self.share >= HALF and off and self.sure > SURE

    @property
    def late(self) -> bool:
        """Whether the signal comes late or early by what matters."""
        return self.goes and abs(self.lag) > max(SURE * self.error, LATE * self.duration)


def relate(trials: Sequence[Sampled], low: str, high: str, sigmas: dict[str, float]) -> Relation | None:
    """Compare ``high`` with the rate of ``low``; None where noise hides the one or the other."""
    own = [t for t in trials if low in t.signals and high in t.signals]
    found: list[Relation] = []
    for width in widths(own) if own else []:
        (one, varied), (other, signal) = (
            clear(own, low, sigmas[low], width, 1),
            clear(own, high, sigmas[high], width, 0),
        )
        if min(one, other) >= CLEAR:
            found.append(_through(own, low, high, width, varied, signal, sigmas))
            if found[-1].goes or len(found) == 4:
                break
    return max(found, key=lambda r: r.share, default=None)


def _through(
    trials: Sequence[Sampled], low: str, high: str, width: float, varied: float, signal: float, sigmas: dict[str, float]
) -> Relation:
    parts = [t for t in trials if t.span > 2 * width]
    rate = np.concatenate([filtered(t, low, width, 1) for t in parts])
    value = np.concatenate([filtered(t, high, width, 0) for t in parts])
    slope = np.concatenate([filtered(t, high, width, 1) for t in parts])
    middle, offset = float(value.mean()), float(rate.mean())
    rate, value = rate - offset, value - middle
    together = float(np.mean(rate * value))
    share = min(together**2 / max(varied * signal, 1e-300), 1.0)
    scale = math.copysign(math.sqrt(varied / max(signal, 1e-300)), together)
    # rate = s value + s lag slope: the slope's part is told beside the value's.
    A = np.stack([value, slope - slope.mean()], axis=1)
    coefficients, *_ = np.linalg.lstsq(A, rate, rcond=None)
    left = rate - A @ coefficients
    apart = parts[0].dt / noise_gain(parts[0], width)  # s: noise through the window is independent so far apart
    independent = max(sum(t.span for t in parts) / apart, 3.0)
    covariance = np.linalg.pinv(A.T @ A / len(rate)) * float(np.mean(left**2)) / independent
    s = coefficients[0] or 1e-300
    noise = sigmas[high] ** 2 * noise_gain(parts[0], width, 1)
    told = max(float(np.mean(A[:, 1] ** 2)) - noise, 1e-300) / float(np.mean(A[:, 1] ** 2))
    lag, error = float(coefficients[1] / s / max(told, 0.1)), float(np.sqrt(covariance[1, 1]) / abs(s))
    duration = math.sqrt(float(np.mean(value**2)) / max(float(np.mean(A[:, 1] ** 2)), 1e-300))
    spread = math.sqrt(max(1 - share, 0.0) / independent) + 1e-12
    sure = abs(math.log(max(abs(scale), 1e-300))) / spread if scale > 0 else math.sqrt(share) / spread
    return Relation(scale, share, lag, error, (offset - scale * middle) / math.sqrt(varied or 1e-300), duration, sure)


class Relations:
    """Relations of any two columns, each worked out once."""

    def __init__(self, trials: Sequence[Sampled], sigmas: dict[str, float]):
        self.trials, self.sigmas = trials, sigmas
        self._made: dict[Pair, Relation | None] = {}

    def __call__(self, low: str, high: str) -> Relation | None:
        if (low, high) not in self._made:
            self._made[low, high] = relate(self.trials, low, high, self.sigmas)
        return self._made[low, high]


def derivative_findings(system: System, trials: Sequence[Sampled], sigmas: dict[str, float]) -> list[Finding]:
    """What the derivatives of every coordinate say: scales, signs, swaps, delays, and what is none at all."""
    relations, units = Relations(trials, sigmas), system.signal_units
    present = [name for name in units if name in sigmas]
    coordinates = [[name for name in c.signals if name in present] for c in system.moving]
    told = {pair: relations(*pair) for c in system.moving for pair in pairwise(c.signals) if {*pair} <= {*present}}
    judged = {pair: r for pair, r in told.items() if r is not None}
    if all(r.right and not r.late for r in judged.values()):
        return [f for pair, r in judged.items() for f in _offset(pair, r)]
    if clock := _clock(judged):
        return [clock]
    if any(not (r.goes and abs(r.scale) > 0) or r.rescaled for r in judged.values()) and (
        swap := _swapped(relations, list(told), judged, present)
    ):
        return [swap]
    findings: list[Finding] = []
    for own in coordinates:
        mine = {pair: r for pair, r in judged.items() if pair[0] in own}
        findings += _of_coordinate(mine, units, relations, present)
    return findings


def _clock(judged: dict[Pair, Relation]) -> Finding | None:
    """Time in another unit: every rate is off by one and the same factor."""
    scales = [r.scale for r in judged.values()]
    if len(scales) < 2 or not all(r.rescaled and r.share > HALF for r in judged.values()) or min(scales) <= 0:
        return None
    middle = float(np.exp(np.mean(np.log(scales))))
    if max(abs(math.log(s / middle)) for s in scales) > math.log(OFF):
        return None
    unit = unit_for(1 / middle, "s")
    fix = f"data.units={{t: {unit}, default: SI}}" if unit else "correct data.units={t: ...}"
    return Finding(f"time is off by a factor of {named_factor(middle)}: so are all derivatives", fix, grave=True)


def _swapped(
    relations: Relations, pairs: list[Pair], judged: dict[Pair, Relation], present: list[str]
) -> Finding | None:
    """Two columns by whose exchange every derivative is right."""
    fitting = []
    for one, other in combinations(present, 2):
        new = {one: other, other: one}
        exchanged = [relations(new.get(low, low), new.get(high, high)) for low, high in pairs]
        touched = [r for r, pair in zip(exchanged, pairs, strict=True) if {one, other} & set(pair)]
        wrong = [pair for pair, r in judged.items() if not r.right]
        mended = all({one, other} & set(pair) for pair in wrong)
        if mended and touched and all(r is not None and r.goes and r.right and not r.late for r in touched):
            fitting.append((one, other))
    if not fitting:
        return None
    said = " or ".join(f"{one} and {other}" for one, other in fitting[:3])
    one, other = fitting[0]
    return Finding(f"columns swapped: with {said} exchanged every rate fits", "exchange them in data.columns, "
                   f"such as data.columns={{..., {one}: {other}, {other}: {one}}}", grave=True)  # fmt: skip


def _of_coordinate(
    mine: dict[Pair, Relation], units: dict[str, str], relations: Relations, present: list[str]
) -> list[Finding]:
    wrong = {pair: r for pair, r in mine.items() if not r.right or r.late}
    if not wrong:
        return []
    if len(wrong) == 2:  # of position, velocity and acceleration: the middle one does both, if the outer two agree
        (first, a), (second, b) = wrong.items()
        middle = first[1]
        if a.rescaled and b.rescaled and 1 / OFF < a.scale * b.scale < OFF:
            return [_off(middle, 1 / a.scale, units, f"the rate of {first[0]}")]
        if a.rescaled and b.rescaled:
            return [_off(first[0], a.scale, units, f"what {middle} is the rate of"),
                    _off(second[1], 1 / b.scale, units, f"the rate of {middle}")]  # fmt: skip
        if a.late and b.late and not a.rescaled and abs(a.lag + b.lag) < LATE * max(a.duration, b.duration) * ANOTHER:
            return [_late(middle, a.lag, f"the rate of {first[0]}")]
    findings = []
    for (low, high), r in wrong.items():
        if r.rescaled:
            confirmed = {n for pair, other in mine.items() if other.right and pair != (low, high) for n in pair}
            if high in confirmed:
                findings.append(_off(low, r.scale, units, f"what {high} is the rate of"))
            else:
                unless = "" if low in confirmed else low
                findings.append(_off(high, 1 / r.scale, units, f"the rate of {low}", unless))
        elif r.late:
            findings.append(_late(high, r.lag, f"the rate of {low}"))
        elif (better := _elsewhere(relations, low, high)) is not None:
            findings.append(_late(high, better.lag, f"the rate of {low}"))
        else:
            others = [name for name in present if name not in (low, high)]
            fits = [
                name for name in others if (found := relations(low, name)) is not None and found.goes and found.right
            ]
            fix = f"{fits[0]} fits better" if fits else "check the columns of both, or leave one of them out"
            findings.append(Finding(f"{high} is not the rate of {low}: that explains {100 * r.share:.0f} % of it", fix,
                                    grave=True))  # fmt: skip
    return findings


def _elsewhere(relations: Relations, low: str, high: str) -> Relation | None:
    """The relation with the signal moved in time by up to a tenth of the recording, where that fits."""
    trials = [t for t in relations.trials if low in t.signals and high in t.signals]
    usual = widths(trials)
    for width in usual[:4]:
        if min(clear(trials, low, relations.sigmas[low], width, 1)[0],
               clear(trials, high, relations.sigmas[high], width, 0)[0]) < CLEAR:  # fmt: skip
            continue
        rows = [(t.dt, filtered(t, low, width, 1), filtered(t, high, width, 0)) for t in trials if t.span > 2 * width]
        best: tuple[float, float, float] = (0.0, 0.0, 0.0)
        limit = SEARCHED * max(t.span for t in trials)
        for k in range(-200, 201):
            lag, xy, xx, yy = k * limit / 200, 0.0, 0.0, 0.0
            for dt, rate, value in rows:
                shift = round(lag / dt)
                a, b = (rate[: len(rate) - shift], value[shift:]) if shift >= 0 else (rate[-shift:], value[:shift])
                xy, xx, yy = xy + float(a @ b), xx + float(b @ b), yy + float(a @ a)
            share = xy * abs(xy) / max(xx * yy, 1e-300)
            best = max(best, (share, lag, xy / max(xx, 1e-300)))
        if best[0] >= CLEAR and 1 / OFF < best[2] < OFF:
            return Relation(best[2], best[0], best[1], 0.0, 0.0, 1.0, 0.0)
    return None


def _off(name: str, factor: float, units: dict[str, str], than: str, unless: str = "") -> Finding:
    """A signal that is ``factor`` times what it should be."""
    if 1 / OFF < -factor < OFF:
        what = f"{name} has its sign turned: it is {factor:.3g} times {than}"
    else:
        turned = " and its sign turned" if factor < 0 else ""
        size = named_factor(factor)
        what = f"{name} is {'too large' if abs(factor) > 1 else 'too small'} by {size}{turned}, compared with {than}"
    fix = rescaled(name, factor, units.get(name, ""))
    return Finding(what, fix + (f" (unless it is {unless} that is wrong)" if unless else ""), grave=True)


def _late(name: str, lag: float, than: str) -> Finding:
    """A delay; not grave, nor is an offset: a diagnosis can name them (sensor_delay, sensor_bias)."""
    how = "late" if lag > 0 else "early"
    return Finding(f"{name} comes {1e3 * abs(lag):.3g} ms {how}, compared with {than}",
                   "record without that filter, shift the column, or leave it out")  # fmt: skip


def _offset(pair: Pair, r: Relation) -> list[Finding]:
    """A signal with a constant that the rate has not: an accelerometer that shows gravity."""
    if abs(r.offset) <= 1.0:  # of its standard deviation: less is the diagnosis's (sensor_bias)
        return []
    low, high = pair
    return [Finding(f"{high} has an offset of {abs(r.offset):.2g} times its variation, compared with the rate of {low}",
                    "take it off (an accelerometer that shows gravity, a gyroscope's bias)")]  # fmt: skip
