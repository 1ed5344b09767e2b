"""Candidates tested and fitted over short windows, where what a model lacks does not add up.

Over a whole trial a missing effect moves a stop or a start, and all that follows is another motion: the fit without it
stands in a wrong minimum, with derivatives that hold over micrometres, and score tests made there rank candidates
poorly. Windows that each hold one stretch of low speed begin anew from what was measured.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from ..identify.start import windows_of
from ..numerics.parallel import in_parallel
from .bench import SHORT, Bench, tried
from .candidates import Candidate
from .fit import Fit
from .minima import gained
from .remainder import Remainder
from .rivals import twins, usual_first
from .rows import on_probe
from .scan import Tested, scan
from .tries import better, penalised, reach

WILD = 10.0  # times what nine windows in ten say at most: more is no information
LEFT = 0.3  # of the correlation: candidates together, or a variable, that leave more do not explain it
SLOW = 2.0  # times that: where two candidates together leave more, no third is asked
NEXT = 2  # candidates fitted beside those that are there, of which the best stays
MOST, FIRST = 9, 2  # candidates that are fitted over windows; the first are fitted to the end
WORTH = 0.5, 0.25  # of the best: with a smaller gain over windows not fitted to whole trials, statistic: to windows


@dataclass(frozen=True)
class Asked:
    """What is tested over windows.

    Attributes:
        options: all candidates.
        variables, places: of forces that depend on a variable in any way, see :func:`frictionpinn.diagnose.scan.scan`;
            none where effects were added already, whose remainder that is.
        most: candidates together that may explain what is left.
    """

    options: Sequence[Candidate]
    variables: Sequence[Remainder] = ()
    places: Mapping[str, float] = field(default_factory=dict)
    most: int = 1


@dataclass(frozen=True)
class Short:
    """A fit to the windows of all trials, on a bench that takes the inputs as measured."""

    bench: Bench
    fit: Fit

    @classmethod
    def of(cls, bench: Bench, fit: Fit) -> Short | None:
        """The model of ``fit`` over windows, at the noise that it leaves there; None where it cannot be simulated."""
        own = copy.copy(bench)
        own.problem = bench.problem.varied(joint=False, prior=False)  # each window begins where it was measured
        models = bench.equipped(windows_of(bench.problem), bench.parts.of(fit.names, fit.values))
        state = replace(fit.state, locals=tuple(model.local for model in models))
        there = replace(fit, models=models, state=state, sigmas=dict(bench.problem.sigmas))
        starts = [fit.values, *(fit.values | start for start in bench.starts)]
        made = in_parallel(lambda k: own.refit(there, fit.names, starts[k]), [1.0] * len(starts))
        best = better(*made)
        if best is None:
            return None
        best = own.refit(best, best.names, best.values, best.levels(bench.problem.loss))
        if best is not None and len(kept := regular(best)) < len(models):
            best = own.refit(_only(best, kept), best.names, best.values)
        return None if best is None else cls(own, best)

    def tested(self, options: Sequence[Candidate]) -> list[Tested]:
        """Candidates by their score tests, the most significant first."""
        return sorted(scan(self.bench, self.fit, options, (), {}).tested, key=lambda t: -t.statistic)

    def fitted(self, groups: Sequence[list[Tested]], **options: Any) -> list[tuple[list[Tested], Fit]]:
        """The fits with the first of every group, the best first; ``options`` of those followed to the end."""
        made: list[Fit | None] = []
        for first, last in ((0, FIRST), (FIRST, len(groups))):
            best, own = better(*made), groups[first:last]
            made += in_parallel(partial(self._kth, own, best, options), [1.0] * len(own))
        fits = [(group, fit) for group, fit in zip(groups, made, strict=True) if fit is not None]
        return sorted(fits, key=lambda pair: penalised(pair[1]))

    def _kth(self, groups: Sequence[list[Tested]], best: Fit | None, options: Mapping[str, Any], k: int) -> Fit | None:
        return self.with_(groups[k][0], best, **options)

    def with_(self, tested: Tested, best: Fit | None, **options: Any) -> Fit | None:
        """The fit with a candidate, given up after a short try that falls far behind the best."""
        names = (*self.fit.names, *tested.candidate.strengths, *tested.candidate.hidden)
        values = self.bench.clip({**self.fit.values, **tested.shape})
        if best is None:
            return self.bench.refit(self.fit, names, values, limits=reach(tested), **options)
        near = self.fit.state.cost - WORTH[0] * gained(self.fit, best)
        return tried(self.bench, self.fit, names, values, near, reach(tested))


def regular(fit: Fit) -> list[int]:
    """Windows but those in which a motion hardly stops, or hardly begins: derivatives there are a thousand times those
    elsewhere, hold nowhere, and drown all others.

    Told by the parameter of which most windows say about as much.
    """
    each = np.stack(
        [piece.gg.diagonal() / len(model.t) for piece, model in zip(fit.state.pieces, fit.models, strict=True)]
    )
    usual = np.quantile(each, (0.5, 0.9), axis=0)
    k = int(np.argmax(usual[0] / np.maximum(usual[1], 1e-300)))
    return np.flatnonzero(each[:, k] <= WILD * usual[1, k]).tolist()


def _only(fit: Fit, kept: Sequence[int]) -> Fit:
    state = replace(
        fit.state, locals=tuple(fit.locals[k] for k in kept), pieces=tuple(fit.state.pieces[k] for k in kept)
    )
    return replace(fit, models=tuple(fit.models[k] for k in kept), state=state)


@dataclass(frozen=True)
class Ranked:
    """What windows say of the candidates.

    Attributes:
        classes: those whose first explain most there, the best first.
        others: by their score tests there, the most significant first.
        nameless: tells whether even several candidates together leave much of what the model leaves over windows, and
            one variable little.
    """

    classes: list[list[Tested]]
    others: list[Tested]
    nameless: Callable[[], bool] = lambda: False


def over_windows(
    bench: Bench,
    before: Fit,
    classes: list[list[Tested]],
    others: Sequence[Tested],
    asked: Asked,
) -> Ranked:
    """Candidates by what they explain over windows; as given where these cannot be simulated.

    Args:
        bench, before: the last accepted fit.
        classes: by score tests on the whole trials, the most significant first.
        others: those to try where none of the classes explains the residual.
        asked: what is tested there.
    """
    short = Short.of(bench, before)
    if short is None:
        return Ranked(classes, list(others))
    tested = short.tested(asked.options)
    there = {t.candidate.name: t for t in tested}
    fits = short.fitted(_classes(tested, [there[group[0].candidate.name] for group in classes]))
    best = max((gained(short.fit, fit) for _, fit in fits), default=0.0)
    result = [
        [replace(group[0], short=fit.values), *group[1:]] for group, fit in fits
        if gained(short.fit, fit) > WORTH[0] * best
    ]  # fmt: skip
    names = {t.candidate.name for t in others}
    left = [t for t in tested if t.candidate.name in names]
    first = fits[0][1] if fits else short.fit

    def nameless() -> bool:
        return _leave_much(short, first, asked) and _of_one_variable(short, asked)

    return Ranked(result, left, nameless)


def _leave_much(short: Short, fit: Fit, asked: Asked) -> bool:
    """Whether a fit with a candidate leaves much however many are added, each time the best: ``most`` in all, and
    no third where two leave most."""
    limit = LEFT * short.fit.correlation
    for count in range(1, asked.most):
        if fit.correlation < limit or (count > 1 and fit.correlation > SLOW * limit):
            break
        there = Short(short.bench, fit)
        left = [c for c in asked.options if not {*c.strengths, *c.hidden} & set(fit.names)]
        if not (fits := there.fitted(_classes(there.tested(left), ())[:NEXT], iterations=SHORT)):
            break
        fit = fits[0][1]
    return fit.correlation >= limit


def _of_one_variable(short: Short, asked: Asked) -> bool:
    """Whether a force, or a friction, that depends on one variable in any way leaves little over windows."""
    if not (remaining := scan(short.bench, short.fit, (), asked.variables, asked.places).remaining):
        return False
    there = on_probe(short.bench, short.fit, asked.places)
    found = short.bench.refit(there, (*there.names, *remaining[0].names), there.values, iterations=SHORT)
    return found is not None and found.correlation < LEFT * short.fit.correlation


def _classes(tested: Sequence[Tested], also: Sequence[Tested]) -> list[list[Tested]]:
    """Candidates to fit over windows, each followed by those that the score tests do not tell from it."""
    groups: list[list[Tested]] = []
    worth = WORTH[1] * max((t.statistic for t in tested), default=0.0)
    first = [t for t in tested if t.statistic > worth][: MOST - min(len(also), MOST // 2)]
    named = {t.candidate.name for t in (*first, *also)}
    for t in tested:
        group = next((g for g in groups if twins(g[0], t)), None)
        if group is not None:
            group.append(t)
        elif t.candidate.name in named and len(groups) < MOST:
            groups.append([t])
    return [usual_first(group) for group in groups]
