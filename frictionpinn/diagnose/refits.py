"""Refits of the candidates that a scan found: from several starts, searched anew where one may have stopped short."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from ..numerics.parallel import in_parallel
from .bench import SHORT, Bench
from .fit import Fit
from .minima import (
    BATCH,
    CLOSE,
    DEEP,
    astray,
    explained,
    gained,
    looks_at,
    out_of_wrong_minima,
    polished,
    rivals_searched,
    try_others,
)
from .restarts import lifted
from .rivals import Contender, best_of, levelled, mates, twins, usual_first
from .scan import Tested
from .simpler import simpler
from .tries import ASTRAY, ROUGH, add, better, leaves_little, penalised, reach

log = logging.getLogger(__name__)

CONTENDERS = 7  # candidates that are refitted in a round
WORTH = 0.5, 0.25  # of the best statistic: candidates with less are not refitted; where the fit is astray
MATES = 3  # of the best contender, if it leaves more than noise: refitted too
NEXT = 2  # contenders tried beside a leader that leaves little, before that is searched anew
LIFTED = 3  # candidates tried beside a friction that had vanished


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
        beside: tells candidates that show only beside a friction that had vanished; asked first where Coulomb or
            viscous friction had, else if none of these explains it, or what does bends the curve that is left.
    """
    fits: list[Contender] = []
    left = _promising_first(bench, before, classes)
    if gone := lifted(bench.problem, bench.sizes, before.values) is not None:  # score tests there promise nothing
        left = [*((tested, None) for tested in _asked(beside, classes)), *left]
        others = [*beside(), *others]
    asked = not (others and astray(classes))
    while left and not explained(fits):
        found = _added(bench, before, *left.pop(0), fits)
        found, fits, left = _beside_next(bench, before, found, fits, left)
        fits += polished(bench, before, found, fits)
        if not asked and any(fit.searched for _, fit in fits) and not explained(fits):
            others = try_others(bench, before, classes, fits, others, BATCH)  # before what ranks behind is refitted
            asked = True
    rest = in_parallel(lambda k: _added(bench, before, *left[k], fits), [1.0] * len(left))
    fits += [pair for found in rest for pair in found]
    solved = explained(fits) and not best_of(fits)[0].candidate.bends
    for tested in [] if gone or solved else _asked(beside, classes):
        fits += _added(bench, before, tested, None, fits)
    fits = _best_of_each(fits)
    if fits and not explained(fits):
        fits = _alike_refitted(bench, before, classes, fits)
    elif fits:
        fits = _levelled(bench, [*fits, *simpler(bench, before, classes, fits, others)])
    if bench.mechanism.memory and fits:
        if explained(fits):
            fits = rivals_searched(bench, before, fits)
        else:
            fits = out_of_wrong_minima(bench, before, classes, fits, others)
    fits.sort(key=lambda pair: penalised(pair[1]))
    for tested, fit in fits:
        log.info(f"  {tested.candidate.name}: log-likelihood {gained(before, fit):+.1f} on the fitted trials")
    return fits


def _asked(beside: Callable[[], Sequence[Tested]], classes: list[list[Tested]]) -> list[Tested]:
    """The first that show beside a friction that had vanished, each a class of its own."""
    found = list(beside()[:LIFTED])
    classes += [[tested] for tested in found]
    return found


def _added(bench: Bench, before: Fit, tested: Tested, looked: Fit | None, fits: Sequence[Contender]) -> list[Contender]:
    """A candidate refitted, if a first look does not tell that it is out of the question."""
    if not _nearly(before, fits):
        near = before.state.cost - WORTH[1] * gained(before, best_of(fits)[1]) if fits else None
        found = add(bench, before, tested, looked=looked, near=near)
    elif looked is not None and gained(before, looked) < WORTH[1] * gained(before, best_of(fits)[1]):
        found = looked
    else:  # it has to be as good from where it stands, or from the best
        found = _beside_solved(bench, before, tested, looked, fits)
    return [] if found is None else [(tested, found)]


def _beside_next(
    bench: Bench, before: Fit, found: list[Contender], fits: list[Contender], left: list[tuple[Tested, Fit | None]]
) -> tuple[list[Contender], list[Contender], list[tuple[Tested, Fit | None]]]:
    """The leader, the fits beside it and what is left to try, once those that come next were tried beside a leader
    that leaves little but more than noise.

    One of them may leave nothing, and a search of the leader costs ten times as much. What does not lead is tried
    again from where that search ends.
    """
    searches = bench.mechanism.memory and found and not found[0][1].explains and leaves_little(before, found[0][1])
    if not searches or _nearly(before, fits):
        return found, fits, left
    beside = [*fits, *found]
    tries = in_parallel(lambda k: _added(bench, before, *left[k], beside), [1.0] * len(left[:NEXT]))
    made = {tested.candidate.name: fit for pairs in tries for tested, fit in pairs}
    left = [(tested, made.get(tested.candidate.name, looked)) for tested, looked in left]
    best = best_of([*found, *(pair for pairs in tries for pair in pairs)])
    if best is found[0]:
        return found, fits, left
    return [best], beside, [item for item in left if item[0] is not best[0]]


def _beside_solved(
    bench: Bench, before: Fit, tested: Tested, looked: Fit | None, fits: Sequence[Contender]
) -> Fit | None:
    """A candidate beside one that leaves little: a short try, from there too, and the rest where it comes near.

    What is much like one that leaves but noise gets no rest here: it is fitted from that one in the end.
    """
    best = best_of(fits)
    left = SHORT if looked is None else SHORT - ROUGH
    found = add(bench, before, tested, thorough=False, looked=looked, iterations=left)
    if not explained(fits):
        there = _as(before, best)
        found = better(found, add(bench, there, replace(tested, short=None), thorough=False, iterations=SHORT))
    near = found is not None and gained(before, found) >= CLOSE * gained(before, best[1])
    if found is None or not near or (best[1].explains and mates(tested, best[0])):
        return found
    return better(found, bench.refit(found, found.names, found.values, limits=reach(tested)))


def _promising_first(bench: Bench, before: Fit, classes: list[list[Tested]]) -> list[tuple[Tested, Fit | None]]:
    """The first of every class, by a look at each where the score tests, made in a wrong minimum, rank them poorly.

    The sooner one explains the residual, the less is spent on the others.
    """
    heads = [group[0] for group in classes]
    if len(heads) < 2 or heads[0].short is not None or not astray(classes):
        return [(tested, None) for tested in heads]
    looks = zip(heads, looks_at(bench, before, heads), strict=True)
    return sorted(looks, key=lambda pair: np.inf if pair[1] is None else penalised(pair[1]))


def _best_of_each(fits: Sequence[Contender]) -> list[Contender]:
    """One fit of every candidate: some were also refitted beside a friction that vanished."""
    best: dict[str, Contender] = {}
    for pair in sorted(fits, key=lambda pair: penalised(pair[1])):
        best.setdefault(pair[0].candidate.name, pair)
    return list(best.values())


def _nearly(before: Fit, fits: Sequence[Contender]) -> bool:
    """Whether a fit leaves so little that what is left to do is to polish it, not to look elsewhere."""
    return any(leaves_little(before, fit) for _, fit in fits)


def _levelled(bench: Bench, fits: Sequence[Contender]) -> list[Contender]:
    """Fitted from the best what explains or does much the same; all that come next to a best that a search led to."""
    fits = sorted(fits, key=lambda pair: penalised(pair[1]))
    return levelled(bench, fits, DEEP if fits[0][1].searched else 0)


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
    return [*(pair for pair in fits if pair is not head), *levelled(bench, made, len(made))]


def contenders(significant: Sequence[Tested]) -> list[list[Tested]]:
    """The candidates to refit, each followed by those whose traces the data do not tell from its own."""
    classes: list[list[Tested]] = []
    largest = max((t.statistic for t in significant), default=0.0)
    worth = largest * (WORTH[1] if largest > ASTRAY else WORTH[0])  # an astray fit ranks them poorly
    for tested in significant:
        own = next((g for g in classes if twins(g[0], tested)), None)
        if own is not None:
            own.append(tested)
        elif len(classes) < CONTENDERS and tested.statistic > worth:
            classes.append([tested])
    return [usual_first(group) for group in classes]
