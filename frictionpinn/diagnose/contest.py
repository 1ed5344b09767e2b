"""One round of the selection: the significant candidates are refitted, and held-out trials judge the best of them."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from .bench import Bench
from .candidates import Candidate
from .fit import Fit
from .held_out import held_out_gain
from .restarts import lifted
from .scan import Tested
from .score import ALIKE

log = logging.getLogger(__name__)

CONTENDERS = 7  # candidates that are refitted in a round
ASTRAY = 300.0  # statistic from which the fit is taken to be in a wrong minimum for want of the effect
WORTH = 0.5, 0.25  # of the best statistic: candidates with less are not refitted; where the fit is astray
DECISIVE = 2.0  # log-likelihood of the held-out trials by which one of several rivals wins
TIED = 1.0  # log-likelihood: of fits that differ by less, on either trials, the more usual effect stands first
RIVAL = 6.0  # log-likelihood: candidates whose fits differ by less are not told apart
PROMISING = 0.5  # of the cost beyond noise: contenders that take off less are not the first to search anew
DEEP = 3  # contenders that are searched anew where no refit explains the residual
NEAR = 50.0  # log-likelihood: rivals that are searched anew too, should the winner prove to be in a wrong minimum


@dataclass(frozen=True)
class Settings:
    """Thresholds.

    Attributes:
        log_p: decimal logarithm of the chance, over all candidates, below which one counts as significant.
        most: effects that are added at most.
        gain: log-likelihood that the held-out trials must gain.
    """

    log_p: float = -4.0
    most: int = 4
    gain: float = 1.0


@dataclass(frozen=True)
class Refused:
    """A candidate that was not added, and why."""

    candidate: Candidate
    why: str


@dataclass(frozen=True)
class Accepted:
    """A candidate that was added.

    Attributes:
        candidate, tested: what was found.
        evidence: statistic, log_p, gain on the fitted and on the held-out trials.
        alike: candidates that explain the same data as well, with the strengths that they would have.
        close: others whose fits come near, should this one prove to be in a wrong minimum.
    """

    candidate: Candidate
    tested: Tested
    evidence: dict[str, float]
    alike: tuple[tuple[Candidate, dict[str, float]], ...] = ()
    close: tuple[tuple[Tested, Fit], ...] = ()


Contender = tuple[Tested, Fit]


def contest(
    bench: Bench,
    before: Fit,
    significant: Sequence[Tested],
    beside: Sequence[Tested],
    others: Sequence[Tested],
    settings: Settings,
) -> tuple[Accepted, Fit, list[Refused]] | tuple[None, Fit, list[Refused]]:
    """Refit the contenders and take the best that the held-out trials confirm.

    Args:
        before: the last accepted fit.
        significant: candidates by their score tests, the most significant first.
        beside: candidates that show only beside a friction that had vanished.
        others: all candidates, the most significant first: tried where none of the above explains the residual, since a
            fit in a wrong minimum hides even what it lacks.
        settings: thresholds.

    Returns:
        What was accepted or None, the fit with it, and the candidates that were refused on the way.
    """
    classes = [*contenders(significant), *([t] for t in beside)]
    fits = _refitted(bench, before, classes, others)
    refused: list[Refused] = []
    for k, (tested, fit) in enumerate(fits):
        held, why = _proof(bench, before, tested, fit, settings)
        if why:
            refused.append(Refused(tested.candidate, why))
            continue
        near = [pair for pair in fits[k + 1 :] if penalised(pair[1]) - penalised(fit) < RIVAL]
        (tested, fit), held, near, worse = _decide(bench, before, (tested, fit), held, near, settings.gain)
        gain = before.state.cost - fit.state.cost
        same = next(group for group in classes if group[0] is tested)[1:]
        alike = [(t.candidate, {n: t.step[n] for n in t.candidate.strengths}) for t in same]
        alike += [(t.candidate, {n: f.values[n] for n in t.candidate.strengths}) for t, f in near]
        evidence = {"statistic": tested.statistic, "log10_p": tested.log_p, "gain_fitted": gain}
        evidence |= {} if held is None else {"gain_held_out": held}
        close = [p for p in fits if p[0] is not tested and penalised(p[1]) - penalised(fit) < max(NEAR, 0.1 * gain)]
        return Accepted(tested.candidate, tested, evidence, tuple(alike), tuple(close[:DEEP])), fit, [*refused, *worse]
    return None, before, refused


def _refitted(bench: Bench, before: Fit, classes: list[list[Tested]], others: Sequence[Tested]) -> list[Contender]:
    """The first of every class refitted, the best first."""
    fits: list[Contender] = []
    for group in classes:
        name = group[0].candidate.name
        if group[0].beside is not None and _explained([pair for pair in fits if pair[0].candidate.name == name]):
            continue
        # Beside a fit that leaves nothing but noise a candidate has to be as good from where it stands.
        found = add(bench, before, group[0], thorough=not _explained(fits))
        fits += [(group[0], found)] if found is not None else []
    if bench.mechanism.memory and fits:
        astray = not _explained(fits)
        fits = _out_of_wrong_minima(bench, before, classes, fits, others) if astray else _rivals_searched(bench, fits)
    fits.sort(key=lambda pair: penalised(pair[1]))
    for tested, fit in fits:
        gain = before.state.cost - fit.state.cost
        log.info(f"  {tested.candidate.name}: log-likelihood {gain:+.1f} on the fitted trials")
    return fits


def _explained(fits: Sequence[Contender]) -> bool:
    return any(fit.explains for _, fit in fits)


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
    return [
        (tested, bench.search(fit) or fit)
        if k < DEEP and penalised(fit) < reach_ and not fit.explains
        else (tested, fit)
        for k, (tested, fit) in enumerate(fits)
    ]


def _rivals_searched(bench: Bench, fits: Sequence[Contender]) -> list[Contender]:
    """The fits, the best and those near it searched anew: of two that are much alike one may have stopped short."""
    fits = sorted(fits, key=lambda pair: penalised(pair[1]))
    near = sum(penalised(fit) < penalised(fits[0][1]) + NEAR for _, fit in fits[:DEEP])
    if near < 2:
        return fits
    found = [(tested, bench.search(fit) or fit) for tested, fit in fits[:near]]
    best = min((fit for _, fit in found), key=penalised)
    for k, (tested, fit) in enumerate(found):
        own = {name: fit.values[name] for name in (*tested.candidate.strengths, *tested.candidate.hidden)}
        beside = None if fit is best else bench.refit(fit, fit.names, {**fit.values, **_shared(best, fit), **own})
        if beside is not None and beside.state.cost < fit.state.cost:
            found[k] = tested, beside
    return [*found, *fits[near:]]


def _shared(best: Fit, fit: Fit) -> dict[str, float]:
    return {name: best.values[name] for name in fit.names if name in best.names}


def _try_others(
    bench: Bench, before: Fit, classes: list[list[Tested]], fits: list[Contender], others: Sequence[Tested]
) -> None:
    """Refit candidates outside the classes, each as a class of its own, until one explains the residual."""
    known = [group[0].trace for group in classes]
    for tested in others:
        if any(abs(float(trace @ tested.trace)) >= ALIKE for trace in known):
            continue
        found = add(bench, before, tested, thorough=False)
        classes.append([tested])
        fits += [(tested, found)] if found is not None else []
        if found is not None and found.explains:
            return


def _proof(bench: Bench, before: Fit, tested: Tested, fit: Fit, settings: Settings) -> tuple[float | None, str]:
    """Gain on the held-out trials (None without any), and why the candidate is refused, if it is."""
    gain, need = before.state.cost - fit.state.cost, needed(tested, settings)
    if gain < need:
        return None, f"refitted, it gains {gain:.1f} in log-likelihood; {need:.1f} are needed"
    held = held_out_gain(bench, before, fit, settings.gain)
    if held is not None and held < settings.gain:
        return held, f"held-out trials do not improve ({held:+.1f} in log-likelihood)"
    return held, ""


def _decide(
    bench: Bench, before: Fit, first: Contender, held: float | None, near: Sequence[Contender], enough: float
) -> tuple[Contender, float | None, list[Contender], list[Refused]]:
    """Among fits that are about as good, the one that trials which no fit saw prefer; those that they reject."""
    if held is None or not near:
        return first, held, list(near), []
    judged = [(first, held), *((pair, held_out_gain(bench, before, pair[1], enough) or 0.0) for pair in near)]
    winner, best = max(judged[1:], key=lambda item: item[1])
    if best <= held + DECISIVE:
        least = penalised(first[1])
        level = [(pair, gain) for pair, gain in judged if penalised(pair[1]) - least < TIED and held - gain < TIED]
        winner, best = min(level, key=lambda item: item[0][0].candidate.usual)
    others = [(pair, gain) for pair, gain in judged if pair is not winner]
    name = winner[0].candidate.name
    worse = [
        Refused(pair[0].candidate, f"held-out trials improve less than with {name} ({gain:+.1f}, {best:+.1f})")
        for pair, gain in others
        if gain < best - DECISIVE
    ]
    return winner, best, [pair for pair, gain in others if gain >= best - DECISIVE], worse


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


def penalised(fit: Fit) -> float:
    """Cost and half a unit of log-likelihood times log n for every parameter (Bayesian information criterion)."""
    return fit.state.cost + 0.5 * len(fit.names) * np.log(fit.count)


def add(bench: Bench, fit: Fit, tested: Tested, thorough: bool = True) -> Fit | None:
    """Refit with a candidate's strengths and hidden parameters, from the fit and, where that is astray, from others."""
    limits, step = reach(tested), tested.step
    names = (*fit.names, *tested.candidate.strengths, *tested.candidate.hidden)
    worth = fit.state.cost - 0.3 * tested.statistic / 2
    tries: list[Fit] = []
    astray = thorough and tested.statistic > ASTRAY
    bases = [fit.values, *({**fit.values, **start} for start in (bench.starts if astray else ()))]
    back = lifted(bench.problem, bench.sizes, fit.values)
    for base in [*bases, *([back] if back else []), *([tested.beside] if tested.beside else [])]:
        # From neutral, since Gauss-Newton moves all parameters together; from its step where that fails.
        for share in (0.0, 1.0):
            values = {**base, **tested.shape} | {name: share * value for name, value in step.items()}
            found = bench.refit(fit, names, bench.clip(values), limits=limits)
            if found is not None:
                tries.append(found)
            if found is not None and found.state.cost < worth:
                break
    return min(tries, key=lambda f: f.state.cost, default=None)


def reach(tested: Tested) -> dict[str, tuple[float, float]]:
    """Values that hidden parameters may take: those tried, and somewhat beyond."""
    result = {}
    for name in tested.candidate.hidden:
        values = [point[name] for point in tested.candidate.grid]
        low, high = min(values), max(values)
        wide = 0.1 * (high - low)
        result[name] = (low / 1.5, high * 1.5) if low > 0 else (low - wide, high + wide)
    return result


def needed(tested: Tested, settings: Settings) -> float:
    """Log-likelihood that a candidate must gain, refitted."""
    freedom = max(tested.freedom, 1)
    return float(chi2.isf(10.0**settings.log_p / 50, freedom)) / 2
