"""Candidates' fits out of wrong minima: searched anew, and all other candidates looked at where that does not help."""

from __future__ import annotations

from collections.abc import Sequence

from ..numerics.parallel import in_parallel
from .bench import NEAR, Bench
from .fit import Fit
from .rivals import RIVAL, Contender, best_of, levelled, moved, twins
from .scan import Tested
from .tries import ASTRAY, add, better, leaves_another, leaves_little, look, penalised

PROMISING = 0.5  # of the cost beyond noise: contenders that take off less are not the first to search anew
WORTHY = 0.5  # of the best gain: what looks as good is refitted at once
BETTER = 5  # candidates outside the classes that are refitted after a first look
BATCH, AT_ONCE = 8, 2  # candidates looked at before the best of them are refitted, and how many are
DEEP = 3  # contenders that are searched anew where no refit explains the residual
CLOSE = 0.7  # of the winner's gain: so near they are at least
SHORT_OF = 0.5  # of what its score test promised: a lone contender that gains less is searched anew as well
AS_PROMISED = 0.1  # relative: by how much a gain may miss what a score test promised that held


def explained(fits: Sequence[Contender]) -> bool:
    return any(fit.explains for _, fit in fits)


def astray(classes: Sequence[Sequence[Tested]]) -> bool:
    """Whether the score tests that chose these classes were made in a wrong minimum."""
    return max((group[0].statistic for group in classes if group[0].short is None), default=0.0) > ASTRAY


def promises(tested: Tested) -> bool:
    """Whether its score test was made where it is refitted."""
    return tested.beside is None and tested.short is None


def gained(before: Fit, fit: Fit) -> float:
    return before.state.cost - fit.state.cost


def looks_at(bench: Bench, before: Fit, tested: Sequence[Tested]) -> list[Fit | None]:
    return in_parallel(lambda k: look(bench, before, tested[k]), [1.0] * len(tested))


def polished(bench: Bench, before: Fit, found: list[Contender], fits: Sequence[Contender]) -> list[Contender]:
    """What was found, searched anew where it leaves little but more than noise and is the best so far, or comes near
    a best for which a search was in vain.

    A search costs less than to ask all others, and as a rule what is left is that the fit stopped short.
    """
    if not (found and bench.mechanism.memory) or found[0][1].explains or not leaves_little(before, found[0][1]):
        return found
    best, tries = best_of([*fits, *found])[1], sum(fit.searched for _, fit in fits)
    near = penalised(found[0][1]) < penalised(best) + _margin(before, best)
    if best is not found[0][1] and not (best.searched and near and tries < DEEP):
        return found
    return [(found[0][0], bench.search(found[0][1]))]


def out_of_wrong_minima(
    bench: Bench, before: Fit, classes: list[list[Tested]], fits: list[Contender], others: Sequence[Tested]
) -> list[Contender]:
    """The fits and more of them, until one explains the residual.

    The best contenders are searched anew; and all other candidates are tried, before that where the contenders
    explain little. Where the score tests that chose them were made in a wrong minimum, the best alone is searched
    first: that costs a seventh of what it costs to look at all others. Where windows chose the best and it leaves but
    another effect, no others are asked for all of it.
    """
    best = min((fit for _, fit in fits), key=lambda fit: fit.state.cost)
    promising = gained(before, best) > PROMISING * (before.state.cost - 0.5 * before.count)
    trusted = not astray(classes)
    if promising:
        fits = _searched(bench, before, fits, DEEP if trusted else 1)
    tested, fit = best_of(fits)
    alone = tested.short is None or not leaves_another(before, fit)
    if alone and not explained(fits):
        try_others(bench, before, classes, fits, others)
    if alone and not ((promising and trusted) or explained(fits)):
        fits = _searched(bench, before, fits)
    return fits


def _searched(bench: Bench, before: Fit, fits: Sequence[Contender], most: int = DEEP) -> list[Contender]:
    """The fits, the first of them searched anew that come near the best, since one in a wrong minimum may be right.

    First each is fitted from the best's unknowns, which costs a hundredth of a search and may do.
    """
    fits = sorted(fits, key=lambda pair: penalised(pair[1]))
    fits = sorted([*levelled(bench, fits[:DEEP], DEEP), *fits[DEEP:]], key=lambda pair: penalised(pair[1]))
    best = penalised(fits[0][1])
    reach_ = best + _margin(before, fits[0][1])
    found: list[Contender] = []
    for k, (tested, fit) in enumerate(fits):
        if k < most and penalised(fit) < reach_ and not fit.explains:
            if explained(found):  # out of that minimum the others come from there, if they come near at all
                winner = best_of(found)
                fit = better(fit, moved(bench, (tested, fit), winner)) or fit
                fit = fit if penalised(fit) > penalised(winner[1]) + NEAR else bench.search(fit)
            else:
                fit = bench.search(fit)
        found.append((tested, fit))
    return found


def try_others(
    bench: Bench,
    before: Fit,
    classes: list[list[Tested]],
    fits: list[Contender],
    others: Sequence[Tested],
    most: int | None = None,
) -> list[Tested]:
    """Look at the candidates outside the classes, and refit the best, until one explains the residual.

    Each becomes a class of its own. They are looked at in batches: of each those are refitted at once that come near
    the best fit, and in the end the best of the others. Returns those that were not refitted where only the first
    ``most`` are looked at.
    """
    heads = [group[0] for group in classes]
    seen, unseen = {head.candidate.name for head in heads}, dict[str, Tested]()
    for t in others:
        if t.candidate.name not in seen and (t.beside or not any(twins(head, t) for head in heads)):
            unseen.setdefault(t.candidate.name, t)
    left, later = list(unseen.values())[:most], [] if most is None else list(unseen.values())[most:]
    looked: list[Contender] = []
    for k in range(0, len(left), BATCH):
        looks = zip(left[k : k + BATCH], looks_at(bench, before, left[k : k + BATCH]), strict=True)
        looked = sorted([*looked, *((t, f) for t, f in looks if f is not None)], key=lambda pair: penalised(pair[1]))
        limit = before.state.cost - WORTHY * max(gained(before, best_of(fits)[1]), 0.0)
        last = k + BATCH >= len(left) and not later
        now = looked[:BETTER] if last else [pair for pair in looked[:AT_ONCE] if pair[1].state.cost < limit]
        looked = [pair for pair in looked if not any(pair is one for one in now)]
        for tested, glance in now:
            found = add(bench, before, tested, thorough=False, looked=glance)
            classes.append([tested])
            fits += polished(bench, before, [] if found is None else [(tested, found)], fits)
            if explained(fits):
                return []
    return [*later, *(tested for tested, _ in looked)]


def rivals_searched(bench: Bench, before: Fit, fits: Sequence[Contender]) -> list[Contender]:
    """The fits, the best and those near it searched anew: of two that are much alike one may have stopped short.

    Where all gained about what was promised, the fits lie where the linear model says: none is searched if the best is
    ahead by more than that model may err. A best that none is near is searched where it stopped far short. The best
    comes first: what that gains may put others out of reach, once they were fitted from there. Not those that were not
    told apart from it before: it may have gained by a needle of static friction to which only a search leads.
    """
    best, near = best_of(fits), _in_reach(before, fits)
    ahead = penalised(best[1]) + AS_PROMISED * _most(before, fits)

    def clear(pair: Contender) -> bool:
        return _as_promised(before, pair) and (pair is best or _hoped(before, pair) > ahead)

    alone = len(near) < 2 and not _far_short(before, best)
    if alone or all(clear(pair) for pair in near):
        return list(fits)
    first = best if any(pair is best for pair in near) else near[0]
    count, names = len(near), [pair[0].candidate.name for pair in near]
    tied = [p[0].candidate.name for p in near if abs(penalised(p[1]) - penalised(first[1])) < RIVAL]
    fits = sorted(fits, key=lambda pair: pair[0].candidate.name not in names)
    fits = levelled(bench, _anew(bench, fits, [first]), count)
    # Of those that the score tests do not tell apart one is searched, the others from there.
    done, heads = [first], list[Contender]()
    beyond = [pair for pair in fits if pair[0].candidate.name in tied]
    for pair in (*_in_reach(before, fits), *beyond):
        if pair[0].candidate.name in names and not any(twins(pair[0], other[0]) for other in (*done, *heads)):
            heads.append(pair)
    found = _anew(bench, fits, heads)
    return found if any(best_of(found) is pair for pair in fits) else levelled(bench, found, count)


def _anew(bench: Bench, fits: Sequence[Contender], which: Sequence[Contender]) -> list[Contender]:
    """The fits, those searched anew."""
    found = in_parallel(lambda k: bench.search(which[k][1]), [1.0] * len(which))
    made = {pair[0].candidate.name: (pair[0], fit) for pair, fit in zip(which, found, strict=True)}
    return [made.get(pair[0].candidate.name, pair) for pair in fits]


def _in_reach(before: Fit, fits: Sequence[Contender]) -> list[Contender]:
    """The best and what is near it, or would be with the gain that its score test promised."""
    reach_ = penalised(best_of(fits)[1]) + min(NEAR, CLOSE * _most(before, fits))  # what gains nothing is no rival
    first = sorted(fits, key=lambda pair: _hoped(before, pair))[:DEEP]
    return [pair for pair in first if _hoped(before, pair) < reach_]


def _most(before: Fit, fits: Sequence[Contender]) -> float:
    return before.state.cost - min(fit.state.cost for _, fit in fits)


def _hoped(before: Fit, pair: Contender) -> float:
    tested, fit = pair
    told = promises(tested) and (tested.statistic < ASTRAY or _as_promised(before, pair))
    promised = before.state.cost - tested.statistic / 2 if told else fit.state.cost
    return penalised(fit) - max(fit.state.cost - promised, 0.0)


def _as_promised(before: Fit, pair: Contender) -> bool:
    """Whether it gained about what its score test promised; one in a wrong minimum may promise anything."""
    tested, fit = pair
    promised = tested.statistic / 2
    return promises(tested) and abs(gained(before, fit) - promised) < AS_PROMISED * promised


def _far_short(before: Fit, pair: Contender) -> bool:
    """Whether it gained little of what its score test promised, if that was made where it can be trusted."""
    tested, fit = pair
    trusted = promises(tested) and tested.statistic < ASTRAY
    return trusted and gained(before, fit) < SHORT_OF * tested.statistic / 2


def _margin(before: Fit, best: Fit) -> float:
    """How far from the best a fit that stopped short may be."""
    return max(NEAR, 0.1 * gained(before, best))
