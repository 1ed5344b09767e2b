"""What a robot's declared model lacks, joint by joint.

1. Fit the declared model to the fitted trials (:func:`.identify.identify`).
2. Score-test every term (:func:`.rounds.score_all`): effects at each joint with every value of their hidden parameters,
   and effects on the robot as a whole. Thresholds count all of them.
3. At each joint keep the best by its log-likelihood, a parameter's price taken off, if it is significant, if it is
   worth a share of the joint's friction, and if cross-validation by stretches of time confirms it: what a term takes
   off stretches that its fit did not see. A term on the robot stands against those of all joints that it would change.
   Where nothing is, terms that a law's bristle may have been bent to are tested anew at fits with them. Where a
   Stribeck curve is as wide as the motion, it stands in for something: all are tested beside narrow ones, too.
4. Refit all parameters together with what was kept, and begin again at 2, until nothing is kept.
5. Drop what the others made superfluous.
6. Verdict of each joint: what was added, and whether what is left matters: any smooth function of one variable, for
   what no name covers.

Held-out trials take no part in any of this: they are for the errors before and after alone.

Public: :func:`diagnose`, :class:`RobotDiagnosis`.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..diagnose.verdict import FOUND, NOTHING, PARTLY, UNEXPLAINED
from ..numerics.whiteness import NORMAL_95
from .balance import Model
from .candidates import remainders
from .identify import identify, narrowed, relative_errors
from .least_squares import Solution, solve
from .motion import Prepared
from .rounds import SIMILAR, Accepted, Settings, frictions, reasons, round_at
from .score import Scorer

ROBOT = "robot"


@dataclass(frozen=True)
class Rest:
    """What is left at a joint as a function of one variable.

    Attributes:
        variables: on which it may depend, the one that explains most first.
        kind: "force", or "friction" (a share of dry friction).
        log_p: decimal logarithm of its chance, over all.
        size: see ``Settings.worth``.
        x, y: its shape, N m, over the first variable.
    """

    variables: tuple[str, ...]
    kind: str
    log_p: float
    size: float
    x: np.ndarray
    y: np.ndarray


@dataclass(frozen=True)
class RobotDiagnosis:
    """What was found.

    Attributes:
        declared, fit: the declared model's fit, and that with what was added.
        accepted: terms that were added, in their order.
        refused: term -> why.
        rest: joint -> what is left that matters.
        trifles: joint -> what is left that is significant, but too small or not confirmed.
        verdicts: joint -> verdict; ``robot``: of what acts on it as a whole.
        errors: trial -> relative torque errors (before, after), shape (2, joints).
        held_out: names of the trials that took no part.
        seconds: it took.
    """

    declared: Solution
    fit: Solution
    accepted: tuple[Accepted, ...]
    refused: Mapping[str, str]
    rest: Mapping[str, Rest]
    trifles: Mapping[str, Rest]
    verdicts: Mapping[str, str]
    errors: Mapping[str, np.ndarray]
    held_out: tuple[Prepared, ...]
    settings: Settings = field(default_factory=Settings)
    seconds: float = 0.0

    def at(self, joint: int | None) -> list[Accepted]:
        """What was added at a joint, or on the robot as a whole."""
        return [a for a in self.accepted if a.term.joint == joint]


def diagnose(
    model: Model, fitted: Sequence[Prepared], held_out: Sequence[Prepared] = (), settings: Settings | None = None
) -> RobotDiagnosis:
    """Diagnose a declared model, see the module.

    Args:
        model: declared, see :func:`.identify.declare`.
        fitted, held_out: trials.
    """
    settings, began = settings or Settings(), time.perf_counter()
    declared = identify(model, fitted)
    solution = declared
    accepted: list[Accepted] = []
    refused: dict[str, str] = {}
    for _ in range(settings.most):
        ways = [round_at(solution, (), accepted, settings, refused)]
        narrow, wide = narrowed(solution)
        there: dict[str, str] = {}
        if wide:
            ways.append(round_at(narrow, wide, accepted, settings, there))
        grown = [way for way in ways if way is not None and way[0].cost < solution.cost]
        if not grown:
            break
        best = min(grown, key=lambda way: way[0].cost + sum(a.tried.price for a in way[1]))
        refused |= there if best is not ways[0] else {}
        solution, kept = best
        accepted = [*accepted, *kept]
    solution, accepted = _needed(solution, accepted, refused, settings)
    refused = reasons(refused, accepted)
    rest, trifles = _left(solution, settings)
    verdicts = {}
    for k, joint in enumerate(model.names):
        found = any(a.term.joint == k for a in accepted)
        verdicts[joint] = (PARTLY if found else UNEXPLAINED) if joint in rest else FOUND if found else NOTHING
    verdicts[ROBOT] = FOUND if any(a.term.joint is None for a in accepted) else NOTHING
    trials = [*fitted, *held_out]
    before, after = relative_errors(declared.model, trials), relative_errors(solution.model, trials)
    errors = {trial.name: np.stack([before[trial.name], after[trial.name]]) for trial in trials}
    return RobotDiagnosis(
        declared,
        solution,
        tuple(accepted),
        refused,
        rest,
        trifles,
        verdicts,
        errors,
        tuple(held_out),
        settings,
        time.perf_counter() - began,
    )


def _needed(
    solution: Solution, accepted: list[Accepted], refused: dict[str, str], settings: Settings
) -> tuple[Solution, list[Accepted]]:
    """Without terms whose strengths may all be 0 beside the others, the least certain first."""
    while accepted:
        doubts = []
        for a in accepted:
            names = a.term.names(solution.model, hidden=False)
            sure = max(abs(solution.model.values[n]) / max(solution.errors[n], 1e-300) for n in names)
            doubts.append((sure, a))
        least, worst = min(doubts, key=lambda pair: pair[0])
        if least > NORMAL_95:
            break
        refused[worst.term.name] = "its 95 % interval holds zero beside the other effects"
        model = solution.model
        values = {**model.values, **dict.fromkeys(worst.term.names(model, hidden=False), 0.0)}
        gone = worst.term.names(model)
        free = tuple(n for n in model.free if n not in gone)
        solution = solve(replace(model, values=values, free=free), solution.trials, solution.sigmas)
        accepted = [a for a in accepted if a is not worst]
    return solution, accepted


def _left(solution: Solution, settings: Settings) -> tuple[dict[str, Rest], dict[str, Rest]]:
    """What is left at each joint as a function of one variable: what matters, and what is only significant."""
    model, trials = solution.model, solution.trials
    scorer, loads, level = Scorer(solution), [model.loads(t) for t in trials], frictions(solution)
    matters: dict[str, Rest] = {}
    trifles: dict[str, Rest] = {}
    for k, joint in enumerate(model.names):
        found = []
        for variable, kind, columns, samples, shape in remainders(model, k, trials, loads):
            scored = scorer.test(columns, (k,), columns[0].shape[1])[1]
            found.append((scored, variable, kind, columns, samples, shape))
        tests = len(found) * len(model.names)
        found.sort(key=lambda f: -f[0].gain)
        significant = [f for f in found if f[0].log_p + np.log10(tests) < settings.log_p]
        if not significant:
            continue
        scored, variable, kind, columns, samples, shape = significant[0]
        low, high = np.quantile(np.concatenate(samples), [0.01, 0.99])
        x = np.linspace(low, high, 60)
        size = float(scored.size[k] / level[k])
        names = tuple(dict.fromkeys(f[1] for f in significant if f[0].gain > SIMILAR * scored.gain))
        rest = Rest(names, kind, scored.log_p + float(np.log10(tests)), size, x, shape(x) @ scored.step)
        confirmed = any(c.gain > c.error for c in (scorer.confirmed(f[3], (k,)) for f in significant[:3]))
        (matters if confirmed and size >= settings.worth else trifles)[joint] = rest
    return matters, trifles
