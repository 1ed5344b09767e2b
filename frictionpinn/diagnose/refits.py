"""Refits of the candidates that a scan found: from several starts, searched anew where one may have stopped short."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from ..identify.parallel import in_parallel
from .bench import Bench
from .fit import Fit
from .rivals import Contender, best_of, levelled, moved
from .scan import Tested
from .score import ALIKE
from .tries import ASTRAY, add, better, leaves_little, look, penalised, reach

log = logging.getLogger(__name__)

CONTENDERS = 7  # candidates that are refitted in a round
WORTH = 0.5, 0.25  # of the best statistic: candidates with less are not refitted; where the fit is astray
PROMISING = 0.5  # of the cost beyond noise: contenders that take off less are not the first to search anew
MATES = 3  # of the best contender, if it leaves more than noise: refitted too
BETTER = 5  # candidates outside the classes that are refitted after a first look at all
SHORT = 12  # iterations of a try beside a candidate that leaves little
DEEP = 3  # contenders that are searched anew where no refit explains the residual
NEAR = 50.0  # log-likelihood: rivals that are searched anew too, should the winner prove to be in a wrong minimum
CLOSE = 0.7  # of the winner's gain: so near they are at least


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
        beside: tells candidates that show only beside a friction that had vanished; asked if none of these explains it,
            or what does bends the curve of the friction that is left.
    """
    fits: list[Contender] = []
    left = [group[0] for group in _promising_first(bench, before, classes)]
    while left and not _explained(fits):
        fits += _added(bench, before, left.pop(0), fits)
    rest = in_parallel(lambda k: _added(bench, before, left[k], fits), [1.0] * len(left))
    fits += [pair for found in rest for pair in found]
    for tested in [] if _explained(fits) and not best_of(fits)[0].candidate.bends else beside():
        classes.append([tested])
        fits += _added(bench, before, tested, fits)
    fits = _best_of_each(fits)
    if fits and not _explained(fits):
        fits = _alike_refitted(bench, before, classes, fits)
    elif fits:
        fits = levelled(bench, fits)
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
    best = best_of(fits)
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
    looks = zip(_looks(bench, before, [group[0] for group in classes]), classes, strict=True)
    ranked = sorted(looks, key=lambda pair: np.inf if pair[0] is None else penalised(pair[0]))
    return [group for _, group in ranked]


def _looks(bench: Bench, before: Fit, tested: Sequence[Tested]) -> list[Fit | None]:
    return in_parallel(lambda k: look(bench, before, tested[k]), [1.0] * len(tested))


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
    head = best_of(fits)
    group = next(g for g in classes if g[0] is head[0])
    made = [head]
    for tested in group[1 : 1 + MATES]:
        found = add(bench, _as(before, head), tested, thorough=False)
        if found is not None:
            made.append((tested, found))
            group.remove(tested)
            classes.append([tested])
    return [*(pair for pair in fits if pair is not head), *levelled(bench, made, True)]


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
    """The fits, those searched anew that come near the best: all of them, since one in a wrong minimum may be right.

    First each is fitted from the best's unknowns, which costs a hundredth of a search and may do.
    """
    fits = sorted(fits, key=lambda pair: penalised(pair[1]))
    fits = sorted([*levelled(bench, fits[:DEEP], True), *fits[DEEP:]], key=lambda pair: penalised(pair[1]))
    best = penalised(fits[0][1])
    reach_ = best + max(NEAR, 0.1 * (before.state.cost - fits[0][1].state.cost))
    found: list[Contender] = []
    for k, (tested, fit) in enumerate(fits):
        if k < DEEP and penalised(fit) < reach_ and not fit.explains:
            if _explained(found):  # out of that minimum the others come from there, if they come near at all
                winner = best_of(found)
                fit = better(fit, moved(bench, (tested, fit), winner)) or fit
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
    better_ = in_parallel(lambda k: searched(bench, fits[k][1]), [1.0] * near)
    found = [(tested, fit) for (tested, _), fit in zip(fits, better_, strict=False)]
    return levelled(bench, [*levelled(bench, found, True), *fits[near:]])


def _try_others(
    bench: Bench, before: Fit, classes: list[list[Tested]], fits: list[Contender], others: Sequence[Tested]
) -> None:
    """Refit the best candidates outside the classes, each as a class of its own, until one explains the residual."""
    known = [group[0].trace for group in classes]
    left = [t for t in others if all(abs(float(trace @ t.trace)) < ALIKE for trace in known)]
    looks = zip(left, _looks(bench, before, left), strict=True)
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
