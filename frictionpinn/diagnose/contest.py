"""One round of the selection: the significant candidates are refitted, and held-out trials judge the best of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.stats import chi2

from ..numerics.parallel import WORKERS, in_parallel
from .bench import NEAR, Bench
from .candidates import Candidate
from .fit import Fit
from .held_out import compared_gains, held_out_gain
from .minima import DEEP, gained
from .possible import impossible
from .refits import contenders, refitted
from .rivals import RIVAL, Contender, same
from .scan import Tested
from .tries import from_windows, leaves_little, penalised
from .windows import Asked, over_windows

DECISIVE = 2.0  # log-likelihood of the held-out trials by which one of several rivals wins
NAMELESS = "explains but a part, alone and with others, over short windows as over whole trials"
TIED = 1.0  # log-likelihood: of fits that differ by less, on either trials, the more usual effect stands first


@dataclass(frozen=True)
class Settings:
    """Thresholds.

    Attributes:
        log_p: decimal logarithm of the chance, over all candidates, below which one counts as significant.
        most: effects that are added at most.
        gain: log-likelihood that the held-out trials must gain.
        worth: root mean square of what is left over that of the friction force, from which it matters: friction itself
            repeats to a few per cent from day to day, and a long recording makes far less significant.
    """

    log_p: float = -4.0
    most: int = 4
    gain: float = 1.0
    worth: float = 0.01


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


def contest(
    bench: Bench,
    before: Fit,
    significant: Sequence[Tested],
    beside: Callable[[], Sequence[Tested]],
    others: Sequence[Tested],
    settings: Settings,
    asked: Asked | None = None,
    untested: Sequence[Tested] = (),
) -> tuple[Accepted, Fit, list[Refused]] | tuple[None, Fit, list[Refused]]:
    """Refit the contenders and take the best that the held-out trials confirm.

    Args:
        before: the last accepted fit.
        significant: candidates by their score tests, the most significant first.
        beside: tells candidates that show only beside a friction that had vanished.
        others: all candidates, the most significant first: tried where none of the above explains the residual, since a
            fit in a wrong minimum hides even what it lacks.
        settings: thresholds.
        asked: what is tested over short windows, where the fit leaves more than noise.
        untested: candidates of one parameter whose derivatives overflow: refitted all the same, and before those of
            many shapes (ripple, vibration).

    Returns:
        What was accepted or None, the fit with it, and the candidates that were refused on the way.
    """
    classes = contenders(significant)
    if asked is not None and bench.mechanism.memory and not before.explains:
        ranked = over_windows(bench, before, classes, others, asked)
        if asked.variables and ranked.nameless() and not _leaves_little(bench, before, ranked.classes):
            return None, before, [Refused(group[0].candidate, NAMELESS) for group in ranked.classes]
        classes, others = ranked.classes, ranked.others
    classes = _with_untested(classes, untested)
    fits = refitted(bench, before, classes, others, beside)
    refused: list[Refused] = []
    for k, (tested, fit, held, why) in enumerate(_proofs(bench, before, fits, settings)):
        if why:
            refused.append(Refused(tested.candidate, why))
            continue
        rest = list(fits[k + 1 :])
        if steadier := _steadier(bench, before, (tested, fit), rest, settings):
            rest = [pair for pair in rest if pair is not steadier]
            why = f"predicts held-out trials worse than {steadier[0].candidate.name}"
            refused.append(Refused(tested.candidate, why))
            tested, fit = steadier
            held = held_out_gain(bench, before, fit, settings.gain)
        near = [pair for pair in rest if _behind(pair, (tested, fit)) < RIVAL]
        (tested, fit), held, near, worse = _decide(bench, before, (tested, fit), held, near)
        near += indistinct(
            bench, before, (tested, fit), [p for p in fits if all(p[0] is not q[0] for q in near)], settings
        )
        gain = gained(before, fit)
        twins = next(group for group in classes if group[0] is tested)[1:]
        alike = [(t.candidate, {n: t.step[n] for n in t.candidate.strengths}) for t in twins]
        alike += [(t.candidate, {n: f.values[n] for n in t.candidate.strengths}) for t, f in near]
        told = np.nan if tested.untested else 1.0
        evidence = {"statistic": told * tested.statistic, "log10_p": told * tested.log_p, "gain_fitted": gain}
        evidence |= {} if held is None else {"gain_held_out": held}
        close = [p for p in fits if p[0] is not tested and penalised(p[1]) - penalised(fit) < max(NEAR, 0.1 * gain)]
        listed = {tested.candidate.name, *(c.name for c, _ in alike)}
        refused = [r for r in (*refused, *worse) if r.candidate.name not in listed]
        return Accepted(tested.candidate, tested, evidence, tuple(alike), tuple(close[:DEEP])), fit, refused
    return None, before, refused


def _with_untested(classes: list[list[Tested]], untested: Sequence[Tested]) -> list[list[Tested]]:
    """The classes, and those that could not be tested before what has hidden parameters: that fits anything."""
    known = {t.candidate.name for group in classes for t in group}
    added = [[t] for t in untested if t.candidate.name not in known]
    if not added:
        return classes
    shaped = [group for group in classes if group[0].candidate.hidden]
    return [*(group for group in classes if not group[0].candidate.hidden), *added, *shaped]


def indistinct(
    bench: Bench, before: Fit, winner: Contender, others: Sequence[Contender], settings: Settings
) -> list[Contender]:
    """Those that act as the winner does and that all trials together do not tell from it, see :func:`same`: also one
    that the held-out trials alone refused by a hair."""
    near = [
        pair for pair in others
        if pair[0] is not winner[0] and same(winner[0], pair[0], _behind(pair, winner), -np.inf)
        and gained(before, pair[1]) >= needed(pair[0], settings)
        and not impossible(bench, pair[0].candidate, pair[1].values)
    ]  # fmt: skip
    if not near:
        return []
    held, *gains = compared_gains(bench, before, [fit for _, fit in (winner, *near)])
    return [p for p, gain in zip(near, gains, strict=True) if same(winner[0], p[0], _behind(p, winner), held - gain)]


def _leaves_little(bench: Bench, before: Fit, classes: Sequence[Sequence[Tested]]) -> bool:
    """Whether one of the candidates, fitted to whole trials from windows, leaves little of what the model leaves."""
    made = in_parallel(lambda k: from_windows(bench, before, classes[k][0]), [1.0] * len(classes))
    return any(leaves_little(before, fit) for fit in made if fit is not None)


def _proofs(
    bench: Bench, before: Fit, fits: Sequence[Contender], settings: Settings
) -> Iterator[tuple[Tested, Fit, float | None, str]]:
    """Every contender with its proof, see :func:`_proof`: the first as a rule passes, others are judged together.

    One that windows led to may have stopped in a minimum near the best: refused, it is searched anew and asked again.
    """

    def judged(first: int, k: int) -> tuple[Tested, Fit, float | None, str]:
        tested, fit = fits[first + k]
        held, why = _proof(bench, before, tested, fit, settings)
        if held is not None and why and tested.short is not None and fit.explains and not fit.searched:
            fit = bench.search(fit)
            held, why = _proof(bench, before, tested, fit, settings)
        return tested, fit, held, why

    for first, last in ((0, 1), *((k, k + WORKERS) for k in range(1, len(fits), WORKERS))):
        yield from in_parallel(partial(judged, first), [1.0] * len(fits[first:last]))


def _proof(bench: Bench, before: Fit, tested: Tested, fit: Fit, settings: Settings) -> tuple[float | None, str]:
    """Gain on the held-out trials (None without any), and why the candidate is refused, if it is."""
    gain, need = gained(before, fit), needed(tested, settings)
    if gain < need:
        return None, f"refitted, it gains {gain:.1f} in log-likelihood; {need:.1f} are needed"
    if why := impossible(bench, tested.candidate, fit.values):
        return None, why
    held = held_out_gain(bench, before, fit, settings.gain)
    if held is not None and held < settings.gain:
        return held, f"held-out trials do not improve ({held:+.1f} in log-likelihood)"
    return held, ""


def _behind(pair: Contender, first: Contender) -> float:
    return penalised(pair[1]) - penalised(first[1])


def _steadier(
    bench: Bench, before: Fit, first: Contender, others: Sequence[Contender], settings: Settings
) -> Contender | None:
    """One that predicts the held-out trials as it was fitted, where the first does so only once its parameters move.

    Such a first is bent to the fitted trials (a static friction above all that they show). The other may lie farther
    behind than a rival, but has to make up for what is beyond that on the held-out trials.
    """
    farther = [
        pair for pair in others
        if RIVAL <= _behind(pair, first) < NEAR and gained(before, pair[1]) >= needed(pair[0], settings)
    ]  # fmt: skip
    if not farther or _predicts(bench, before, first, settings):
        return None
    farther = [pair for pair in farther if _predicts(bench, before, pair, settings)]
    held, *gains = compared_gains(bench, before, [fit for _, fit in (first, *farther)])
    made_up = [gain - held - (_behind(pair, first) - RIVAL) for pair, gain in zip(farther, gains, strict=True)]
    best = max(range(len(farther)), key=made_up.__getitem__, default=None)
    return None if best is None or made_up[best] <= DECISIVE else farther[best]


def _predicts(bench: Bench, before: Fit, pair: Contender, settings: Settings) -> bool:
    """Whether held-out trials, if there are any, improve with the parameters as fitted."""
    gain = held_out_gain(bench, before, pair[1], -np.inf)
    return gain is None or gain >= settings.gain


def _decide(
    bench: Bench, before: Fit, first: Contender, held: float | None, near: Sequence[Contender]
) -> tuple[Contender, float | None, list[Contender], list[Refused]]:
    """Among fits that are about as good, the one that trials which no fit saw prefer; those that they reject."""
    if held is None:
        level = [first, *(pair for pair in near if _behind(pair, first) < TIED)]
        usual = min(level, key=_unusual)
        return usual, None, [pair for pair in (first, *near) if pair is not usual], []
    if not near:
        return first, held, [], []
    rivals = [first, *near]
    judged = list(zip(rivals, compared_gains(bench, before, [fit for _, fit in rivals]), strict=True))
    held = judged[0][1]
    winner, best = max(judged[1:], key=lambda item: item[1])
    if best <= held + DECISIVE:
        tied = [(pair, gain) for pair, gain in judged if _behind(pair, first) < TIED and held - gain < TIED]
        winner, best = min(tied, key=lambda item: _unusual(item[0]))
    others = [(pair, gain) for pair, gain in judged if pair is not winner]
    name = winner[0].candidate.name
    worse = [
        Refused(pair[0].candidate, f"held-out trials improve less than with {name} ({gain:+.1f}, {best:+.1f})")
        for pair, gain in others
        if gain < best - DECISIVE
    ]
    return winner, best, [pair for pair, gain in others if gain >= best - DECISIVE], worse


def _unusual(pair: Contender) -> tuple[int, bool]:
    """What stands first among equals: the more usual effect, then one that adds: a delay, no reading of the future."""
    tested, fit = pair
    return tested.candidate.usual, min(fit.values[name] for name in tested.candidate.strengths) < 0


def needed(tested: Tested, settings: Settings) -> float:
    """Log-likelihood that a candidate must gain, refitted."""
    freedom = max(tested.freedom, 1)
    return float(chi2.isf(10.0**settings.log_p / 50, freedom)) / 2
