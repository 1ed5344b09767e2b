"""A candidate fitted together with all parameters, from the starts that may lead to its best fit."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..numerics.simulate import ContactLost, SimulationFailed
from .bench import Bench, tried
from .fit import Fit
from .restarts import lifted
from .scan import Tested

ASTRAY = 300.0  # statistic from which the fit is taken to be in a wrong minimum for want of the effect
NEARLY = 0.2  # of the correlation before: a refit that leaves less explains nearly all
ALMOST = 0.05  # the same, of one that windows chose: what is left is another effect
ROUGH = 6  # iterations of a first look


def penalised(fit: Fit) -> float:
    """Cost and half a unit of log-likelihood times log n for every parameter (Bayesian information criterion)."""
    return fit.state.cost + 0.5 * len(fit.names) * np.log(fit.count)


def better(*fits: Fit | None) -> Fit | None:
    """The fit of least cost; None where there is none."""
    return min((f for f in fits if f is not None), key=lambda f: f.state.cost, default=None)


def leaves_little(before: Fit, fit: Fit) -> bool:
    """Whether what is left to do is to polish the fit, not to look elsewhere."""
    return fit.explains or fit.correlation < NEARLY * before.correlation


def leaves_another(before: Fit, fit: Fit) -> bool:
    """Whether what is left is so little of what was that it is another effect, not this one in a wrong minimum."""
    return not fit.explains and fit.correlation < ALMOST * before.correlation


def look(bench: Bench, fit: Fit, tested: Tested) -> Fit | None:
    """A few iterations with a candidate, from neutral: enough to rank it."""
    names = (*fit.names, *tested.candidate.strengths, *tested.candidate.hidden)
    fits = []
    for base in _bases(bench, fit, tested, False):
        values = bench.clip({**base, **tested.shape})
        fits.append(bench.refit(fit, names, values, limits=reach(tested), iterations=ROUGH))
    return min((f for f in fits if f is not None), key=penalised, default=None)


def add(
    bench: Bench,
    fit: Fit,
    tested: Tested,
    thorough: bool = True,
    looked: Fit | None = None,
    near: float | None = None,
    **options: Any,
) -> Fit | None:
    """Refit with a candidate's strengths and hidden parameters, from the fit and, where that is astray, from others:
    first from a fit over windows, if there was one.

    The first refit goes on from where a first look ended, if there was one; the others, and that if there was, are
    given up after a short try that does not bring the cost below ``near``. ``options`` as of :meth:`Bench.refit`.
    """
    limits, step = reach(tested), tested.step
    names = (*fit.names, *tested.candidate.strengths, *tested.candidate.hidden)
    worth = fit.state.cost - 0.3 * tested.statistic / 2
    if tested.beside is not None:
        worth = fit.state.cost  # its statistic is that beside a fit held elsewhere
    tries: list[Fit] = []
    if tested.short is not None and looked is None:
        found = from_windows(bench, fit, tested, near, **options)
        if found is not None and leaves_little(fit, found):
            return found
        tries += [] if found is None else [found]
    for base in _bases(bench, fit, tested, thorough):
        # From neutral, since Gauss-Newton moves all parameters together; from its step where that fails.
        for share in (0.0, 1.0):
            values = {**base, **tested.shape} | {name: share * value for name, value in step.items()}
            start, values = (fit, bench.clip(values)) if looked is None else (looked, looked.values)
            if near is not None and (tries or looked is not None):
                found = tried(bench, start, names, values, near, limits)
            else:
                found = bench.refit(start, names, values, limits=limits, **options)
            looked = None
            if found is not None:
                tries.append(found)
            if found is not None and found.state.cost < worth:
                break
        if any(leaves_little(fit, made) for made in tries):
            break
    return better(*tries)


def _bases(bench: Bench, fit: Fit, tested: Tested, thorough: bool) -> Iterator[Mapping[str, float]]:
    """Parameters to add a candidate to, the likeliest first."""
    if tested.beside is not None:
        yield tested.beside
        return
    yield fit.values
    back = lifted(bench.problem, bench.sizes, fit.values)
    if back:
        yield back
    if thorough and tested.statistic > ASTRAY and tested.short is None:
        yield from ({**fit.values, **start} for start in bench.starts)


def reach(tested: Tested) -> dict[str, tuple[float, float]]:
    """Values that hidden parameters may take: those tried, and somewhat beyond."""
    result = {}
    for name in tested.candidate.hidden:
        values = [point[name] for point in tested.candidate.grid]
        low, high = min(values), max(values)
        wide = 0.1 * (high - low)
        result[name] = (low / 1.5, high * 1.5) if low > 0 else (low - wide, high + wide)
    return result


def from_windows(bench: Bench, fit: Fit, tested: Tested, near: float | None = None, **options: Any) -> Fit | None:
    """The whole trials fitted from what a fit over windows found, their own unknowns from what was measured.

    Given up after a short try that does not bring the cost below ``near``.
    """
    names = (*fit.names, *tested.candidate.strengths, *tested.candidate.hidden)
    there = _begun(bench, fit, names, dict(tested.short or {}))
    if there is None:
        return None
    if near is not None:
        return tried(bench, there, names, there.values, near, reach(tested))
    return bench.refit(there, names, there.values, limits=reach(tested), **options)


def _begun(bench: Bench, fit: Fit, names: Sequence[str], values: Mapping[str, float]) -> Fit | None:
    """A fit's place in the whole trials as they were measured."""
    simulator = bench.parts.of(names, values)
    trials = bench.equipped(bench.problem.trials, simulator)
    problem = bench.problem_of(bench.problem, names, values, simulator).varied(trials=trials)
    try:
        models = problem.models_at(problem.space.to_search(np.array([values[name] for name in problem.names])))
    except (ContactLost, SimulationFailed):
        return None
    state = replace(fit.state, locals=tuple(model.local for model in models))
    return replace(fit, values=dict(values), models=models, state=state)
