"""Candidates refitted with all parameters, and judged by what fitted and held-out trials say of them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from ..numerics.parallel import in_parallel
from .bench import Bench
from .candidates import Candidate, impossible
from .fit import Fit
from .held_out import Surprise, surprise
from .scan import Tested

TESTED = 50  # about as many candidates are tested: the chance is that of all of them together
Asked = list[tuple[Tested, list[Tested]]]  # candidates to refit, each with those that its score test is not told from


@dataclass(frozen=True)
class Settings:
    """What a diagnosis may be told.

    Attributes:
        log_p: decimal logarithm of the chance, over all candidates, below which one counts as significant: one
            recording in 10,000 that lacks nothing is said to.
        most: effects that are added at most, a budget.
        refits: candidates that are refitted after each kind of score test, a budget.
        promise: share of the gain that a score test promises, below which a refit shows that it is not linear there.
        instead: share of the statistic of an effect that was added, below which another one is not tried in its place
            later: a budget.
        told_apart: evidence, in log-likelihood, from which one model is better than another for certain: 400 to 1.
        tied: evidence below which the more usual effect stands first: less than 3 to 1.
        gain: log-likelihood that the held-out trials must gain: they may not speak against a model by 3 to 1. A true
            effect as weak as can be found gains little there, by chance less than nothing.
        worth: root mean square of what is left over that of the friction force, from which it matters: friction itself
            repeats to a few per cent from day to day, and a long recording makes far less significant.
        samples: of fitted and held-out trials together that are looked at; of a longer recording, windows spread evenly
            over it. A budget: each takes up to 0.2 MB of memory and 20 ms of a processor, and what so many do not
            show is worth little.
    """

    log_p: float = -4.0
    most: int = 4
    refits: int = 5
    promise: float = 0.5
    instead: float = 0.5
    told_apart: float = 6.0
    tied: float = 1.0
    gain: float = -1.0
    worth: float = 0.01
    samples: int = 50_000


@dataclass(frozen=True)
class Refused:
    """A candidate that was not added, and why."""

    candidate: Candidate
    why: str


@dataclass(frozen=True)
class Contender:
    """A candidate with its refit, and what trials that no fit saw say of that."""

    tested: Tested
    fit: Fit
    surprise: Surprise | None = None
    gain: float | None = None  # log-likelihood that the held-out trials gain

    @property
    def candidate(self) -> Candidate:
        """What it is a fit of."""
        return self.tested.candidate

    @property
    def cost(self) -> float:
        """Negative evidence of all trials."""
        return self.fit.cost + (self.surprise.moved if self.surprise else 0.0)


def refitted(bench: Bench, before: Fit, asked: Asked, settings: Settings) -> list[Contender]:
    """The candidates' fits, the best first, each from the resolution at which it was tested to the sample: from the
    coarse one, too, where a search at the sample comes to no end or gains much less than the score test promised; and
    where any comes to none, and no other explains all but noise, a trial that lags behind the others once more in each.
    Where one still gains much less, what that did not tell from it is fitted beside it."""

    def short(tested: Tested, fit: Fit | None) -> bool:
        return fit is None or before.state.cost - fit.state.cost < settings.promise * tested.statistic / 2

    def refit(tested: Tested) -> Fit | None:
        fit = None if tested.width else add(bench, before, tested, [0.0])
        if fit is not None and fit.ended and not short(tested, fit):
            return fit
        made = [f for f in (fit, add(bench, before, tested, bench.from_coarse)) if f is not None]
        return bench.together(made) if made else None

    def refits(tests: Sequence[Tested]) -> list[tuple[Tested, Fit | None]]:
        def regained(k: int) -> Fit | None:
            fit = fits[k]
            return None if fit is None else bench.regained(fit)

        fits = in_parallel(lambda k: refit(tests[k]), [1.0] * len(tests), "effects fitted")
        left = [fit for fit in fits if fit is not None]
        if not all(fit.ended for fit in left) and not any(fit.white for fit in left):
            fits = in_parallel(regained, [1.0] * len(tests), "effects fitted anew")
        return list(zip(tests, fits, strict=True))

    made = refits([head for head, _ in asked])
    less = [group for (_, group), (t, fit) in zip(asked, made, strict=True) if short(t, fit)]
    beside = {t.candidate.name: t for group in less for t in group}
    made += refits([t for name, t in beside.items() if name not in {t.candidate.name for t, _ in made}])
    return _lowest(bench, (Contender(t, fit) for t, fit in made if fit is not None))


def _lowest(bench: Bench, found: Iterable[Contender]) -> list[Contender]:
    """The best fit of each candidate, of each trial the best that its fits have, the best first."""
    fits: dict[str, list[Contender]] = {}
    for c in sorted(found, key=lambda c: c.fit.cost):
        fits.setdefault(c.candidate.name, []).append(c)
    best = [replace(own[0], fit=bench.together([c.fit for c in own])) for own in fits.values()]
    return sorted(best, key=lambda c: c.fit.cost)


def exchanged(head: Contender, own: Tested) -> dict[str, float]:
    """Values of a contender's fit with a candidate's strengths, as many times their step, in the place of its own.

    What the contender's strengths took of the estimated parameters is given back, and what the candidate's take is
    taken: to first order the motion stays, where the score tests do not tell the two apart.
    """
    step, now = (np.array([of[name] for name in head.tested.step]) for of in (head.tested.step, head.fit.values))
    share = float(now @ step / max(step @ step, 1e-300))
    values = head.fit.values | dict.fromkeys(head.tested.step, 0.0) | own.shape
    for name, move in head.tested.moves.items():
        values[name] += share * (own.moves.get(name, 0.0) - move)
    return values | {name: share * value for name, value in own.step.items()}


def add(bench: Bench, fit: Fit, tested: Tested, widths: Sequence[float]) -> Fit | None:
    """Refit with a candidate's strengths and hidden parameters, from neutral: Gauss-Newton moves all parameters
    together; where no derivative holds, from a guess as well."""
    names = (*fit.names, *tested.candidate.strengths, *tested.candidate.hidden)
    made = []
    for share in (0.0, 1.0) if tested.untested else (0.0,):
        values = {**fit.values, **tested.shape} | {name: share * value for name, value in tested.step.items()}
        made.append(bench.refit(fit, names, bench.clip(values), widths=widths))
    return min((f for f in made if f is not None), key=lambda f: f.state.cost, default=None)


def judged(
    bench: Bench, before: Fit, found: Sequence[Contender], asked: Asked, settings: Settings
) -> tuple[Contender | None, list[Contender], list[Refused]]:
    """The contender that is kept, its rivals of which the evidence is about as good, and those that are refused.

    Args:
        before: the fit without any of them.
        found: candidates refitted, the best first.
        asked: what they were refitted for.
        settings: significances and budgets.
    """
    reference, able = surprise(bench, before), [(c, impossible(bench, c.candidate, c.fit.values)) for c in found]
    refused, left = [Refused(c.candidate, why) for c, why in able if why], [c for c, why in able if not why]
    # Of what was tested twice the test at the sample, which comes first, is taken.
    classes = [{t.candidate.name: t for t in (head, *group)} for head, group in asked[::-1]]
    out = set[str]()  # what is refused
    while left := [c for c in left if c.candidate.name not in out]:
        alike = [{n: t for n, t in members.items() if n not in out} for members in classes]
        left = _as_near(bench, before.names, left, alike, settings)
        for c in left:
            gain, need = before.state.cost - c.fit.state.cost, needed(c.tested, settings)
            if gain < need:
                out.add(c.candidate.name)
                why = f"refitted, it gains {gain:.3g} in log-likelihood; {need:.3g} are needed"
                refused.append(Refused(c.candidate, why))
        if not (left := [c for c in left if c.candidate.name not in out]):
            break
        near = _checked(bench, [c for c in left if c.fit.cost < left[0].fit.cost + settings.told_apart])
        if reference is not None and (failed := [c.candidate for c in near if c.surprise is None]):
            refused += [Refused(candidate, "held-out trials cannot be simulated with it") for candidate in failed]
            out |= {candidate.name for candidate in failed}
            continue
        winner, rivals = _preferred(near, settings)
        held: float | None = None
        if reference is not None and (there := winner.surprise) is not None:
            # Either will do: a law with memory may be bent to the fitted trials, and what vanished is open to anything.
            held = max(reference.fit.state.cost - there.fit.state.cost, reference.moved - there.moved)
        if held is None or held >= settings.gain:
            near = [c for c in near if c is not winner and c not in rivals]
            return replace(winner, gain=held), rivals, refused + [explains_less(c, winner) for c in near]
        why = f"held-out trials do not improve ({held:+.3g} in log-likelihood)"
        refused.append(Refused(winner.candidate, why))
        out.add(winner.candidate.name)
    return None, [], refused


def in_place(
    bench: Bench, names: Sequence[str], own: Contender, others: Sequence[Tested], settings: Settings
) -> tuple[Contender, list[Contender]]:
    """An effect of a model, or the candidate that explains more in its place, and the rivals of which the evidence is
    about as good; ``names`` are the parameters that are estimated beside it."""
    found = _lowest(bench, [own, *_imitations(bench, names, [(own, t) for t in others])])
    near = _checked(bench, [c for c in found if c.fit.cost < found[0].fit.cost + settings.told_apart])
    return _preferred([c for c in near if c.surprise is not None] or near, settings)


def _preferred(near: Sequence[Contender], settings: Settings) -> tuple[Contender, list[Contender]]:
    """The contender of the best evidence, the most usual of those that tie, and those that are not told from it."""
    best = min(c.cost for c in near)
    level = [c for c in near if c.cost < best + settings.tied]
    winner = min(level, key=lambda c: (c.candidate.usual, min(c.fit.values[n] for n in c.tested.step) < 0))
    return winner, [c for c in near if c is not winner and c.cost < best + settings.told_apart]


def explains_less(c: Contender, winner: Contender) -> Refused:
    """A contender that is not kept, since another one is."""
    return Refused(c.candidate, f"explains less than {winner.candidate.name}")


def _checked(bench: Bench, near: Sequence[Contender]) -> list[Contender]:
    made = in_parallel(lambda k: surprise(bench, near[k].fit), [1.0] * len(near), "held-out trials judged")
    return [replace(c, surprise=s) for c, s in zip(near, made, strict=True)]


def _as_near(
    bench: Bench,
    names: Sequence[str],
    found: Sequence[Contender],
    classes: Sequence[Mapping[str, Tested]],
    settings: Settings,
) -> list[Contender]:
    """Contenders, and what the score tests do not tell from those about as good as the best, the best first.

    None is judged by a minimum that another was spared: what the tests do not tell from one about as good as the best,
    but is fitted worse, is fitted from where its motion is nearest to its like's: as long as that brings a better one.
    ``names`` are the parameters that are estimated beside a candidate's.
    """
    while True:
        head, costs = found[0], {c.candidate.name: c.fit.cost for c in found}
        near = [c for c in found if c.fit.cost < head.fit.cost + settings.told_apart]
        pairs = dict[str, tuple[Contender, Tested]]()
        for members in classes:
            for like in [c for c in near if c.candidate.name in members][:1]:
                worse, like = like.fit.cost + settings.tied, replace(like, tested=members[like.candidate.name])
                pairs |= {n: (like, t) for n, t in members.items() if costs.get(n, np.inf) > worse}
        found = _lowest(bench, [*found, *_imitations(bench, names, list(pairs.values()))])
        if found[0].fit.cost > head.fit.cost - settings.tied:
            return found


def _imitations(bench: Bench, names: Sequence[str], pairs: Sequence[tuple[Contender, Tested]]) -> list[Contender]:
    """Candidates fitted from where their motion is nearest to that of a contender."""

    def refit(k: int) -> Fit | None:
        head, own = pairs[k]
        every = dict.fromkeys((*names, *own.candidate.strengths, *own.candidate.hidden))
        return bench.imitated(head.fit, tuple(every), exchanged(head, own))

    made = in_parallel(refit, [1.0] * len(pairs), "effects that look alike fitted")
    return [Contender(t, fit) for (_, t), fit in zip(pairs, made, strict=True)
            if fit is not None and not impossible(bench, t.candidate, fit.values)]  # fmt: skip


def needed(tested: Tested, settings: Settings) -> float:
    """Log-likelihood that a candidate must gain, refitted."""
    freedom = max(tested.freedom, 1)
    return float(chi2.isf(10.0**settings.log_p / TESTED, freedom)) / 2
