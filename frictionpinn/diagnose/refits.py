"""Refits of the candidates that a scan found: from several starts, searched anew where one may have stopped short."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from .bench import Bench
from .fit import Fit
from .scan import Tested
from .score import ALIKE
from .tries import ASTRAY, add, better, leaves_little, look, penalised, reach

log = logging.getLogger(__name__)

CONTENDERS = 7  # candidates that are refitted in a round
WORTH = 0.5, 0.25  # of the best statistic: candidates with less are not refitted; where the fit is astray
PROMISING = 0.5  # of the cost beyond noise: contenders that take off less are not the first to search anew
MATES = 3  # of the best contender, if it leaves more than noise: refitted too
BETTER = 5  # candidates outside the classes that are refitted after a first look at all
TOLD = 1.0  # log-likelihood: fits that may be equal, but differ by more, are fitted from one another
MATE = 0.9  # cosine of two traces from which the strength of one is told from the other's
SHORT = 12  # iterations of a try beside a candidate that leaves little
DEEP = 3  # contenders that are searched anew where no refit explains the residual
NEAR = 50.0  # log-likelihood: rivals that are searched anew too, should the winner prove to be in a wrong minimum
CLOSE = 0.7  # of the winner's gain: so near they are at least

Contender = tuple[Tested, Fit]


def refitted(
    bench: Bench,
    before: Fit,
    classes: list[list[Tested]],
    others: Sequence[Tested],
    beside: Callable[[], Sequence[Tested]] = tuple,
) -> list[Contender]:
    """The first of every class refitted, the best first.

    Args:
        bench, before: where they are refitted.
        classes: candidates that the score tests cannot tell apart; what is refitted by itself gets a class of its own.
        others: candidates to try where none of these explains the residual.
        beside: tells candidates that show only beside a friction that had vanished; asked if none of these explains it.
    """
    fits: list[Contender] = []
    for group in _promising_first(bench, before, classes):
        fits += _added(bench, before, group[0], fits)
    for tested in [] if _explained(fits) else beside():
        classes.append([tested])
        fits += _added(bench, before, tested, fits)
    fits = _best_of_each(fits)
    if fits and not _explained(fits):
        fits = _alike_refitted(bench, before, classes, fits)
    elif fits:
        fits = _levelled(bench, fits)
    if bench.mechanism.memory and fits:
        if _explained(fits):
            fits = _rivals_searched(bench, before, fits)
        elif _nearly(before, fits):
            fits = _searched(bench, before, fits)
            if not _explained(fits):
                _try_others(bench, before, classes, fits, others)
        else:
            fits = _out_of_wrong_minima(bench, before, classes, fits, others)
    fits.sort(key=lambda pair: penalised(pair[1]))
    for tested, fit in fits:
        gain = before.state.cost - fit.state.cost
        log.info(f"  {tested.candidate.name}: log-likelihood {gain:+.1f} on the fitted trials")
    return fits


def _added(bench: Bench, before: Fit, tested: Tested, fits: Sequence[Contender]) -> list[Contender]:
    # Beside a fit that leaves nothing but noise a candidate has to be as good from where it stands, or from there.
    found = _beside_solved(bench, before, tested, fits) if _nearly(before, fits) else add(bench, before, tested)
    return [] if found is None else [(tested, found)]


def _beside_solved(bench: Bench, before: Fit, tested: Tested, fits: Sequence[Contender]) -> Fit | None:
    """A candidate beside one that leaves little: a short try, from there too, and the rest where it comes near."""
    best = _best(fits)
    found = add(bench, before, tested, thorough=False, iterations=SHORT)
    if not _explained(fits):
        found = better(found, add(bench, _as(before, best), tested, thorough=False, iterations=SHORT))
    gain = before.state.cost - best[1].state.cost
    if found is None or before.state.cost - found.state.cost < CLOSE * gain:
        return found
    return better(found, bench.refit(found, found.names, found.values, limits=reach(tested)))


def _promising_first(bench: Bench, before: Fit, classes: list[list[Tested]]) -> list[list[Tested]]:
    """The classes by a first look at each, where the score tests, made in a wrong minimum, rank them poorly.

    The sooner one explains the residual, the less is spent on the others.
    """
    if len(classes) < 2 or max(g[0].statistic for g in classes) <= ASTRAY:
        return classes
    looks = [(look(bench, before, group[0]), group) for group in classes]
    looks.sort(key=lambda pair: np.inf if pair[0] is None else penalised(pair[0]))
    return [group for _, group in looks]


def _best_of_each(fits: Sequence[Contender]) -> list[Contender]:
    """One fit of every candidate: some were also refitted beside a friction that vanished."""
    best: dict[str, Contender] = {}
    for pair in sorted(fits, key=lambda pair: penalised(pair[1])):
        best.setdefault(pair[0].candidate.name, pair)
    return list(best.values())


def _explained(fits: Sequence[Contender]) -> bool:
    return any(fit.explains for _, fit in fits)


def _nearly(before: Fit, fits: Sequence[Contender]) -> bool:
    """Whether a fit leaves so little that what is left to do is to polish it, not to look elsewhere."""
    return any(leaves_little(before, fit) for _, fit in fits)


def _best(fits: Sequence[Contender]) -> Contender:
    return min(fits, key=lambda pair: penalised(pair[1]))


def _as(before: Fit, found: Contender) -> Fit:
    """The fit before with what another found of its parameters and of the trials' unknowns."""
    values = before.values | {name: found[1].values[name] for name in before.names}
    return replace(before, values=values, state=replace(before.state, locals=found[1].locals))


def _alike_refitted(
    bench: Bench, before: Fit, classes: list[list[Tested]], fits: Sequence[Contender]
) -> list[Contender]:
    """The fits and those of the best's class mates, each from the best's parameters: what the score tests could not
    tell apart a fit may, but one that stopped short of another is tried from there first.

    Those that were refitted leave the class and are one each.
    """
    head = _best(fits)
    group = next(g for g in classes if g[0] is head[0])
    made = [head]
    for tested in group[1 : 1 + MATES]:
        found = add(bench, _as(before, head), tested, thorough=False)
        if found is not None:
            made.append((tested, found))
            group.remove(tested)
            classes.append([tested])
    return [*(pair for pair in fits if pair is not head), *_levelled(bench, made, True)]


def _levelled(bench: Bench, fits: Sequence[Contender], all_: bool = False) -> list[Contender]:
    """The fits, those fitted from the best too that explain the residual or do much the same (or all).

    One may have stopped short.
    """
    for _ in fits:
        best = _best(fits)
        limit = penalised(best[1]) + TOLD
        fits = [
            (tested, (better(fit, _moved(bench, (tested, fit), best)) or fit))
            if (all_ or fit.explains or _mates(tested, best[0])) and penalised(fit) > limit
            else (tested, fit)
            for tested, fit in fits
        ]
        if penalised(_best(fits)[1]) > limit - 2 * TOLD:
            break
    return list(fits)


def _mates(one: Tested, other: Tested) -> bool:
    return abs(float(one.trace @ other.trace)) > MATE


def _alike_strength(tested: Tested, best: Contender) -> dict[str, float]:
    """The strength that makes what the best's does, as far as the score tests tell: {} where there are several."""
    if not _mates(tested, best[0]) or len(tested.step) != 1 or len(best[0].step) != 1:
        return {}
    ((name, step),), ((other, unit),) = tested.step.items(), best[0].step.items()
    return {name: best[1].values[other] * step / unit} if unit else {}


def _out_of_wrong_minima(
    bench: Bench, before: Fit, classes: list[list[Tested]], fits: list[Contender], others: Sequence[Tested]
) -> list[Contender]:
    """The fits and more of them, until one explains the residual.

    The best contenders are searched anew; and all other candidates are tried, before that where the contenders
    explain little.
    """
    best = min(fit.state.cost for _, fit in fits)
    promising = before.state.cost - best > PROMISING * (before.state.cost - 0.5 * before.count)
    if not promising:
        _try_others(bench, before, classes, fits, others)
    fits = _searched(bench, before, fits)
    if promising and not _explained(fits):
        _try_others(bench, before, classes, fits, others)
    return fits


def _searched(bench: Bench, before: Fit, fits: Sequence[Contender]) -> list[Contender]:
    """The fits, those searched anew that come near the best: all of them, since one in a wrong minimum may be right."""
    fits = sorted(fits, key=lambda pair: penalised(pair[1]))
    best = penalised(fits[0][1])
    reach_ = best + max(NEAR, 0.1 * (before.state.cost - fits[0][1].state.cost))
    found: list[Contender] = []
    for k, (tested, fit) in enumerate(fits):
        if k < DEEP and penalised(fit) < reach_ and not fit.explains:
            if _explained(found):  # out of that minimum the others come from there, if they come near at all
                winner = _best(found)
                fit = better(fit, _moved(bench, (tested, fit), winner)) or fit
                fit = fit if penalised(fit) > penalised(winner[1]) + NEAR else searched(bench, fit)
            else:
                fit = searched(bench, fit)
        found.append((tested, fit))
    return found


def searched(bench: Bench, fit: Fit) -> Fit:
    """The fit or, where a search from all starts finds it, a better one."""
    return bench.search(fit) or replace(fit, searched=True)


def _rivals_searched(bench: Bench, before: Fit, fits: Sequence[Contender]) -> list[Contender]:
    """The fits, the best and those near it searched anew: of two that are much alike one may have stopped short.

    Near is, too, what stopped short of the gain that its score test promised.
    """
    gain = before.state.cost - min(fit.state.cost for _, fit in fits)
    least = min(penalised(fit) for _, fit in fits)
    reach_ = least + min(NEAR, CLOSE * gain)  # those that gain nothing are no rivals

    def hoped(pair: Contender) -> float:
        tested, fit = pair
        told = tested.beside is None and tested.statistic < ASTRAY  # in a wrong minimum a score test promises anything
        promised = before.state.cost - tested.statistic / 2 if told else fit.state.cost
        return penalised(fit) - max(fit.state.cost - promised, 0.0)

    fits = sorted(fits, key=hoped)
    near = sum(hoped(pair) < reach_ for pair in fits[:DEEP])
    if near < 2:
        return fits
    found = [(tested, searched(bench, fit)) for tested, fit in fits[:near]]
    return _levelled(bench, [*_levelled(bench, found, True), *fits[near:]])


def _moved(bench: Bench, own: Contender, best: Contender) -> Fit | None:
    """The fit anew, from the best's unknowns that they share, and a strength that does what the best's does."""
    tested, fit = own
    private = {*tested.candidate.strengths, *tested.candidate.hidden}
    shared = {name: best[1].values[name] for name in fit.names if name in best[1].names and name not in private}
    there = replace(fit, state=replace(fit.state, locals=best[1].locals))
    return bench.refit(there, fit.names, {**fit.values, **shared, **_alike_strength(tested, best)})


def _try_others(
    bench: Bench, before: Fit, classes: list[list[Tested]], fits: list[Contender], others: Sequence[Tested]
) -> None:
    """Refit the best candidates outside the classes, each as a class of its own, until one explains the residual."""
    known = [group[0].trace for group in classes]
    left = [t for t in others if all(abs(float(trace @ t.trace)) < ALIKE for trace in known)]
    looks = [(tested, look(bench, before, tested)) for tested in left]
    ranked = sorted(((t, f) for t, f in looks if f is not None), key=lambda pair: penalised(pair[1]))
    for tested, _ in ranked[:BETTER]:
        found = add(bench, before, tested, thorough=False)
        classes.append([tested])
        fits += [(tested, found)] if found is not None else []
        if found is not None and found.explains:
            return


def contenders(significant: Sequence[Tested]) -> list[list[Tested]]:
    """The candidates to refit, each followed by those whose traces the data do not tell from its own."""
    classes: list[list[Tested]] = []
    largest = max((t.statistic for t in significant), default=0.0)
    worth = largest * (WORTH[1] if largest > ASTRAY else WORTH[0])  # an astray fit ranks them poorly
    for tested in significant:
        own = next((g for g in classes if abs(float(g[0].trace @ tested.trace)) > ALIKE), None)
        if own is not None:
            own.append(tested)
        elif len(classes) < CONTENDERS and tested.statistic > worth:
            classes.append([tested])
    return [sorted(group, key=lambda t: (t.candidate.usual, min(t.step.values()) < 0)) for group in classes]
