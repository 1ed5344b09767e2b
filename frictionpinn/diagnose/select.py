"""Forward selection: the most significant candidates are refitted with all parameters, and one is kept if it proves
itself on trials that no fit saw."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.stats import chi2

from .bench import Bench, Fit
from .candidates import Candidate
from .remainder import Remainder
from .scan import Scanned, Tested, scan
from .score import ALIKE

log = logging.getLogger(__name__)

CONTENDERS = 7  # candidates that are refitted in a round
ASTRAY = 300.0  # statistic from which the fit is taken to be in a wrong minimum for want of the effect
WORTH = 0.5, 0.25  # of the best statistic: candidates with less are not refitted; where the fit is astray
DECISIVE = 2.0  # log-likelihood of the held-out trials by which one of several rivals wins
RIVAL = 6.0  # log-likelihood: candidates whose fits differ by less are not told apart
DEEP = 2  # contenders that are searched anew where no refit explains the residual
LIFTED, MANY = 3, 100  # candidates tried beside a friction that had vanished; shapes of those left out there
NEAR, SETTLED = 50.0, 3.0  # log-likelihood: rivals that are searched anew too; a gain that counts


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


@dataclass
class Selection:
    """What forward selection did.

    Attributes:
        base, fit: the declared model, and the last accepted one, on the fitted trials.
        accepted: effects in the order in which they came.
        refused: candidates with a reason.
        first, last: what the scans of the declared and of the last model found.
    """

    base: Fit
    fit: Fit
    first: Scanned
    last: Scanned
    accepted: list[Accepted] = field(default_factory=list)
    refused: list[Refused] = field(default_factory=list)


def select(
    bench: Bench,
    options: Sequence[Candidate],
    remainders: Sequence[Remainder],
    places: Mapping[str, float],
    settings: Settings,
) -> Selection:
    """Add effects one by one while a significant one proves itself.

    Args:
        bench: the fitted declared model.
        options: candidates.
        remainders, places: see :func:`frictionpinn.diagnose.scan.scan`.
        settings: thresholds.
    """
    fit = bench.base()
    found = scan(bench, fit, options, remainders, places)
    selection = Selection(fit, fit, found, found)
    while len(selection.accepted) < settings.most:
        taken = {name for a in selection.accepted for name in a.candidate.strengths}
        banned = {r.candidate.name for r in selection.refused}
        significant = [
            t for t in selection.last.tested
            if t.log_p + np.log10(len(options)) < settings.log_p
            and not taken & set(t.candidate.strengths) and t.candidate.name not in banned
        ]  # fmt: skip
        if not significant and not _remains(selection, settings):
            break
        hidden = _beside_lifted(bench, selection, options)
        if _round(bench, selection, significant, hidden, settings) is None:
            break
        _rescan(bench, selection, options, remainders, places)
        astray = bench.mechanism.memory and explained(bench, selection.fit) and _doubtful(selection, options, settings)
        if astray and _deepen(bench, selection):
            _rescan(bench, selection, options, remainders, places)
        if len(selection.accepted) > 1 and _drop(bench, selection, settings):
            _rescan(bench, selection, options, remainders, places)
    return selection


def _rescan(
    bench: Bench,
    selection: Selection,
    options: Sequence[Candidate],
    remainders: Sequence[Remainder],
    places: Mapping[str, float],
) -> None:
    taken = {name for a in selection.accepted for name in a.candidate.strengths}
    # What shapes an effect that is part of the model is known: its other strengths are tested with that.
    present = {a.candidate.effect for a in selection.accepted}
    left = [replace(c, hidden=(), grid=({},)) if c.effect in present else c for c in options]
    left = [c for c in left if not taken & set(c.strengths)]
    selection.last = scan(bench, selection.fit, left, remainders, places)
    selection.fit = _reweighted(bench, selection.fit, selection.last)


def _remains(selection: Selection, settings: Settings) -> bool:
    """Whether the residual depends on a variable."""
    tests = [m.log_p + np.log10(len(selection.last.remaining)) for m in selection.last.remaining]
    return min(tests, default=0.0) < settings.log_p


def _beside_lifted(bench: Bench, selection: Selection, options: Sequence[Candidate]) -> list[Tested]:
    """The best candidates beside a friction that vanished from the fit, brought back: some show only together."""
    fit = selection.fit
    lifted = bench.lifted(fit.values)
    if lifted is None:
        return []
    moved = {name for name in fit.names if lifted[name] != fit.values[name]}
    made = bench.refit(fit, tuple(n for n in fit.names if n not in moved), lifted)
    if made is None:
        return []
    banned = {r.candidate.name for r in selection.refused}
    present = {a.candidate.effect for a in selection.accepted}
    left = [c for c in options if c.effect not in present and c.name not in banned and len(c.grid) < MANY]
    return list(scan(bench, made, left, (), {}).tested[:LIFTED])


def _doubtful(selection: Selection, options: Sequence[Candidate], settings: Settings) -> bool:
    """Whether something is significant still, a candidate or a variable."""
    tests = [t.log_p + np.log10(len(options)) for t in selection.last.tested]
    tests += [m.log_p + np.log10(len(selection.last.remaining)) for m in selection.last.remaining]
    return min(tests, default=0.0) < settings.log_p


def _deepen(bench: Bench, selection: Selection) -> bool:
    """Search the last model and its close rivals from all starts: where one was fitted to a wrong minimum, what is left
    looks like an effect. Says whether the fit changed."""
    last = selection.accepted[-1]
    best, choice, cost = selection.fit, last, _penalised(selection.fit)
    for tested, fit in ((last.tested, selection.fit), *last.close):
        found = bench.search(replace(fit, sigmas=selection.fit.sigmas))
        if found is not None and _penalised(found) < cost - SETTLED:
            best, cost = found, _penalised(found)
            choice = replace(
                last, candidate=tested.candidate, tested=tested, alike=() if tested is not last.tested else last.alike
            )
    changed = best is not selection.fit
    selection.fit, selection.accepted[-1] = best, choice
    return changed


def _drop(bench: Bench, selection: Selection, settings: Settings) -> bool:
    """Take out effects that came first and are not needed beside later ones."""
    changed = False
    for accepted in selection.accepted[:-1]:
        own = {*accepted.candidate.strengths, *accepted.candidate.hidden}
        others = {
            n for a in selection.accepted if a is not accepted for n in (*a.candidate.strengths, *a.candidate.hidden)
        }
        names = tuple(n for n in selection.fit.names if n not in own - others)
        neutral = dict.fromkeys(accepted.candidate.strengths, 0.0)
        found = bench.refit(selection.fit, names, selection.fit.values | neutral)
        if found is not None and found.state.cost - selection.fit.state.cost < _needed(accepted.tested, settings):
            loss = found.state.cost - selection.fit.state.cost
            selection.refused.append(Refused(accepted.candidate, f"not needed beside later effects ({loss:+.1f} in "
                                                                 "log-likelihood without it)"))  # fmt: skip
            selection.fit, changed = found, True
            selection.accepted.remove(accepted)
    return changed


def _round(
    bench: Bench,
    selection: Selection,
    significant: Sequence[Tested],
    beside: Sequence[Tested],
    settings: Settings,
) -> Accepted | None:
    """Refit the contenders, take the best that the held-out trials confirm; None if there is none."""
    before = selection.fit
    classes = [*contenders(significant), *([t] for t in beside)]
    fits = [(group[0], f) for group in classes if (f := add(bench, before, group[0])) is not None]
    fits.sort(key=lambda pair: _penalised(pair[1]))
    if fits and bench.mechanism.memory and not explained(bench, fits[0][1]):
        deeper = [(t, bench.search(f) or f) for t, f in fits[:DEEP]]
        fits = sorted([*deeper, *fits[DEEP:]], key=lambda pair: _penalised(pair[1]))
    for tested, fit in fits:
        gain = before.state.cost - fit.state.cost
        log.info(f"  {tested.candidate.name}: log-likelihood +{gain:.1f} on the fitted trials")
    for k, (tested, fit) in enumerate(fits):
        gain, need = before.state.cost - fit.state.cost, _needed(tested, settings)
        if gain < need:
            why = f"refitted, it gains {gain:.1f} in log-likelihood; {need:.1f} are needed"
            selection.refused.append(Refused(tested.candidate, why))
            continue
        held = _held_out_gain(bench, before, fit)
        if held is not None and held < settings.gain:
            why = f"held-out trials do not improve ({held:+.1f} in log-likelihood)"
            selection.refused.append(Refused(tested.candidate, why))
            continue
        rivals = [(t, f) for t, f in fits[k + 1 :] if _penalised(f) - _penalised(fit) < RIVAL]
        if held is not None:  # trials that no fit saw decide between them where they can
            judged = [(t, f, _held_out_gain(bench, before, f) or 0.0) for t, f in rivals]
            best = max(judged, key=lambda item: item[2], default=None)
            if best is not None and best[2] > held + DECISIVE:
                judged = [(tested, fit, held), *(item for item in judged if item is not best)]
                tested, fit, held = best
                gain = before.state.cost - fit.state.cost
            for t, _, other in judged:
                if other < held - DECISIVE:
                    why = f"held-out trials improve less than with {tested.candidate.name} ({other:+.1f}, {held:+.1f})"
                    selection.refused.append(Refused(t.candidate, why))
            rivals = [(t, f) for t, f, other in judged if other >= held - DECISIVE]
        same = next(group for group in classes if group[0] is tested)[1:]
        alike = tuple(
            (c, {n: values[n] for n in c.strengths})
            for c, values in (*((t.candidate, t.step) for t in same), *((t.candidate, f.values) for t, f in rivals))
        )
        evidence = {"statistic": tested.statistic, "log10_p": tested.log_p, "gain_fitted": gain}
        if held is not None:
            evidence["gain_held_out"] = held
        close = tuple((t, f) for t, f in fits[k + 1 :] if _penalised(f) - _penalised(fit) < max(NEAR, 0.1 * gain))
        accepted = Accepted(tested.candidate, tested, evidence, alike, close[:DEEP])
        selection.accepted.append(accepted)
        selection.fit = fit
        return accepted
    return None


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


def _penalised(fit: Fit) -> float:
    """Cost and half a unit of log-likelihood times log n for every parameter (Bayesian information criterion)."""
    count = sum(len(model.t) * len(model.outputs) for model in fit.models)
    return fit.state.cost + 0.5 * len(fit.names) * np.log(count)


def add(bench: Bench, fit: Fit, tested: Tested) -> Fit | None:
    """Refit with a candidate's strengths and hidden parameters, from the fit and, where that is astray, from others."""
    limits, step = reach(tested), tested.step
    names = (*fit.names, *tested.candidate.strengths, *tested.candidate.hidden)
    worth = fit.state.cost - 0.3 * tested.statistic / 2
    tries: list[Fit] = []
    bases = [fit.values, *({**fit.values, **start} for start in bench.starts if tested.statistic > ASTRAY)]
    lifted = bench.lifted(fit.values)
    for base in [*bases, *([lifted] if lifted else [])]:
        # From neutral, since Gauss-Newton moves all parameters together; from its step where that fails.
        for share in (0.0, 1.0):
            values = base | tested.shape | {name: share * value for name, value in step.items()}
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


def _needed(tested: Tested, settings: Settings) -> float:
    """Log-likelihood that a candidate must gain, refitted."""
    freedom = max(tested.freedom, 1)
    return float(chi2.isf(10.0**settings.log_p / 50, freedom)) / 2


def explained(bench: Bench, fit: Fit) -> bool:
    """Whether the residual is as small as the noise that differences of the signals show."""
    count = sum(int(np.isfinite(r).sum()) for piece in fit.state.pieces for r in piece.residuals.values())
    sigmas = bench.problem.sigmas
    chi = sum(
        float(np.nansum((r / sigmas[name]) ** 2)) for piece in fit.state.pieces for name, r in piece.residuals.items()
    )
    return chi / count < 1.03


def _held_out_gain(bench: Bench, before: Fit, after: Fit) -> float | None:
    """Log-likelihood that the held-out trials gain; None without such trials."""
    if bench.checked is None:
        return None
    old, new = bench.check(before), bench.check(replace(after, sigmas=before.sigmas))
    if old is None or new is None:
        return None if new is not None else -np.inf
    return old.state.cost - new.state.cost


def _reweighted(bench: Bench, fit: Fit, scanned: Scanned) -> Fit:
    """The fit at the noise levels that the last scan found."""
    noise = scanned.noise
    sigmas = {}
    for name, sigma in fit.sigmas.items():
        a = noise.coefficients.get(name, np.zeros(0))
        sigmas[name] = sigma if len(a) else sigma * noise.scale.get(name, 1.0)
    found = bench.refit(fit, fit.names, fit.values, sigmas)
    return found or fit
