"""Fits of rivals from one another: of those that explain the same, one may have stopped short."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ..numerics.parallel import in_parallel
from .bench import NEAR, Bench, tried
from .fit import Fit
from .scan import Tested
from .score import ALIKE
from .tries import better, penalised

RIVAL = 6.0  # log-likelihood: candidates whose fits differ by less are not told apart
TOLD = 1.0  # log-likelihood: fits that may be equal, but differ by more, are fitted from one another
MATE = 0.9  # cosine of two traces from which the strength of one is told from the other's

Contender = tuple[Tested, Fit]


def same(one: Tested, other: Tested, behind: float, lost: float) -> bool:
    """Whether a rival is listed beside a winner: all trials together do not tell them apart, and both act the same way.

    Neither fitted nor held-out trials decide alone: a payload that fits better by 3 and predicts worse by 3 is as
    likely as the inertia.

    Args:
        behind: log-likelihood by which the rival fits the fitted trials worse, its parameters counted.
        lost: log-likelihood by which it predicts the held-out trials worse.
    """
    return behind + lost < RIVAL and mates(one, other)


def best_of(fits: Sequence[Contender]) -> Contender:
    return min(fits, key=lambda pair: penalised(pair[1]))


def levelled(bench: Bench, fits: Sequence[Contender], first: int = 0) -> list[Contender]:
    """The fits, those fitted from the best too that explain the residual or do much the same, and the first so many.

    One may have stopped short.
    """
    fits = list(fits)
    for _ in range(len(fits)):
        best = best_of(fits)
        limit = penalised(best[1]) + TOLD
        behind = [
            k for k, (tested, fit) in enumerate(fits)
            if (k < first or fit.explains or mates(tested, best[0])) and penalised(fit) > limit
        ]  # fmt: skip
        for k, found in zip(behind, _all_moved(bench, [fits[k] for k in behind], best), strict=True):
            tested, fit = fits[k]
            fits[k] = tested, better(fit, found) or fit
        if penalised(best_of(fits)[1]) > limit - 2 * TOLD:
            break
    return fits


def _all_moved(bench: Bench, fits: Sequence[Contender], best: Contender) -> list[Fit | None]:
    return in_parallel(lambda k: moved(bench, fits[k], best), [1.0] * len(fits))


def mates(one: Tested, other: Tested) -> bool:
    """Whether the data show about the same of both."""
    return _cosine(one, other) > MATE


def twins(one: Tested, other: Tested) -> bool:
    """Whether the score tests cannot tell them apart."""
    return _cosine(one, other) > ALIKE


def _cosine(one: Tested, other: Tested) -> float:
    """Of their traces: none where they were tested over other stretches of time."""
    return abs(float(one.trace @ other.trace)) if len(one.trace) == len(other.trace) else 0.0


def usual_first(group: Sequence[Tested]) -> list[Tested]:
    """What the score tests do not tell apart: the more usual effect first, then one that adds."""
    return sorted(group, key=lambda t: (t.candidate.usual, min(t.step.values()) < 0))


def moved(bench: Bench, own: Contender, best: Contender) -> Fit | None:
    """The fit anew, from the best's unknowns that they share, and strengths that do what the best's do."""
    tested, fit = own
    alike = _alike_strength(tested, best) if mates(tested, best[0]) else {}
    there = in_place_of(bench, own, best) if mates(tested, best[0]) and not alike else None
    if there is None:
        private = {*tested.candidate.strengths, *tested.candidate.hidden}
        shared = {name: best[1].values[name] for name in fit.names if name in best[1].names and name not in private}
        values = {**fit.values, **shared, **alike}
        there = replace(fit, values=values, state=replace(fit.state, locals=best[1].locals))
    return tried(bench, there, fit.names, there.values, fit.state.cost + NEAR)


def in_place_of(bench: Bench, own: Contender, best: Contender) -> Fit | None:
    """The best with one's own strengths for its own, all else where the quadratic model then has its minimum.

    A gradient of friction stood in a wrong minimum beside a ripple whose mean did what its Coulomb friction had to do.
    """
    (tested, fit), (other, there) = own, best
    mine = {*tested.candidate.strengths, *tested.candidate.hidden}
    gone = [name for name in other.candidate.strengths if name not in mine]
    held = [name for name in other.candidate.hidden if name not in mine]
    new = tuple(name for name in fit.names if name not in there.names)
    values = there.values | {name: fit.values[name] for name in tested.candidate.hidden}
    both = bench.refit(there, (*there.names, *new), values, iterations=0)
    return None if both is None else bench.without(both, gone, held)


def _alike_strength(tested: Tested, best: Contender) -> dict[str, float]:
    """The strength that makes what the best's does, as far as the score tests tell: {} where there are several."""
    if len(tested.step) != 1 or len(best[0].step) != 1:
        return {}
    ((name, step),), ((other, unit),) = tested.step.items(), best[0].step.items()
    return {name: best[1].values[other] * step / unit} if unit else {}
