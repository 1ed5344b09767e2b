"""Forward selection of what a declared model lacks: tested, refitted, judged on trials that no fit saw."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..identify.uncertainty import UNTOLD, interval
from ..progress import Steps
from .bench import Bench
from .candidates import Candidate, impossible
from .contenders import Asked, Contender, Refused, Settings, explains_less, in_place, judged, needed, refitted
from .fit import Fit
from .scan import Scanned, Tested, scan

ALIKE = 0.995  # share of a candidate's trace that another explains: the data do not tell them apart


@dataclass(frozen=True)
class Accepted:
    """A candidate that was added.

    Attributes:
        candidate, tested: what was found.
        evidence: statistic, log10_p, gain on the fitted and on the held-out trials.
        fit: the model when it was added.
        alike: candidates that explain the same data as well, with the strengths that they would have.
        others: what might have been added in its place.
    """

    candidate: Candidate
    tested: Tested
    evidence: dict[str, float]
    fit: Fit
    alike: tuple[tuple[Candidate, dict[str, float]], ...] = ()
    others: tuple[Accepted, ...] = ()

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
        refused: name -> candidate with the last reason why it was not added.
    """

    base: Fit
    fit: Fit
    first: Scanned
    last: Scanned
    accepted: list[Accepted] = field(default_factory=list)
    refused: dict[str, Refused] = field(default_factory=dict)


def select(bench: Bench, options: Sequence[Candidate], settings: Settings) -> Selection:
    """Find what the declared model lacks.

    1. The declared model is fitted by maximum likelihood, from a coarse resolution in time to the single sample.
    2. Every candidate, and every force and friction that depends on one variable in any way, is score-tested at the
       fit: at the sample and, where that leaves more than noise or anything shows, at a coarse resolution too: there a
       stop that comes late spoils less, and what shifts a jump (a sensor's delay) has a derivative.
    3. The most significant are refitted with all parameters from where they were tested down to the sample, and ranked
       by their evidence, each in its own minimum, see :func:`frictionpinn.diagnose.contenders.judged`.
    4. Those that are not told apart are judged by the evidence of the held-out trials, the more usual effect first.
    5. Where the winner has led to a minimum that is lower without it, too, all are tested anew around that. Else it
       is kept if fitted and held-out trials both speak for it and a mechanism can have it; what it makes superfluous,
       or such as no mechanism has, is taken out. Rivals of which its evidence does not tell it for certain, and that
       have nothing left to explain beside it, are reported as alike. Those that came before it are judged anew beside
       it, by the same evidence: what each was told from may explain as much now, or more. And again from 2.
    6. What is left is judged by :func:`frictionpinn.diagnose.verdict.judge`.

    Args:
        bench: the fitted declared model.
        options: candidates.
        settings: significances and budgets.
    """

    def tested(fit: Fit, accepted: Sequence[Accepted]) -> Scanned:
        taken = {name for a in accepted for name in a.candidate.strengths}
        # What shapes an effect that is part of the model is known: its other strengths are tested with that.
        present = {a.candidate.effect for a in accepted}
        left = [replace(c, hidden=(), grid=({},)) if c.effect in present else c for c in options]
        return scan(bench, fit, [c for c in left if not taken & set(c.strengths)])

    chance = settings.log_p - float(np.log10(max(len(options), 1)))
    banned: set[str] = set()  # what came and had to go again
    scanned = tested(bench.base, ())
    selection, rounds = Selection(bench.base, bench.base, scanned, scanned), Steps(settings.most, most=True)
    while len(selection.accepted) < settings.most:
        before = selection.fit
        asked = _heads(selection.last.tested, banned, chance, settings)
        if (asked or not before.white) and (width := bench.from_coarse[0]):
            coarse = bench.refit(before, before.names, before.values, widths=[width])
            if coarse is not None:
                known = {t.candidate.name for t, _ in asked}
                heads = _heads(tested(coarse, selection.accepted).tested, banned, chance, settings)
                asked += [(t, group) for t, group in heads if t.candidate.name not in known]
        if not asked:
            break
        found = refitted(bench, before, asked, settings)
        winner, rivals, refused = judged(bench, before, found, asked, settings)
        lower = None if winner is None else _without(bench, winner.fit, winner.candidate)
        if lower is not None and lower.state.cost < before.state.cost - settings.told_apart:
            lower = bench.settle(lower)
            selection.fit, selection.last = lower, tested(lower, selection.accepted)
            if selection.accepted:
                selection.accepted[-1] = replace(selection.accepted[-1], fit=lower)
            else:
                selection.base = lower
            continue
        selection.refused |= {r.candidate.name: r for r in refused}
        if winner is None:
            break
        saved = replace(selection, accepted=list(selection.accepted))
        selection.accepted.append(_accepted(before, winner, found, asked))
        selection.fit = bench.settle(winner.fit)
        dropped, anew = _drop(bench, options, selection, before, settings)
        anew |= _judged_anew(bench, options, selection, settings)
        selection.last = tested(selection.fit, selection.accepted)
        if why := _impossible(bench, selection):
            selection, dropped = saved, [Refused(winner.candidate, why)]
        elif not anew and selection.accepted and (own := selection.accepted[-1]).candidate is winner.candidate:
            beside = {t.candidate.name for t in selection.last.tested if t.log_p < chance}
            dropped += [explains_less(c, winner) for c in rivals if c.candidate.name in beside]
            alike = [c for c in rivals if c.candidate.name not in beside]
            selection.accepted[-1] = replace(own, alike=_alike(bench, options, winner, alike))
        selection.refused |= {r.candidate.name: r for r in dropped}
        banned |= {r.candidate.name for r in dropped}
        if selection.accepted:
            selection.accepted[-1] = replace(selection.accepted[-1], fit=selection.fit)
        names = [a.candidate.name for a in selection.accepted]
        rounds.finish(f"  added so far: {', '.join(names) or 'nothing'}", len(names))
    return selection


def _heads(tests: Sequence[Tested], banned: Collection[str], chance: float, settings: Settings) -> Asked:
    """The most significant candidates, each with those that the score tests do not tell from it; and of those that
    could not be tested, since their derivatives overflow, the ones with a single parameter."""
    heads: Asked = []
    tests = [t for t in tests if t.candidate.name not in banned]
    for t in sorted(tests, key=lambda t: t.log_p):
        group = next((g for head, g in heads if _cosine(head, t) > ALIKE), None)
        if group is not None:
            group.append(t)
        elif t.log_p < chance and len(heads) < settings.refits:
            heads.append((t, []))
    single = [t for t in tests if t.untested and len(t.candidate.strengths) == 1 and not t.candidate.hidden]
    return heads + [(t, []) for t in sorted(single, key=lambda t: t.candidate.usual)]


def _cosine(one: Tested, other: Tested) -> float:
    """Of what two candidates explain: 1 where the score tests cannot tell them apart, 0 if tested elsewhere."""
    return abs(float(one.trace @ other.trace)) if len(one.trace) == len(other.trace) else 0.0


def _without(bench: Bench, fit: Fit, candidate: Candidate, kept: Collection[str] = ()) -> Fit | None:
    """A fit without a candidate, but for parameters that are ``kept``: from where the motion is nearest to its own."""
    strengths, hidden = ([n for n in own if n not in kept] for own in (candidate.strengths, candidate.hidden))
    names = tuple(n for n in fit.names if n not in {*strengths, *hidden})
    return bench.imitated(fit, names, bench.without(fit, strengths, hidden))


def _evidence(before: Fit, winner: Contender) -> dict[str, float]:
    """What speaks for the winner: its score test, and what fitted and held-out trials gain."""
    told = np.nan if winner.tested.untested else 1.0
    evidence = {
        "statistic": told * winner.tested.statistic, "log10_p": told * winner.tested.log_p,
        "gain_fitted": before.state.cost - winner.fit.state.cost,
    }  # fmt: skip
    return evidence if winner.gain is None else evidence | {"gain_held_out": winner.gain}


def _accepted(before: Fit, winner: Contender, found: Sequence[Contender], asked: Asked) -> Accepted:
    """The winner as it is added, with what else was asked: as it was fitted, or else as the winner, its like. Of what
    was tested twice the test at the sample is taken, for the winner too: statistics and steps of two resolutions do not
    compare."""
    fits = {c.candidate.name: c.fit for c in found}
    tests = {t.candidate.name: t for head, group in asked[::-1] for t in (head, *group)}
    made = [Contender(t, fits.get(name, winner.fit)) for name, t in tests.items() if name != winner.candidate.name]
    others = tuple(Accepted(c.candidate, c.tested, _evidence(before, c), c.fit) for c in made)
    name = winner.candidate.name
    return Accepted(winner.candidate, tests[name], _evidence(before, winner), winner.fit, others=others)


def _judged_anew(
    bench: Bench, options: Sequence[Candidate], selection: Selection, settings: Settings, gone: bool = False
) -> bool:
    """Judge every effect, and what was asked for in its place, beside those that came later; and where one is ``gone``
    or that exchanges one, the last as well, which was judged beside that. Whether it exchanges one."""
    exchanged = False
    for k, a in enumerate(selection.accepted):
        if k == len(selection.accepted) - 1 and not (gone or exchanged):
            break
        beside = [b for b in selection.accepted if b.candidate is not a.candidate]
        there = {b.candidate.name for b in beside}
        known = [o.tested for o in a.others if o.candidate.name in there]  # what acts as these has nothing to explain
        others = {o.candidate.name: o for o in a.others if all(_cosine(o.tested, t) < ALIKE for t in known)}
        least = settings.instead * a.tested.statistic
        tests = [o.tested for name, o in others.items() if name not in there and o.tested.statistic >= least]
        kept = {name for b in beside for name in b.names}
        names = [name for name in selection.fit.names if name in kept or name not in a.names]
        winner, rivals = in_place(bench, names, Contender(a.tested, selection.fit), tests, settings)
        if winner.candidate is not a.candidate:
            selection.fit, chosen, exchanged = bench.settle(winner.fit), others[winner.candidate.name], True
            a = replace(chosen, others=tuple(o for o in (a, *a.others) if o is not chosen))
        selection.accepted[k] = replace(a, alike=_alike(bench, options, winner, rivals))
    return exchanged


def _alike(
    bench: Bench, options: Sequence[Candidate], winner: Contender, alike: Sequence[Contender]
) -> tuple[tuple[Candidate, dict[str, float]], ...]:
    """What is alike, with its strengths: fits that are about as good, and what is the same by definition."""
    others = [(c.candidate, {n: c.fit.values[n] for n in c.candidate.strengths}) for c in alike]
    same = _equivalents(bench, winner.candidate, winner.fit.values)
    listed = {candidate.name for candidate, _ in others}
    return (*others, *(
        (c, {n: same[n] for n in c.strengths})
        for c in options if same.keys() >= {*c.strengths} and c.name not in listed
    ))  # fmt: skip


def _equivalents(bench: Bench, winner: Candidate, values: Mapping[str, float]) -> dict[str, float]:
    """Strengths that act as the winner's by definition, with the values they would have, see
    :meth:`frictionpinn.physics.effect.Effect.equivalents`."""
    found = {}
    for effect in bench.tested.effects:
        for (one, other), factor in effect.equivalents(bench.tested.system, bench.tested.law).items():
            if one in winner.strengths:
                found[other] = factor * values[one]
            if other in winner.strengths:
                found[one] = values[other] / factor
    return found


def _drop(
    bench: Bench, options: Sequence[Candidate], selection: Selection, before: Fit, settings: Settings
) -> tuple[list[Refused], bool]:
    """Take out effects without which the fit is as good from where it is now, and what stood in for the last one:
    effects that are beside it such as no mechanism has. What goes, and whether the others were judged anew for that.

    Those that came first may not be needed beside later ones; and the last may have gained nothing but a way out of a
    wrong minimum. What stood in goes if, judged anew, the others explain more than all did ``before`` the last came.
    """
    dropped, anew = list[Refused](), False
    for a in list(selection.accepted):
        left = [b for b in selection.accepted if b.candidate is not a.candidate]
        if len(left) == len(selection.accepted):  # exchanged for another meanwhile
            continue
        found = _without(bench, selection.fit, a.candidate, {name for b in left for name in b.names})
        if found is None:
            continue
        last, loss = selection.accepted[-1].candidate, found.state.cost - selection.fit.state.cost
        tried = replace(selection, accepted=left, fit=found)
        if loss < needed(a.tested, settings):
            why = f"not needed in the end ({loss:+.3g} in log-likelihood without it)"
        elif a.candidate is not last and (why := impossible(bench, a.candidate, selection.fit.values)):
            _judged_anew(bench, options, tried, settings, gone=True)
            if tried.fit.cost > before.cost - settings.told_apart:
                continue
            why, anew = f"not possible beside {' and '.join(b.candidate.name for b in tried.accepted)}: {why}", True
        else:
            continue
        dropped.append(Refused(a.candidate, why))
        selection.accepted, selection.fit = tried.accepted, tried.fit
        if not selection.accepted:
            selection.base = found
    return dropped, anew


def _impossible(bench: Bench, selection: Selection) -> str:
    """Why one of the effects is such as no mechanism has with the last one; empty where none is."""
    told = intervals(bench, selection.fit, selection.last)[1]
    for a in selection.accepted:
        if why := impossible(bench, a.candidate, selection.fit.values, told):
            own = a is selection.accepted[-1]
            return why if own else f"with it {a.candidate.name} is not possible: {why}"
    return ""


def intervals(bench: Bench, fit: Fit, scanned: Scanned) -> tuple[dict[str, float], dict[str, tuple[float, float]]]:
    """Estimates and 95 % intervals from the likelihood's curvature, the noise's colour counted."""
    normal = scanned.known
    left = [fit.state.left(name) / level for name, level in fit.sigmas.items()]
    factor = bench.problem.loss.inflation(np.concatenate(left))
    errors = np.sqrt(factor * np.maximum(normal.covariance.diagonal(), 0.0))
    table = {par.name: par for par in bench.tested.parameters}
    values, ci95 = {name: fit.values[name] for name in fit.names}, {}
    for name, error in zip(fit.names, errors.tolist(), strict=True):
        positive = not table[name].linear
        told = error > 0 and not (positive and error > UNTOLD * values[name])  # 0: derivatives that overflow
        ci95[name] = interval(values[name], error if told else np.nan, positive)
    return values, ci95
