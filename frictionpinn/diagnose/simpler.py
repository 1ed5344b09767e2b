"""Effects of fewer parameters in the place of one that explains: a long ripple does what a gradient does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ..numerics.parallel import in_parallel
from .bench import NEAR, Bench, tried
from .candidates import Candidate
from .fit import Fit
from .rivals import Contender, best_of, in_place_of
from .scan import Tested, scan

MOST = 2  # candidates that are tried in its place


def simpler(
    bench: Bench, before: Fit, classes: list[list[Tested]], fits: Sequence[Contender], others: Sequence[Tested]
) -> list[Contender]:
    """Candidates of fewer parameters than a best that explains the residual, which do as much in its place.

    Score tests made in a wrong minimum may hide them; those over short windows do not. They are tested again where the
    best leads with its strengths taken out, all else where the quadratic model then has its minimum: what is missing
    there is what the best adds.
    """
    tested, fit = best_of(fits)
    there, size = tested.candidate, len({*fit.names} - {*before.names})
    seen = {t.candidate.name for group in (*classes, [t for t, _ in fits]) for t in group}
    fewer = [t.candidate for t in others if t.candidate.name not in seen and _size(t.candidate) < size]
    if not (bench.mechanism.memory and fit.explains and fewer) or tested.short is not None:
        return []
    out = bench.without(fit, there.strengths, there.hidden)
    base = bench.refit(out, before.names, out.values, iterations=0)
    if base is None:
        return []
    asked = [replace(t, beside=base.values) for t in scan(bench, base, fewer, (), {}).tested[:MOST]]

    def instead(k: int) -> Fit | None:
        names = (*before.names, *asked[k].candidate.strengths, *asked[k].candidate.hidden)
        own = replace(fit, names=names, values=fit.values | asked[k].shape)
        start = in_place_of(bench, (asked[k], own), (tested, fit))
        return None if start is None else tried(bench, start, names, start.values, fit.state.cost + NEAR)

    made = in_parallel(instead, [1.0] * len(asked))
    found = [(t, own) for t, own in zip(asked, made, strict=True) if own is not None]
    classes += [[t] for t, _ in found]
    return found


def _size(candidate: Candidate) -> int:
    return len(candidate.strengths) + len(candidate.hidden)
