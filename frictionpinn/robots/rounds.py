"""One round of a robot's diagnosis: every term tested at a fit, and what is added of them.

Public: :func:`round_at`, :func:`reasons`, :class:`Accepted`, :class:`Settings`, :class:`Tried`, :func:`frictions`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import norm

from .balance import Model
from .candidates import AT_JOINTS, ON_ROBOT, Term, at_joint, on_robot
from .identify import begun_anew
from .least_squares import Solution, solve
from .motion import Prepared
from .score import Confirmed, Scored, Scorer
from .whole import joint_of

SURE = 2.0  # standard errors by which a cross-validated gain is one
MOST_RIVALS = 3  # that are refitted beside the best: what is scored is linear, what is added is not
SIMILAR = 0.9  # of the best gain: terms that explain as much are named with it


@dataclass(frozen=True)
class Settings:
    """Thresholds.

    Attributes:
        log_p: decimal logarithm of the chance of a false alarm over all terms of all joints.
        worth: root mean square of a term's torque over that of the joint's friction from which it matters.
        most: effects that are added at a joint, and at the robot, at most.
        joints, robot: effects that are tried.
        suspected: trials that may carry a payload; None: all.
    """

    log_p: float = -4.0
    worth: float = 0.01
    most: int = 4
    joints: tuple[str, ...] = AT_JOINTS
    robot: tuple[str, ...] = ON_ROBOT
    suspected: tuple[str, ...] | None = None


@dataclass(frozen=True)
class Tried:
    """A term with the best value of its hidden parameters at a fit.

    Attributes:
        term: what was tried.
        hidden: that value.
        scored: what it would do.
        size: see ``Settings.worth``; the largest of the joints that it changes.
        rows: samples of a joint.
        confirmed: by cross-validation; None where it was not asked.
    """

    term: Term
    hidden: Mapping[str, float]
    scored: Scored
    size: float
    rows: int
    at: tuple[int, ...]
    confirmed: Confirmed | None = None

    @property
    def price(self) -> float:
        """Log-likelihood that its parameters cost (Schwarz)."""
        return 0.5 * (len(self.scored.step) + len(self.hidden)) * float(np.log(self.rows))

    @property
    def net(self) -> float:
        """Gain less price."""
        return self.scored.gain - self.price


@dataclass(frozen=True)
class Accepted:
    """A term that was added: how it was when it was, and which others explained as much."""

    tried: Tried
    alike: tuple[str, ...]

    @property
    def term(self) -> Term:
        """The term."""
        return self.tried.term


def round_at(
    solution: Solution, held: Sequence[str], accepted: Sequence[Accepted], settings: Settings, refused: dict[str, str]
) -> tuple[Solution, list[Accepted]] | None:
    """Terms that are added at a fit, and the fit with them, what was held at it free again; None where none is."""
    tried, count = score_all(solution, settings, refused, [a.term for a in accepted])
    freed = replace(solution, model=replace(solution.model, free=(*solution.model.free, *held)))
    kept = _best(freed, tried, count, settings, refused)
    if not kept and not held:
        kept = _best(freed, score_where_wanted(solution, tried, settings), count, settings, refused)
    if not kept:
        return None
    grown = freed.model
    for a in kept:
        grown = a.term.added(grown, a.tried.hidden, a.tried.scored.step)
    refit = begun_anew(solve(grown.held_near(), solution.trials, solution.sigmas))
    if held:  # what was told beside a law that did not fit must be told beside one that does
        names = [n for a in kept for n in a.term.names(refit.model, hidden=False)]
        sure = min(abs(refit.model.values[n]) / max(refit.errors[n], 1e-300) for n in names)
        if (np.log(2 * max(count, 1)) + norm.logsf(sure)) / np.log(10) > settings.log_p:
            return None
    return refit, kept


def frictions(solution: Solution) -> np.ndarray:
    """Root mean square of the friction of each joint on the fitted trials, N m, shape (joints,)."""
    parts = np.concatenate([trial.filtered(solution.model.torques(trial)[1]) for trial in solution.trials])
    return np.maximum(np.sqrt(np.mean(parts**2, axis=0)), 1e-12)


def score_all(
    solution: Solution, settings: Settings, refused: dict[str, str], present: Sequence[Term]
) -> tuple[list[Tried], int]:
    """Every term at a fit, with the best value of its hidden parameters, and how many tests that were."""
    model, trials = solution.model, solution.trials
    scorer, loads, level = Scorer(solution), [model.loads(t) for t in trials], frictions(solution)
    found, count = [], 0
    for term in _terms(model, trials, loads, settings, present):
        best, number = _scored(term, scorer, loads, level, settings)
        count += number
        if best is None:
            refused[term.name] = "could not be tested: its derivatives overflow"
            continue
        if best.scored.gain == 0.0:
            refused[term.name] = (
                "this motion does not tell it beside what is estimated already, or its sign is impossible"
            )
        found.append(best)
    return found, count


def score_where_wanted(solution: Solution, tried: Sequence[Tried], settings: Settings) -> list[Tried]:
    """Terms that a law's bristle may have been bent to, scored where the laws are at a fit with them.

    A bristle gives way before it slips as a gear gives way under load, and the declared model's fit takes the one for
    the other: far from the true laws the score test, which is linear, sees nothing.
    """
    model, trials = solution.model, solution.trials
    level, found = frictions(solution), []
    for t in tried:
        whole = t.term.whole
        if whole is None or not whole.like_a_bristle or not model.laws[joint_of(t.term.name)].memory:
            continue
        grown = solve(t.term.added(model, {}, t.scored.step).held_near(), trials, solution.sigmas)
        if not whole.possible([grown.model.values[n] for n in whole.parameters]):
            continue
        if solution.cost - grown.cost > t.price:
            there = grown.without(tuple(whole.parameters))
            loads = [there.model.loads(trial) for trial in trials]
            best, _ = _scored(t.term, Scorer(there), loads, level, settings)
            found += [best] if best is not None else []
    return found


def _scored(
    term: Term, scorer: Scorer, loads: Sequence[np.ndarray], level: np.ndarray, settings: Settings
) -> tuple[Tried | None, int]:
    """A term with the best value of its hidden parameters, and how many were tried."""
    model, trials = scorer.solution.model, scorer.solution.trials
    rows, number = sum(len(t.tau) for t in trials), 0
    best: Tried | None = None
    kept: tuple[list[np.ndarray], tuple[int, ...]] | None = None
    for some, columns, at in term.columns(model, trials, loads):
        number += len(some)
        if not all(np.isfinite(c).all() for c in columns):
            continue
        v, scored = scorer.test(columns, at, term.strengths, term.possible)
        if best is None or scored.gain > best.scored.gain:
            own = slice(v * term.strengths, (v + 1) * term.strengths)
            best = Tried(term, some[v], scored, float(np.max(scored.size / level)), rows, at)
            kept = [c[:, own].copy() if len(at) == 1 else c for c in columns], at
    if best is None or kept is None:
        return None, number
    if best.net > 0 and best.scored.log_p + np.log10(number) < settings.log_p:
        best = replace(best, confirmed=scorer.confirmed(*kept))
    return best, number


def _terms(
    model: Model, trials: Sequence[Prepared], loads: Sequence[np.ndarray], settings: Settings, present: Sequence[Term]
) -> Iterator[Term]:
    taken = {term.name for term in present}
    for k in range(len(model.names)):
        yield from (t for t in at_joint(model, k, trials, loads, settings.joints) if t.name not in taken)
    yield from (t for t in on_robot(model, settings.robot, settings.suspected) if t.name not in taken)


def _best(
    solution: Solution, tried: Sequence[Tried], count: int, settings: Settings, refused: dict[str, str]
) -> list[Accepted]:
    """What is added in this round: the best term of each joint, or one on the robot that is better than those of the
    joints that it changes together."""
    good = []
    for t in tried:
        log_p = t.scored.log_p + float(np.log10(max(count, 1)))
        if t.scored.gain == 0.0:
            continue
        if log_p > settings.log_p:
            refused[t.term.name] = f"not significant: chance {10.0 ** min(log_p, 0.0):.1g} over all that was tried"
        elif t.size < settings.worth:
            refused[t.term.name] = f"significant, but {100 * t.size:.2g} % of the joint's friction"
        elif t.confirmed is None or t.confirmed.gain < t.price or not t.confirmed.sure(SURE):
            gain = "nothing" if t.confirmed is None else f"{t.confirmed.gain:.3g} +- {t.confirmed.error:.2g}"
            refused[t.term.name] = f"not confirmed on stretches that its fit did not see: gain {gain}"
        else:
            good.append(t)
    chosen: list[Tried] = []
    for joint in {t.term.joint for t in good}:
        chosen.append(max((t for t in good if t.term.joint == joint), key=lambda t: t.net))
    on_it = next((t for t in chosen if t.term.joint is None), None)
    if on_it is not None:
        # It explains what terms of single joints do, too: the better of both is added, the other asked again.
        rivals = [t for t in chosen if t.term.joint is not None]
        strongest = max((t.net for t in rivals), default=-np.inf)
        chosen = [on_it] if on_it.net > strongest else rivals
    kept = []
    for best in chosen:
        rivals = [o for o in good if o is not best and _where(o) == _where(best) and o.net > SIMILAR * best.net]
        rivals.sort(key=lambda o: -o.net)
        t = min([best, *rivals[:MOST_RIVALS]], key=lambda o: _cost(solution, o)) if rivals else best
        alike = tuple(o.term.name for o in (best, *rivals) if o is not t)
        for o in good:
            if o is not t and _where(o) == _where(t):
                refused[o.term.name] = (
                    _alike_to(t.term) if o.term.name in alike else f"explains less than {t.term.name}"
                )
        kept.append(Accepted(t, alike))
    return kept


def reasons(refused: Mapping[str, str], accepted: Sequence[Accepted]) -> dict[str, str]:
    """Why terms are refused in the end: a later round asked what is alike to one that was added beside it, where it has
    nothing left to explain."""
    alike = {name: _alike_to(a.term) for a in accepted for name in a.alike}
    added = {a.term.name for a in accepted}
    return {name: why for name, why in {**refused, **alike}.items() if name not in added}


def _alike_to(term: Term) -> str:
    return f"explains about as much as {term.name}: the recording hardly tells them apart"


def _where(tried: Tried) -> int:
    """The joint that a term changes most."""
    return tried.at[0] if tried.term.joint is not None else int(np.argmax(tried.scored.size))


def _cost(solution: Solution, tried: Tried) -> float:
    """Cost of the model with a term, its parameters paid."""
    grown = tried.term.added(solution.model, tried.hidden, tried.scored.step)
    return solve(grown.held_near(), solution.trials, solution.sigmas).cost + tried.price
