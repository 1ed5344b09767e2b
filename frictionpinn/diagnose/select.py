"""Forward selection: the most significant candidates are refitted with all parameters, and one is kept if it proves
itself on trials that no fit saw."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, partial

import numpy as np

from ..numerics.parallel import in_parallel
from .bench import Bench, tried
from .candidates import Candidate
from .contest import Accepted, Refused, Settings, contest, indistinct
from .drop import drop
from .fit import Fit
from .held_out import bent
from .intervals import intervals
from .possible import impossible
from .remainder import Remainder
from .restarts import blunted, lifted, peaked, widened
from .scan import Scanned, Tested, scan
from .tries import better, leaves_another, penalised
from .windows import Asked

__all__ = ["Accepted", "Refused", "Selection", "Settings", "select"]

SETTLED = 3.0  # log-likelihood that a new search must gain to count
PROMISED = 0.5  # of what a friction brought back costs: score tests that promise less are not followed beside it
DEAR = 1.5  # times the cost: a friction brought back that costs more after a short try is given up
DIRECT = 8  # candidates of one parameter that could not be tested, and are refitted in a round
MANY = 100  # shapes of candidates that are left out beside a friction that had vanished


@dataclass
class Selection:
    """What forward selection did.

    Attributes:
        base, fit: the declared model, and the last accepted one, on the fitted trials.
        accepted: effects in the order in which they came.
        refused: candidates with a reason.
        first, last: what the scans of the declared and of the last model found.
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


def select(
    bench: Bench,
    options: Sequence[Candidate],
    remainders: Sequence[Remainder],
    places: Mapping[str, float],
    settings: Settings,
) -> Selection:
    """Add effects one by one while a significant one proves itself.

    Args:
        bench: the fitted declared model.
        options: candidates.
        remainders, places: see :func:`frictionpinn.diagnose.scan.scan`.
        settings: thresholds.
    """
    fit = widened(bench, bench.base())
    found = scan(bench, fit, options, remainders, places)
    selection, again = Selection(fit, fit, found, found), False
    while len(selection.accepted) < settings.most:
        taken = {name for a in selection.accepted for name in a.candidate.strengths}
        banned = {r.candidate.name for r in selection.refused}
        left = [
            t for t in selection.last.tested
            if not taken & set(t.candidate.strengths) and t.candidate.name not in banned
        ]  # fmt: skip
        significant = [t for t in left if t.log_p + np.log10(len(options)) < settings.log_p]
        hidden = cache(partial(_beside_vanished, bench, selection, options, settings))
        remains = _remains(selection, settings)
        untested = [] if selection.fit.explains else sorted(filter(_cheap, left), key=lambda t: t.candidate.usual)
        if not significant and not remains and not untested and not hidden():
            break
        others = [t for t in left if not selection.accepted and len(t.candidate.grid) < MANY]
        variables = remainders if remains and not selection.accepted else ()
        asked = Asked([t.candidate for t in left], variables, places, settings.most)
        before, saved = selection.fit, replace(selection, accepted=list(selection.accepted), fits=dict(selection.fits))
        accepted, selection.fit, refused = contest(
            bench, before, significant, hidden, others, settings, asked, untested
        )
        selection.refused += refused
        if accepted is None:
            break
        selection.accepted.append(accepted)
        another = accepted.tested.short is not None and leaves_another(before, selection.fit)
        _polish(bench, selection, options, remainders, places, settings, another)
        if refusal := _impossible(bench, selection, accepted):
            selection = replace(saved, refused=[*selection.refused, refusal])
            continue
        if selection.accepted:
            selection.fits[selection.accepted[-1].candidate.name] = selection.fit
        if not selection.accepted and not again:
            # It but led out of a wrong minimum: what was refused there is asked anew.
            selection.refused, again = [], True
    if selection.accepted:
        _blunt(bench, selection)
    return selection


def _cheap(tested: Tested) -> bool:
    """Whether it could not be tested, and has one parameter: it is refitted without a test."""
    return tested.untested and len(tested.candidate.strengths) == 1 and not tested.candidate.hidden


def _impossible(bench: Bench, selection: Selection, added: Accepted) -> Refused | None:
    """The effect that was added last, where with it one of the effects is such as no mechanism has."""
    told = intervals(bench, selection.fit, selection.last)[1]
    for a in selection.accepted:
        if why := impossible(bench, a.candidate, selection.fit.values, told):
            # A deeper search may have put a rival in its place.
            new = added.candidate if added in selection.accepted else selection.accepted[-1].candidate
            own = a.candidate.name == new.name
            return Refused(new, why if own else f"with it {a.candidate.name} is not possible: {why}")
    return None


def _blunt(bench: Bench, selection: Selection) -> None:
    """Take the fit that is handed over out of a minimum that the held-out trials contradict.

    At the end: what a scan finds there may be but the way back to the likelier minimum.
    """
    fit = blunted(bench, selection.fit, partial(bent, bench))
    if fit is not selection.fit:
        there = scan(bench, fit, (), (), {})
        selection.fit = fit
        selection.last = replace(there, tested=selection.last.tested, remaining=selection.last.remaining)


def _polish(
    bench: Bench,
    selection: Selection,
    options: Sequence[Candidate],
    remainders: Sequence[Remainder],
    places: Mapping[str, float],
    settings: Settings,
    another: bool,
) -> None:
    """Search the likelihood with the effect that was added, take out what it makes superfluous, and scan what is left.

    The likelihood of a law with memory is rugged. Where ``another`` effect is left, no other minimum is looked for.
    """
    rugged = bench.mechanism.memory
    if rugged:
        selection.fit = bench.settle(selection.fit, partial(bent, bench))
    deepened = rugged and not selection.fit.explains
    if deepened and not another:
        _deepen(bench, selection, settings)
    if drop(bench, selection, settings) and rugged and not selection.fit.explains:
        selection.fit = bench.settle(selection.fit, partial(bent, bench))
    _rescan(bench, selection, options, remainders, places)
    if rugged and not deepened and _doubtful(selection, options, settings) and _deepen(bench, selection, settings):
        drop(bench, selection, settings)
        _rescan(bench, selection, options, remainders, places)


def _rescan(
    bench: Bench,
    selection: Selection,
    options: Sequence[Candidate],
    remainders: Sequence[Remainder],
    places: Mapping[str, float],
) -> None:
    taken = {name for a in selection.accepted for name in a.candidate.strengths}
    # What shapes an effect that is part of the model is known: its other strengths are tested with that.
    present = {a.candidate.effect for a in selection.accepted}
    left = [replace(c, hidden=(), grid=({},)) if c.effect in present else c for c in options]
    left = [c for c in left if not taken & set(c.strengths)]
    selection.fit = widened(bench, selection.fit)
    selection.last = scan(bench, selection.fit, left, remainders, places)
    selection.fit = _reweighted(bench, selection.fit, selection.last)


def _remains(selection: Selection, settings: Settings) -> bool:
    """Whether the residual depends on a variable."""
    tests = [m.log_p + np.log10(len(selection.last.remaining)) for m in selection.last.remaining]
    return min(tests, default=0.0) < settings.log_p


def _beside_vanished(
    bench: Bench, selection: Selection, options: Sequence[Candidate], settings: Settings
) -> list[Tested]:
    """The best candidates beside a friction that vanished from the fit, brought back.

    Some show only there: friction that rises towards rest over 5 cm/s passes for a Stribeck curve, and takes the place
    of the real one.
    """
    fit = selection.fit
    if selection.accepted and fit.explains:  # nothing is left that could hide there
        return []
    back = lifted(bench.problem, bench.sizes, fit.values)
    found = _held(bench, fit, [back]) if back else _held(bench, fit, peaked(bench.problem, fit.values))
    if found is None:
        return []
    banned = {r.candidate.name for r in selection.refused}
    present = {a.candidate.effect for a in selection.accepted}
    left = [c for c in options if c.effect not in present and c.name not in banned and len(c.grid) < MANY]
    tested = scan(bench, found, left, (), {}).tested
    lost = PROMISED * max(found.state.cost - fit.state.cost, 0.0)  # with it back: a candidate has to make up for that
    return [
        replace(t, beside=found.values)
        for t in tested
        if t.log_p + np.log10(len(options)) < settings.log_p and t.statistic / 2 > lost
    ]


def _held(bench: Bench, fit: Fit, starts: Sequence[Mapping[str, float]]) -> Fit | None:
    """The best refit with what the starts change held there."""

    def held(k: int) -> Fit | None:
        values = starts[k]
        names = tuple(n for n in fit.names if values[n] == fit.values[n])
        return tried(bench, fit, names, values, DEAR * fit.state.cost)

    return better(*in_parallel(held, [1.0] * len(starts)))


def _doubtful(selection: Selection, options: Sequence[Candidate], settings: Settings) -> bool:
    """Whether something is significant still, a candidate or a variable."""
    tests = [t.log_p + np.log10(len(options)) for t in selection.last.tested]
    return min(tests, default=0.0) < settings.log_p or _remains(selection, settings)


def _deepen(bench: Bench, selection: Selection, settings: Settings) -> bool:
    """Search the last model and its close rivals from all starts: where one was fitted to a wrong minimum, what is left
    looks like an effect. Says whether the fit changed."""
    if not selection.accepted:
        return False
    last = selection.accepted[-1]
    best, choice, cost = selection.fit, last.tested, penalised(selection.fit)
    level = [(last.tested, selection.fit)]
    for tested, fit in ((last.tested, selection.fit), *last.close):
        if best is not selection.fit and best.explains:
            break
        weighted = fit if fit is selection.fit else bench.refit(fit, fit.names, fit.values, selection.fit.sigmas)
        found = None if weighted is None else bench.search(weighted, fit.starts)
        if found is not None:
            level.append((tested, found))
        if found is not None and penalised(found) < cost - SETTLED:
            best, cost, choice = found, penalised(found), tested
    changed = best is not selection.fit
    if choice is not last.tested:
        before = selection.path[-1] if len(selection.accepted) > 1 else selection.base
        near = indistinct(bench, before, (choice, best), level, settings)
        alike = {t.candidate.name: (t.candidate, {n: f.values[n] for n in t.candidate.strengths}) for t, f in near}
        if last.candidate.name in alike:  # and what could not be told from that
            alike = {c.name: (c, values) for c, values in last.alike if c.name != choice.candidate.name} | alike
        last = replace(last, candidate=choice.candidate, tested=choice, alike=tuple(alike.values()))
    selection.fit, selection.accepted[-1] = best, last
    return changed


def _reweighted(bench: Bench, fit: Fit, scanned: Scanned) -> Fit:
    """The fit at the noise levels that the last scan found."""
    noise = scanned.noise
    sigmas = {}
    for name, sigma in fit.sigmas.items():
        a = noise.coefficients.get(name, np.zeros(0))
        sigmas[name] = sigma if len(a) else sigma * noise.scale.get(name, 1.0)
    found = bench.refit(fit, fit.names, fit.values, sigmas)
    return fit if found is None else replace(found, minima=fit.minima, searched=fit.searched, starts=fit.starts)
