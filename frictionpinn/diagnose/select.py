"""Forward selection of what a declared model lacks: tested, refitted, judged on trials that no fit saw."""

from __future__ import annotations

import logging
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.stats import chi2

from ..numerics.parallel import in_parallel
from .bench import Bench
from .candidates import Candidate, Remainder, impossible
from .evidence import surprise
from .fit import Fit
from .intervals import intervals
from .scan import Scanned, Tested, scan
from .score import ALIKE

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Settings:
    """What a diagnosis may be told.

    Attributes:
        log_p: decimal logarithm of the chance, over all candidates, below which one counts as significant: one
            recording in 10,000 that lacks nothing is said to.
        most: effects that are added at most, a budget.
        refits: candidates that are refitted after each kind of score test, a budget.
        followed: the best of these that are searched for other minima, a budget.
        told_apart: evidence, in log-likelihood, from which one model is better than another for certain: 400 to 1.
        tied: evidence below which the more usual effect stands first: less than 3 to 1.
        same: cosine of what two candidates explain, from which they act the same way.
        gain: log-likelihood that the held-out trials must gain: a model that is no better there gains nothing.
        worth: root mean square of what is left over that of the friction force, from which it matters: friction itself
            repeats to a few per cent from day to day, and a long recording makes far less significant.
    """

    log_p: float = -4.0
    most: int = 4
    refits: int = 5
    followed: int = 2
    told_apart: float = 6.0
    tied: float = 1.0
    same: float = 0.9
    gain: float = 1.0
    worth: float = 0.01


@dataclass(frozen=True)
class Refused:
    """A candidate that was not added, and why."""

    candidate: Candidate
    why: str


@dataclass(frozen=True)
class Accepted:
    """A candidate that was added.

    Attributes:
        candidate, tested: what was found.
        evidence: statistic, log10_p, gain on the fitted and on the held-out trials.
        alike: candidates that explain the same data as well, with the strengths that they would have.
    """

    candidate: Candidate
    tested: Tested
    evidence: dict[str, float]
    alike: tuple[tuple[Candidate, dict[str, float]], ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Its parameters."""
        return (*self.candidate.strengths, *self.candidate.hidden)


@dataclass
class Selection:
    """What forward selection did.

    Attributes:
        base, fit: the declared model, and the last accepted one, on the fitted trials.
        first, last: what the score tests at the declared and at the last model found.
        accepted: effects in the order in which they came.
        refused: candidates with a reason.
        fits: name of the effect that was added last -> the fit then.
    """

    base: Fit
    fit: Fit
    first: Scanned
    last: Scanned
    accepted: list[Accepted] = field(default_factory=list)
    refused: list[Refused] = field(default_factory=list)
    fits: dict[str, Fit] = field(default_factory=dict)

    @property
    def path(self) -> list[Fit]:
        """The fits after each effect but the last, in the order in which they came."""
        return [self.fits[a.candidate.name] for a in self.accepted[:-1]]


@dataclass(frozen=True)
class Contender:
    """A candidate with its refit, and what trials that no fit saw say of that (negative log-likelihood)."""

    tested: Tested
    fit: Fit
    surprise: float | None = None

    @property
    def cost(self) -> float:
        """Negative evidence of all trials."""
        return self.fit.cost + (self.surprise or 0.0)


def select(
    bench: Bench,
    options: Sequence[Candidate],
    remainders: Sequence[Remainder],
    places: Mapping[str, float],
    settings: Settings,
) -> Selection:
    """Find what the declared model lacks.

    1. The declared model is fitted by maximum likelihood, from a coarse resolution in time to the single sample.
    2. Every candidate, and every force and friction that depends on one variable in any way, is score-tested at the
       fit: at the sample and, where that leaves more than noise or anything shows, at a coarse resolution too: there a
       stop that comes late spoils less, and what shifts a jump (a sensor's delay) has a derivative.
    3. The most significant are refitted with all parameters from where they were tested down to the sample, and ranked
       by their evidence.
    4. Those that are not told apart are judged by the evidence of the held-out trials. What stays within reach of the
       winner and acts the same way is reported as alike, the more usual effect first.
    5. The winner is kept if fitted and held-out trials both speak for it and a mechanism can have it; what it makes
       superfluous is taken out; and again from 2.
    6. What is left is judged by :func:`frictionpinn.diagnose.verdict.judge`.

    Args:
        bench: the fitted declared model.
        options: candidates.
        remainders, places: forces that depend on a variable, see :func:`frictionpinn.diagnose.scan.scan`.
        settings: significances and budgets.
    """

    def tested(fit: Fit, accepted: Sequence[Accepted]) -> Scanned:
        taken = {name for a in accepted for name in a.candidate.strengths}
        # What shapes an effect that is part of the model is known: its other strengths are tested with that.
        present = {a.candidate.effect for a in accepted}
        left = [replace(c, hidden=(), grid=({},)) if c.effect in present else c for c in options]
        return scan(bench, fit, [c for c in left if not taken & set(c.strengths)], remainders, places)

    chance = settings.log_p - float(np.log10(max(len(options), 1)))
    fit = bench.base
    scanned = tested(fit, ())
    selection = Selection(fit, fit, scanned, scanned)
    while len(selection.accepted) < settings.most:
        before = selection.fit
        banned = {r.candidate.name for r in selection.refused}
        asked = [(t, 0.0, group) for t, group in _heads(selection.last.tested, banned, chance, settings)]
        if (asked or not before.white) and (width := _coarse(bench)):
            coarse = bench.refit(before, before.names, before.values, widths=[width])
            if coarse is not None:
                seen, known = tested(coarse, selection.accepted).tested, {t.candidate.name for t, _, _ in asked}
                heads = _heads(seen, banned, chance, settings)
                asked += [(t, width, group) for t, group in heads if t.candidate.name not in known]
        if not asked:
            break
        found = _refitted(bench, before, asked, settings)
        winner, alike, refused = _judged(bench, before, found, asked, settings)
        selection.refused += refused
        if winner is None:
            break
        saved = replace(selection, accepted=list(selection.accepted), fits=dict(selection.fits))
        selection.accepted.append(_accepted(before, winner, alike))
        selection.fit = bench.settle(winner.fit)
        _drop(bench, selection, settings)
        selection.last = tested(selection.fit, selection.accepted)
        if why := _impossible(bench, selection):
            selection = replace(saved, refused=[*selection.refused, Refused(winner.tested.candidate, why)])
            continue
        if selection.accepted:
            selection.fits[selection.accepted[-1].candidate.name] = selection.fit
        log.info(f"  {[a.candidate.name for a in selection.accepted]}, cost {selection.fit.state.cost:.1f}")
    return selection


def _coarse(bench: Bench) -> float:
    """Resolution of the second score tests, s: a quarter of the coarsest at which a fit begins; 0 without any."""
    return bench.widths[min(2, len(bench.widths) - 1)]


def _heads(
    tests: Sequence[Tested], banned: Collection[str], chance: float, settings: Settings
) -> list[tuple[Tested, list[Tested]]]:
    """The most significant candidates, each with those that the score tests do not tell from it; and of those that
    could not be tested, since their derivatives overflow, the ones with a single parameter."""
    heads: list[tuple[Tested, list[Tested]]] = []
    tests = [t for t in tests if t.candidate.name not in banned]
    for t in sorted(tests, key=lambda t: t.log_p):
        group = next((g for head, g in heads if cosine(head, t) > ALIKE), None)
        if group is not None:
            group.append(t)
        elif t.log_p < chance and len(heads) < settings.refits:
            heads.append((t, []))
    single = [t for t in tests if t.untested and len(t.candidate.strengths) == 1 and not t.candidate.hidden]
    return heads + [(t, []) for t in sorted(single, key=lambda t: t.candidate.usual)]


def cosine(one: Tested, other: Tested) -> float:
    """Of what two candidates explain: 1 where the score tests cannot tell them apart, 0 if tested elsewhere."""
    return abs(float(one.trace @ other.trace)) if len(one.trace) == len(other.trace) else 0.0


def _refitted(
    bench: Bench, before: Fit, asked: Sequence[tuple[Tested, float, list[Tested]]], settings: Settings
) -> list[Contender]:
    """The candidates' fits, the best first.

    Each goes from the resolution at which it was tested down to the sample. Where that leaves more than noise, the best
    are begun anew over short windows; and the others from where the best of these ended.
    """

    def refit(k: int) -> Fit | None:
        tested, width, _ = asked[k]
        return add(bench, before, tested, [w for w in bench.widths if w <= width])

    made = in_parallel(refit, [1.0] * len(asked))
    found = sorted(
        (Contender(tested, fit) for (tested, _, _), fit in zip(asked, made, strict=True) if fit is not None),
        key=lambda c: c.fit.cost,
    )
    rugged = [c for c in found[: settings.followed] if not c.fit.white and c.fit.cost < before.cost]
    anew = in_parallel(lambda k: bench.anew(rugged[k].fit, reach(rugged[k].tested)), [1.0] * len(rugged))
    lower = [Contender(c.tested, f) for c, f in zip(rugged, anew, strict=True) if f and f.state.cost < c.fit.state.cost]
    if not lower:
        return found
    best = min(lower, key=lambda c: c.fit.cost)
    others = [c for c in found if c.tested is not best.tested]
    moved = in_parallel(lambda k: _moved(bench, others[k], best), [1.0] * len(others))
    every: dict[str, Contender] = {}
    for c in [*found, *lower, *(replace(c, fit=f) for c, f in zip(others, moved, strict=True) if f)]:
        known = every.get(c.tested.candidate.name)
        every[c.tested.candidate.name] = c if known is None or c.fit.cost < known.fit.cost else known
    return sorted(every.values(), key=lambda c: c.fit.cost)


def _moved(bench: Bench, own: Contender, best: Contender) -> Fit | None:
    """A contender refitted from the best's place, with its own strengths for the best's."""
    mine = {name: own.fit.values[name] for name in own.fit.names if name not in best.fit.names}
    neutral = dict.fromkeys(best.tested.candidate.strengths, 0.0)
    values = best.fit.values | neutral | mine
    return bench.refit(best.fit, own.fit.names, values, limits=reach(own.tested))


def add(bench: Bench, fit: Fit, tested: Tested, widths: Sequence[float]) -> Fit | None:
    """Refit with a candidate's strengths and hidden parameters, from neutral: Gauss-Newton moves all parameters
    together; where no derivative holds, from a guess as well."""
    names = (*fit.names, *tested.candidate.strengths, *tested.candidate.hidden)
    made = []
    for share in (0.0, 1.0) if tested.untested else (0.0,):
        values = {**fit.values, **tested.shape} | {name: share * value for name, value in tested.step.items()}
        made.append(bench.refit(fit, names, bench.clip(values), limits=reach(tested), widths=widths))
    return min((f for f in made if f is not None), key=lambda f: f.state.cost, default=None)


def reach(tested: Tested) -> dict[str, tuple[float, float]]:
    """Values that hidden parameters may take: those tried, and somewhat beyond."""
    result = {}
    for name in tested.candidate.hidden:
        values = [point[name] for point in tested.candidate.grid]
        low, high = min(values), max(values)
        wide = 0.1 * (high - low)
        result[name] = (low / 1.5, high * 1.5) if low > 0 else (low - wide, high + wide)
    return result


def _judged(
    bench: Bench,
    before: Fit,
    found: Sequence[Contender],
    asked: Sequence[tuple[Tested, float, list[Tested]]],
    settings: Settings,
) -> tuple[Contender | None, list[Contender], list[Refused]]:
    """The contender that is kept, those that are alike, and those that are refused."""
    refused: list[Refused] = []
    reference = surprise(bench, before)
    left = []
    for c in found:
        gain, need = before.state.cost - c.fit.state.cost, needed(c.tested, settings)
        if gain < need:
            why = f"refitted, it gains {gain:.1f} in log-likelihood; {need:.1f} are needed"
            refused.append(Refused(c.tested.candidate, why))
        elif why := impossible(bench, c.tested.candidate, c.fit.values):
            refused.append(Refused(c.tested.candidate, why))
        else:
            left.append(c)
    while left:
        near = [c for c in left if c.fit.cost < left[0].fit.cost + settings.told_apart]
        name, names = near[0].tested.candidate.name, {c.tested.candidate.name for c in near}
        twins = [t for head, _, group in asked if head.candidate.name == name for t in group]
        near += _twins(bench, before, near[0], [t for t in twins if t.candidate.name not in names], settings)
        judged = _surprises(bench, [c.fit for c in near])
        worst = np.inf if reference is not None else None
        near = [replace(c, surprise=s if s is not None else worst) for c, s in zip(near, judged, strict=True)]
        best = min(near, key=lambda c: c.cost)
        level = [c for c in near if c.cost < best.cost + settings.tied]
        winner = min(level, key=lambda c: (c.tested.candidate.usual, min(c.fit.values[n] for n in c.tested.step) < 0))
        alike = [
            c for c in near
            if c is not winner and c.cost < best.cost + settings.told_apart
            and cosine(c.tested, winner.tested) > settings.same
        ]  # fmt: skip
        gain = np.inf if reference is None or winner.surprise is None else reference - winner.surprise
        if gain >= settings.gain:
            names = {c.tested.candidate.name for c in (winner, *alike)}
            refused += [
                Refused(c.tested.candidate, f"explains less than {winner.tested.candidate.name}")
                for c in near if c.tested.candidate.name not in names
            ]  # fmt: skip
            return replace(winner, surprise=gain), alike, refused
        refused += [
            Refused(c.tested.candidate, f"held-out trials do not improve ({gain:+.1f} in log-likelihood)")
            for c in (winner, *alike)
        ]  # fmt: skip
        gone = {c.tested.candidate.name for c in (winner, *alike)}
        left = [c for c in left if c.tested.candidate.name not in gone]
    return None, [], refused


def _surprises(bench: Bench, fits: Sequence[Fit]) -> list[float | None]:
    return in_parallel(lambda k: surprise(bench, fits[k]), [1.0] * len(fits))


def _twins(bench: Bench, before: Fit, head: Contender, twins: Sequence[Tested], settings: Settings) -> list[Contender]:
    """Those that the score tests did not tell from a contender, refitted from its fit, as far as they come near."""

    def refit(k: int) -> Fit | None:
        own = twins[k]
        names = (*before.names, *own.candidate.strengths, *own.candidate.hidden)
        values = head.fit.values | dict.fromkeys(head.tested.candidate.strengths, 0.0) | own.shape | own.step
        if len(own.step) == len(head.tested.step) == 1:
            ((name, step),), ((other, unit),) = own.step.items(), head.tested.step.items()
            values[name] = head.fit.values[other] * step / unit if unit else step
        return bench.refit(head.fit, names, bench.clip(values), limits=reach(own))

    made = in_parallel(refit, [1.0] * len(twins))
    return [
        Contender(t, fit) for t, fit in zip(twins, made, strict=True)
        if fit is not None and fit.cost < head.fit.cost + settings.told_apart
        and not impossible(bench, t.candidate, fit.values)
    ]  # fmt: skip


def _accepted(before: Fit, winner: Contender, alike: Sequence[Contender]) -> Accepted:
    told = np.nan if winner.tested.untested else 1.0
    evidence = {
        "statistic": told * winner.tested.statistic, "log10_p": told * winner.tested.log_p,
        "gain_fitted": before.state.cost - winner.fit.state.cost,
    }  # fmt: skip
    if winner.surprise is not None and np.isfinite(winner.surprise):
        evidence["gain_held_out"] = winner.surprise
    others = tuple((c.tested.candidate, {n: c.fit.values[n] for n in c.tested.candidate.strengths}) for c in alike)
    return Accepted(winner.tested.candidate, winner.tested, evidence, others)


def needed(tested: Tested, settings: Settings) -> float:
    """Log-likelihood that a candidate must gain, refitted."""
    freedom = max(tested.freedom, 1)
    return float(chi2.isf(10.0**settings.log_p / 50, freedom)) / 2


def _drop(bench: Bench, selection: Selection, settings: Settings) -> None:
    """Take out effects without which the fit is as good from where it is now.

    Those that came first may not be needed beside later ones; and the last may have gained nothing but a way out of a
    wrong minimum.
    """
    for a in list(selection.accepted):
        fit = selection.fit
        kept = {name for b in selection.accepted if b is not a for name in b.names}
        names = tuple(n for n in fit.names if n not in a.names or n in kept)
        gone = [n for n in a.candidate.strengths if n not in names]
        values = bench.without(fit, gone, [n for n in a.candidate.hidden if n not in names])
        found = bench.refit(fit, names, values)
        loss = np.inf if found is None else found.state.cost - fit.state.cost
        if found is not None and loss < needed(a.tested, settings):
            why = f"not needed in the end ({loss:+.1f} in log-likelihood without it)"
            selection.refused.append(Refused(a.candidate, why))
            selection.accepted.remove(a)
            selection.fit = found
            if not selection.accepted:
                selection.base = found


def _impossible(bench: Bench, selection: Selection) -> str:
    """Why one of the effects is such as no mechanism has with the last one; empty where none is."""
    told = intervals(bench, selection.fit, selection.last)[1]
    for a in selection.accepted:
        if why := impossible(bench, a.candidate, selection.fit.values, told):
            own = a is selection.accepted[-1]
            return why if own else f"with it {a.candidate.name} is not possible: {why}"
    return ""
