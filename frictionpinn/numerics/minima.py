"""Lower minima of a likelihood whose trials share the parameters alone."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from .descent import CLOSELY, Solution, coarse_to_fine, levenberg_marquardt
from .parallel import in_parallel
from .quadratic import Evaluate, Known, Limits, State, moved
from .score import inverse_root

KICKS = tuple(np.geomspace(12.0, 1.0, 8))  # standard errors to where searches for other minima begin
AT_ONCE = 2  # of these: not the number of cores, on which no result may depend


def lowest_of_trials(
    evaluate: Evaluate, alone: Sequence[Evaluate], found: Solution, limits: Limits, widths: Sequence[float]
) -> Solution:
    """A minimum, or the lower one that begins with each trial's own unknowns where that trial fits best.

    Each bend of a bristle with which a trial may begin, and the side from which a noisy motion turns round, are minima
    in a trial's own unknowns. At given parameters trials have nothing in common: each is searched by itself. Searches
    begin as far away, in standard errors, as those for other parameters; of a pair one at the sample, the other on the
    opposite side at the resolution next to it, which blurs a stop.

    Args:
        evaluate, found, limits: the cost, a minimum of it, and bounds of u.
        alone: the cost of every trial by itself.
        widths: resolutions in time, the coarsest first.
    """
    u = found.state.u

    def search(k: int) -> np.ndarray:
        rng, way, best = np.random.default_rng(k), np.zeros(0), found.state.locals[k]
        known = alone[k](u, [best], True)
        for j, kick in enumerate(KICKS):
            if known is None:
                break
            opposite = j % 2
            way = -way if opposite else _direction(rng, len(best))
            root = inverse_root(known.pieces[0].ll)  # of the directions that the data tell
            begun = replace(known, locals=(best + kick * (root @ way[: root.shape[1]]),))
            end = coarse_to_fine(alone[k], begun, (u, u), widths[-1 - opposite :], [Known.of(known)])
            if end is not None and end.state.cost < known.cost:
                known, best = end.state, end.state.locals[0]
        return best

    own = in_parallel(search, [float(len(piece.ll)) for piece in found.state.pieces], "trials around the fit")
    return assembled(evaluate, found, [own], limits)


def _direction(rng: np.random.Generator, n: int) -> np.ndarray:
    """A direction at random, as long as n standard errors at once, (n,)."""
    z = rng.standard_normal(n)
    return z * np.sqrt(n / (z @ z))


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
