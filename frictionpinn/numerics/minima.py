"""Lower minima of a likelihood whose trials share the parameters alone."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from .descent import CLOSELY, KNOWN, Evaluate, Limits, Solution, State, coarse_to_fine, levenberg_marquardt, moved
from .parallel import in_parallel
from .score import inverse_root

KICKS = tuple(np.geomspace(12.0, 1.0, 8))  # standard errors to where searches for other minima begin
AT_ONCE = 2  # of these: not the number of cores, on which no result may depend


def lowest_of_trials(evaluate: Evaluate, found: Solution, limits: Limits, widths: Sequence[float]) -> Solution:
    """A minimum, or the lower one that begins with each trial's own unknowns where that trial fits best.

    Each bend of a bristle with which a trial may begin, and the side from which a noisy motion turns round, are minima
    in a trial's own unknowns: each trial has its own at given parameters, and one search tries all of them. Searches
    begin as far away, in standard errors, as those for other parameters; of a pair one at the sample, one at the
    resolution next to it, which blurs a stop. Where both come back it ends.

    Args:
        evaluate, found, limits: the cost, a minimum of it, and bounds of u.
        widths: resolutions in time, the coarsest first.
    """
    rng = np.random.default_rng(0)

    def away(at: State, kick: float) -> State:
        roots = [inverse_root(piece.ll) for piece in at.pieces]
        steps = [kick * (H @ rng.standard_normal(H.shape[1])) for H in roots]
        return replace(at, locals=tuple(x + step for x, step in zip(at.locals, steps, strict=True)))

    def followed(at: State, begun: Sequence[State]) -> list[Solution | None]:
        def follow(k: int) -> Solution | None:
            return coarse_to_fine(evaluate, begun[k], (at.u, at.u), widths[-1 - k :], [at])

        return in_parallel(follow, [1.0] * len(begun), "trials around the fit")

    for k in range(0, len(KICKS), AT_ONCE):
        at = found.state
        ends = followed(at, [away(at, kick) for kick in KICKS[k : k + AT_ONCE]])
        if all(end is not None and end.reason == KNOWN for end in ends):
            break
        found = assembled(evaluate, found, [end.state.locals for end in ends if end is not None], limits)
    return found


def carried(states: Iterable[State], u: np.ndarray, limits: Limits) -> Iterator[list[np.ndarray]]:
    """The own unknowns of every trial at minima, as their quadratic models move them to other global ones."""
    for state in states:
        try:
            locals_ = moved(state, u - state.u, limits, longest=np.inf)[1]
        except np.linalg.LinAlgError:
            continue
        yield locals_


def assembled(evaluate: Evaluate, found: Solution, offered: Iterable[Sequence[np.ndarray]], limits: Limits) -> Solution:
    """A minimum, or a lower one that begins with each trial's own unknowns from where that trial fits best.

    Trials share the global unknowns alone: a rugged likelihood has its minima trial by trial, and where searches that
    ended elsewhere are each better in another trial, none of them is the lowest.

    Args:
        evaluate: the cost.
        found: the minimum.
        offered: local unknowns of every trial as other searches have them, at the minimum's global ones.
        limits: bounds of u.
    """
    best, locals_ = list(found.state.pieces), list(found.state.locals)
    for own in offered:
        there = evaluate(found.state.u, own, False)
        for k, piece in enumerate(there.pieces if there else ()):
            if piece.cost < best[k].cost:
                best[k], locals_[k] = piece, own[k]
    if all(one is other for one, other in zip(locals_, found.state.locals, strict=True)):
        return found
    first = evaluate(found.state.u, locals_, True)
    better = None if first is None else levenberg_marquardt(evaluate, first, limits, **CLOSELY)
    return better if better is not None and better.state.cost < found.state.cost else found
