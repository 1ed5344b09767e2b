"""A mechanism held to the motion that was measured, and let go of step by step.

Simulated over a whole trial, errors add up: a push a little too strong moves a stop, and all that follows is another
motion. Held by a tether, a spring and a damper between the model and what was measured,

    E_i + sum_k J_ki F_k + M_ii (w^2 (q_i - q_i*) + 2 w (q_i' - q_i'*)) = 0,    w = 1 / tau,

it forgets an error after a few tau, and the likelihood is as smooth as over windows that short, without their edges. So
the minimum is followed from a tether as short as a stretch of low speed, there from the coarsest resolution in time to
the sample where nothing better is known, to none: in steps so small that no trial's motion is lost. Each tether holds
to the motion q* found under the one before, the shortest to the measured one: a model's errors show little by little.

Source: Abarbanel, Creveling, Farsian, Kostuk, Dynamical state and parameter estimation, SIAM J. Appl. Dyn. Syst. 8
(2009), who let a coupling to the data fade.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import pairwise

import numpy as np
import sympy as sp
from scipy.stats import f

from ..numerics.descent import CLOSELY, GIVEN, KNOWN, NEAR, ROUGHLY, UNFINISHED, Solution, levenberg_marquardt
from ..numerics.parallel import in_parallel
from ..numerics.paths import InputPath, cubic
from ..numerics.quadratic import SAME_MINIMUM, Evaluate, Known, State, same_minimum
from ..numerics.simulate import ContactLost, SimulationFailed, Simulator
from ..numerics.whiteness import SIGNIFICANCE
from ..physics.base import Parameter
from ..physics.mechanism import Mechanism
from ..physics.system import Coordinate
from .problem import Problem
from .trial import TrialModel

# Log-likelihood at the sample, in units of what residuals are worth there (:attr:`State.unit`): another search that is
# as near is followed to the next tether as well; 400 to 1.
AS_NEAR = 6.0
RATE = Parameter("tether", "1/s", "how fast the motion returns to the measured one", value=0.0)
FADING = 2.0  # times longer is each tether than the one before
LONGEST = 3.0  # times the longest trial: a tether that holds hardly anything
LOST = 1.5  # times the cost of a trial: let go of at once, its motion is another one
HALVED = 4  # times at most is a step from one tether to the next halved, a budget
SLOPPY = {"rtol": 1e-3, "atol": 1e-4}  # errors of a step in ranking starts: far below what these differ by

Stage = tuple[float, float]  # tether, 1/s, and resolution in time, s
Begun = tuple[State, tuple[TrialModel, ...]]  # where a search begins, and the models of the trials there
Found = tuple[Solution, tuple[TrialModel, ...]]  # where it ended
Led = tuple[Solution, tuple[TrialModel, ...], Problem | None]  # and what holds the motion of the search from there on
Seen = dict[Stage, list[Known]]  # minima of the stages that searches have been in


@dataclass(frozen=True, repr=False)
class Held(Mechanism):
    """A mechanism with a tether at every free coordinate.

    Attributes:
        placed: signals of positions that were measured: other coordinates are held by their velocity alone.
    """

    placed: frozenset[str] = frozenset()

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Those of the mechanism, and the tether's."""
        return (*Mechanism(self.system, self.law, self.effects).parameters, RATE)

    @property
    def inputs(self) -> tuple[sp.Symbol, ...]:
        """Symbols of the mechanism's inputs, then measured position and velocity of every free coordinate."""
        return (*super().inputs, *(symbol for c in self.free for symbol in measured(c)))

    @property
    def input_signals(self) -> tuple[str, ...]:
        """Names of the signals that fill them."""
        return (*super().input_signals, *(symbol.name for c in self.free for symbol in measured(c)))

    @cached_property
    def residuals(self) -> tuple[sp.Expr, ...]:
        """The mechanism's rows, the tether's force in those of the free coordinates."""
        rows, w = list(Mechanism(self.system, self.law, self.effects).residuals), RATE.symbol
        for k, c in enumerate(self.free):
            (q, v, a), (place, speed) = c.symbols, measured(c)
            back = w**2 * (q - place) if c.signals[0] in self.placed else 0
            rows[k] = rows[k] + sp.diff(rows[k], a) * (back + 2 * w * (v - speed))
        return tuple(rows)


def measured(c: Coordinate) -> tuple[sp.Symbol, sp.Symbol]:
    """Symbols of a coordinate's measured position and velocity."""
    place, speed = sp.symbols(f"{c.name}_measured {c.name}_dot_measured", real=True)
    return place, speed


@dataclass(frozen=True)
class Path:
    """The costs that a search follows: the motion held closely, from a coarse start compared at finer and finer
    resolutions in time, then let go of step by step.

    A breakaway that comes a swing of what rings too late has a minimum of its own: at the coarsest resolution there is
    none, and a tether keeps the next one from finding another.

    Attributes:
        problem: what is solved.
        held: :func:`tethered`, or None where nothing holds the motion.
        sigmas: noise standard deviations by signal, SI units.
        coarse: whether it begins at the coarsest resolution, which it must where nothing holds a simulated motion: else
            at the sample.
        given: whether the parameters are given, so that only the trials' own unknowns are estimated.
        only: the trial that is held, where it is only one, beside the others as they are in a fit.
        beside: that fit's state, and the models of the trials there.
    """

    problem: Problem
    held: Problem | None
    sigmas: Mapping[str, float]
    coarse: bool = False
    given: bool = False
    only: int | None = None
    beside: Begun | None = None

    @cached_property
    def stages(self) -> tuple[Stage, ...]:
        """Tether, 1/s, and resolution in time, s, one after another."""
        closest, *rest = [*(1 / tau for tau in tethers(self.problem) if self.held), 0.0]
        widths = self.problem.resolutions[0 if self.coarse else -1 :]
        return (*((closest, width) for width in widths), *((tether, 0.0) for tether in rest))

    def cost(self, models: Sequence[TrialModel], stage: Stage) -> Evaluate:
        """The cost of trials that begin like these models in a stage."""
        tether, width = stage
        if self.held is None or not tether:
            return self.problem.evaluator(models, sigmas=self.sigmas, width=width)
        widths = [width if self.only in (None, k) else 0.0 for k in range(len(models))]
        at = held_by(self.held, 1 / tether, models, self.only)
        return at.evaluator(at.trials, self.sigmas, width=widths)

    def begun(self, u: np.ndarray) -> Begun | None:
        """Trials that are held as they were measured, see :func:`begun_at`, others as they are."""
        if self.beside is None or self.only is None:
            return begun_at(self.problem, u)
        state, models = self.beside
        own, locals_ = models[self.only], list(state.locals)
        locals_[self.only] = own.local[: own.size(self.problem.joint)]
        return State(u, tuple(locals_), ()), models


def lowest(path: Path, us: Sequence[np.ndarray], count: int) -> list[np.ndarray]:
    """The ``count`` search vectors with which a path begins lowest: whole trials that begin as measured."""
    if len(us) <= count:
        return list(us)

    def cost(k: int) -> float:
        if (begun := begun_at(path.problem, us[k])) is None:
            return np.inf
        state, models = begun
        found = path.cost(models, path.stages[0])(state.u, state.locals, False, **SLOPPY)
        return np.inf if found is None else found.cost

    costs = in_parallel(cost, [1.0] * len(us), "starts tried")
    return [us[k] for k in np.argsort(costs, kind="stable")[:count] if np.isfinite(costs[k])]


def followed(path: Path, us: Sequence[np.ndarray], stages: Sequence[Stage], seen: Seen) -> list[Found]:
    """Fits of the whole trials, best first: all starts down to the sample, since the lowest at a coarse resolution is
    often another one, and from one tether to the next the best of these. Another stays beside it as long as it is about
    as good but elsewhere. What comes to a minimum that was ``seen`` by a search at these noise levels would go its way,
    and is left; those that are followed are added.

    Empty where all are left, or where the best comes to no end at the sample, however closely it is held: that is too
    rugged to begin with. (An imposed motion is not: it takes long where a body rests.)
    """
    last = path.stages[-1]
    begun = [pair for u in us if (pair := path.begun(u)) is not None]
    ends = [(Solution(state, GIVEN), models, path.held) for state, models in begun]

    def step(before: Stage, stage: Stage, end: Led, halved: int = 0) -> Led | None:
        """The next minimum; over tethers between, where let go of at once the motion of a trial would be lost."""
        at, models, held = end
        evaluate = replace(path, held=held).cost(models, stage)
        first = evaluate(at.state.u, at.state.locals, True)
        if before[0] != stage[0] and halved < HALVED and (first is None or _lost(at.state, first)):
            between = (before[0] + stage[0]) / 2, stage[1]
            half = step(before, between, end, halved + 1)
            return None if half is None else step(between, stage, half, halved + 1)
        if first is None:
            return None
        how = (CLOSELY if stage == last else ROUGHLY) | {"damping": 0.0 if at.reason == GIVEN else NEAR}
        limits = (first.u, first.u) if path.given else path.problem.space.limits
        found = levenberg_marquardt(evaluate, first, limits, known=seen.get(stage, ()), **how)
        if path.beside and found.state.cost > path.beside[0].cost:
            return None
        if held is not None and stage[0] and not stage[1]:
            held = led(path, held_by(held, 1 / stage[0], models, path.only), found.state)
        return found, models, held

    def searched(ends: Sequence[Led], before: Stage, stage: Stage, k: int) -> Led | None:
        return step(before, stage, ends[k])

    for before, stage in pairwise((stages[0], *stages)):
        found = in_parallel(partial(searched, ends, before, stage), [1.0] * len(ends), "whole trials")
        lower = sorted(filter(None, found), key=lambda end: end[0].state.cost)
        if not lower:
            ends = [end for end in ends if end[0].reason != GIVEN and path.beside is None]
            continue
        if path.held and not path.coarse and stage == stages[0] and lower[0][0].reason == UNFINISHED:
            return []
        best, ends = lower[0][0].state, []
        for end in lower:
            near = stage[1] > 0 or end[0].state.cost <= best.cost + AS_NEAR * best.unit
            apart = near and not any(same_minimum(other.state, end[0].state) for other, *_ in ends)
            if end[0].reason != KNOWN and (apart or stage == last):
                ends.append(end)
        if not ends:
            return []
        seen.setdefault(stage, []).extend(Known.of(end.state) for end, *_ in ends)
    return [(found, models) for found, models, _ in ends]


def regained(problem: Problem, held: Problem, sigmas: Mapping[str, float], begun: Begun) -> Solution | None:
    """The lower minimum in which no trial lags behind the others, see :func:`lagging`; None where there is none.

    Such a trial is held to the motion that was measured and let go of anew, compared at the coarsest resolution first:
    hardly any weight is left to it, and the parameters go where the others tell. With them it comes back; where all fit
    worse than before, it is left.
    """
    found: Solution | None = None
    state, models = begun
    while (only := lagging(state)) is not None:
        path = Path(problem, held, sigmas, coarse=True, only=only, beside=(state, models))
        ends = followed(path, [state.u], path.stages, {})
        if not ends or ends[0][0].state.cost > state.cost - SAME_MINIMUM:
            break
        found = ends[0][0]
        state = found.state
    return found


def lagging(state: State) -> int | None:
    """The trial that fits worst, where noise alone would hardly leave so much more in it than in the others (F-test of
    mean squares): noise is the same in all, so that its minimum is not the model's. None where no trial lags."""
    count, squares = np.array([piece.rows[:2] for piece in state.pieces]).T
    k = int(np.argmax(squares / np.maximum(count, 1.0)))
    rest, left = count.sum() - count[k], squares.sum() - squares[k]
    if min(count[k], rest, left) <= 0:
        return None
    ratio = squares[k] / count[k] / (left / rest)
    return k if len(count) * float(f.sf(ratio, count[k], rest)) < SIGNIFICANCE else None


def _lost(held: State, free: State) -> bool:
    """Whether a trial's motion became another one."""
    return any(new.cost > LOST * old.cost for old, new in zip(held.pieces, free.pieces, strict=True))


def begun_at(problem: Problem, u: np.ndarray) -> Begun | None:
    """The whole trials at a search vector as they were measured, and their models; None where they cannot be."""
    try:
        models = problem.models_at(u)
    except (ContactLost, SimulationFailed):
        return None
    return State(u, tuple(model.local[: model.size(problem.joint)] for model in models), ()), models


def tethered(problem: Problem) -> Problem | None:
    """The problem with its motion held, not at all yet; None where no velocity or position shows it."""
    mechanism, shown = problem.mechanism, set(problem.channels.outputs)
    if not mechanism.free or not all(shown & set(c.signals[:2]) for c in mechanism.free):
        return None
    placed = frozenset(shown & {c.signals[0] for c in mechanism.free})
    kind = type(problem.simulator)  # one that passes over parameters of effects that are left out stays so
    simulator = kind(Held(mechanism.system, mechanism.law, mechanism.effects, placed))
    pairs = zip(problem.motions, problem.trials, strict=True)
    trials = [_along(motion.signals, model, simulator) for motion, model in pairs]
    return problem.varied(simulator=simulator, trials=trials, values={RATE.name: 0.0}, counted=True)


def held_by(held: Problem, tau: float, models: Sequence[TrialModel], only: int | None = None) -> Problem:
    """The tethered problem with trials that begin like these models, the tether tau long, s, in all or in ``only`` one
    of them."""
    trials = [replace(own, start=model.start, force_scales=model.force_scales,
                      own={RATE.name: 1 / tau} if only in (None, k) else {})
              for k, (own, model) in enumerate(zip(held.trials, models, strict=True))]  # fmt: skip
    return held.varied(trials=trials, counted=True)


def led(path: Path, held: Problem, state: State) -> Problem:
    """The problem held to the motion that was found under this tether, where there is one."""
    p = held.values(state.u)

    def along(k: int) -> TrialModel:
        model = held.trials[k]
        if not model.own:
            return model
        run = model.simulate({**p, **model.own}, state.locals[k])
        return _along(run.signals, path.problem.trials[k], held.simulator)

    trials = in_parallel(along, [len(model.t) for model in held.trials])
    return held.varied(trials=trials, counted=True)


def tethers(problem: Problem) -> list[float]:
    """Lengths tau of the tethers in time, s, the shortest first."""
    longest = LONGEST * max(float(model.t[-1] - model.t[0]) for model in problem.trials)
    shortest = problem.resolutions[0]
    return [shortest * FADING**k for k in range(1 + int(np.log(longest / shortest) / np.log(FADING)))]


def _along(motion: Mapping[str, np.ndarray], model: TrialModel, simulator: Simulator) -> TrialModel:
    """The trial's model with the motion that it is held to, samples by signal, beside its inputs."""
    names = [name for c in simulator.mechanism.free for name in c.signals[:2]]
    paths = np.stack([cubic(model.t, motion[name]) for name in names], axis=1)
    coefficients = np.concatenate([model.base.coefficients, paths], axis=1)
    base = InputPath(simulator.mechanism.input_signals, model.t, coefficients, model.base.session)
    return replace(model, simulator=simulator, base=base, directions=None)
