"""A start that needs no luck: short windows, a coarse design, a finer grid where minima are many.

Simulated over whole trials, the likelihood has many local minima: a slip that comes too late or not at all shifts all
that follows. Over windows that each hold one stretch of low speed and start in steady sliding or at rest, errors do
not add up. There the stiffness and damping of the bristles come out right from nearly any start, and what is left is
the ridge along which static friction and Stribeck velocity move together: a grid along it finds its lowest point.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.stats import qmc

from ..numerics.descent import GIVEN, Evaluate, Solution, State, levenberg_marquardt
from ..numerics.parallel import in_parallel
from ..numerics.paths import InputPath
from ..physics.base import beside, contact_of, plain_name
from ..physics.beforehand import DAMPING_RATIO, STATIC_RATIO
from ..physics.scan import DECADES
from .problem import Problem
from .space import Space
from .trial import TrialModel

MOST_WINDOWS = 80  # that the search simulates: enough for a start, however long the recording
DESIGNED = ("sigma_0", "sigma_1", "mu_s", "v_s")  # what the sliding samples do not tell
DESIGN_POINTS = {0: 1, 1: 32, 2: 32, 3: 64, 4: 64}  # points of the coarse design by number of such parameters
MOST_POINTS = 128  # points where there are more
FEW = 0.1  # of all the friction: dry friction below is tried as all of it too
WEAKER = 0.01  # of what it is alone: where one kind of friction starts beside another that is tried as all of it
FLAT_RATIO = 1.01  # the same where friction hardly rises towards rest
RIDGE = (6, 8)  # grid over mu_s / mu_c and v_s
ROUGH: dict[str, Any] = {"rtol": 1e-4, "atol": 1e-5}  # over windows: errors of 1e-5 m/s are far below any noise
SLOPPY = {"rtol": 1e-3, "atol": 1e-4}  # for ranking
BEGUN, BEHIND = 6, 60.0  # iterations before refinements are compared; in log-likelihood: given up
AT_ONCE = 2  # points completed at once: not the number of cores, on which no result may depend
FIRST = 4  # one window in so many is simulated first: most points of a grid are out after these

Evaluator = Callable[[Sequence[int]], Evaluate]  # indices of windows -> their cost


def windows_of(problem: Problem) -> tuple[TrialModel, ...]:
    """The trials cut at peaks of the slip velocity, inputs known, each starting in steady sliding or at rest.

    A bristle that starts in sliding carries the friction force mu_c F_N, if there is such a start value. It forgets it
    within the first sample, which is left to the window before, and derivatives of a steady start are not needed.
    """
    values, result = problem.fixed | problem.start, []
    for motion in problem.motions:
        model, free = motion.model, motion.model.simulator.mechanism.free
        path = model.path(model.local)
        for k, (i, j) in enumerate(pairwise(motion.edges)):
            start, moving = {}, bool(motion.fast[i])
            for c in free:
                start[c.signals[0]] = float(motion.signals[c.signals[0]][i])
                start[c.signals[1]] = float(motion.signals[c.signals[1]][i]) if moving else 0.0
            if not k and not moving:  # a trial may begin while it slides slowly
                start |= {c.signals[1]: model.start[c.signals[1]] for c in free}
                moving = any(start[c.signals[1]] != 0 for c in free)
            states = tuple(start) if moving else tuple(c.signals[0] for c in free)
            # A position that was not measured stays where it is said to be.
            states = tuple(n for n in states if n in model.outputs or n not in {c.signals[0] for c in free})
            part = slice(i, j + 1)
            y = model.y[:, part].copy()
            for z, stiffness in model.bristles if motion.fast[i] else ():
                at, mu_c = motion.at(contact_of(z)), values.get(beside(z, "mu_c"))
                if mu_c and stiffness in model.simulator.parameter_names:
                    start[z] = mu_c * float(at.normal[i] * np.sign(at.v_slip[i]))
                    y[:, 0] = np.nan
            base = InputPath(path.names, model.t[part], path.coefficients[i:j], path.session)
            known = replace(model, base=base, inputs=(), directions=None)
            name = f"{model.trial}[{k}]"
            result.append(replace(known, trial=name, t=model.t[part], y=y, states=states, start=start))
    if len(result) > MOST_WINDOWS:
        chosen = np.random.default_rng(0).choice(len(result), MOST_WINDOWS, replace=False)
        result = [result[k] for k in sorted(chosen)]
    return tuple(result)


def find_start(problem: Problem, given: Mapping[str, float] | None = None) -> list[Solution]:
    """Fits over short windows to start whole trials from, best first.

    A design over what the sliding samples do not tell, the best refined; then a grid along the ridge from there.

    Args:
        problem: what is estimated.
        given: parameter values, SI units, that are a start as they are and refined: the inputs' noise may lead the
            refinement astray.
    """
    windows, space = windows_of(problem), problem.space
    locals_ = [model.local for model in windows]

    def evaluator(which: Sequence[int]) -> Evaluate:
        return problem.evaluator([windows[k] for k in which], joint=False, width=problem.resolutions[0], **ROUGH)

    own: list[Solution] = []
    if given is not None:
        u = space.to_search(problem.start | dict(given))
        own = search(evaluator, space, locals_, [u], 1, iterations=20, decrease=0.3)
        there = evaluator(range(len(windows)))(u, locals_, False)
        if there is not None:
            own.append(Solution(there, GIVEN))
    found = search(evaluator, space, locals_, coarse_design(problem), 2, iterations=6, decrease=2.0)
    if found and (pairs := ridges(space)):
        best = found[0].state
        grid = [u for pair in pairs for u in ridge_grid(space, best.u, problem.fixed, pair)]
        found += search(evaluator, space, best.locals, grid, 2, iterations=15, decrease=0.3)
    return sorted([*own, *found], key=lambda solution: solution.state.cost)


def coarse_design(problem: Problem) -> list[np.ndarray]:
    """Search vectors, spread evenly (Sobol) over what the sliding samples do not tell: friction near rest, and hidden
    parameters of effects, which tell little from afar either.
    """
    space, start, fixed = problem.space, problem.start, problem.fixed
    masses, alone = problem.scales.masses, problem.scales.alone
    designed = [full for name in DESIGNED for full in space.names if plain_name(full) == name]
    dims = [*designed, *(name for name in problem.shapes if name in space.names)]
    points = qmc.Sobol(max(len(dims), 1), seed=0).random(DESIGN_POINTS.get(len(dims), MOST_POINTS))
    bounds, signed = space.bounds, [name for name, scale in zip(space.names, space.scales, strict=True) if scale]
    dry, result = {name: value for name, value in alone.items() if plain_name(name) == "mu_c"}, []
    for k, point in enumerate(points):
        p = dict(start)
        for name, whole in dry.items():
            if k % 2 and start.get(name, np.inf) < FEW * whole:  # what looks viscous may be dry friction with drag
                p[name] = whole
        for name, x in zip(dims, point, strict=False):
            own = plain_name(name)
            if own == "sigma_1" and (mass := masses.get(contact_of(name))):
                sigma_0 = beside(name, "sigma_0")
                stiffness = p.get(sigma_0, fixed.get(sigma_0, 1.0))
                p[name] = 2 * _between(*DAMPING_RATIO, x) * np.sqrt(stiffness * mass)
            elif own == "mu_s":
                mu_c = beside(name, "mu_c")
                p[name] = p.get(mu_c, fixed.get(mu_c, 1.0)) * _between(*STATIC_RATIO, x)
            elif name in signed:
                p[name] = bounds[name][0] + x * (bounds[name][1] - bounds[name][0])
            else:
                low, high = bounds[name]
                if own == "sigma_0" and name not in problem.bounded:  # a softer one is found by the descent
                    low = max(low, start[name] / 10**DECADES)
                p[name] = _between(low, high, x)
        result.append(p)
    if not dims:  # what one kind of friction does not explain may be another's
        kinds = [name for name in alone if name in space.names]
        for name in kinds:
            result.append(start | {other: WEAKER * start[other] for other in kinds} | {name: alone[name]})
    return [space.to_search(p) for p in result]


def ridges(space: Space) -> list[tuple[str, str]]:
    """Names of mu_s and v_s of every contact where both are free."""
    pairs = [(name, beside(name, "v_s")) for name in space.names if plain_name(name) == "mu_s"]
    return [pair for pair in pairs if pair[1] in space.names]


def ridge_grid(
    space: Space, u: np.ndarray, fixed: Mapping[str, float], pair: tuple[str, str] = ("mu_s", "v_s")
) -> list[np.ndarray]:
    """Search vectors that differ from u in mu_s / mu_c and v_s, which a contact calls by the names of the ``pair``."""
    mu_s, v_s = pair
    p, dry = space.named(u), beside(mu_s, "mu_c")
    mu_c, speeds = p.get(dry, fixed.get(dry)), np.geomspace(*space.bounds[v_s], RIDGE[1])
    pairs = [(ratio, speed) for ratio in np.geomspace(*STATIC_RATIO, RIDGE[0]) for speed in speeds]
    pairs.append((FLAT_RATIO, p[v_s]))  # no rise towards rest: a law that has too much
    return [space.to_search(p | {mu_s: ratio * mu_c, v_s: speed}) for ratio, speed in pairs]


def search(
    evaluator: Evaluator,
    space: Space,
    locals_: Sequence[np.ndarray],
    us: Sequence[np.ndarray],
    best: int,
    iterations: int,
    decrease: float,
) -> list[Solution]:
    """Rank search vectors by a cheap simulation and refine the best few; lowest cost first.

    Every refinement starts with the local unknowns ``locals_`` and has so many ``iterations``, but those that are far
    behind the best after a few no more.
    """
    evaluate = evaluator(range(len(locals_)))
    us = lowest(evaluator, locals_, us, best)

    def refined(first: State, count: int) -> Solution:
        return levenberg_marquardt(evaluate, first, space.limits, iterations=count, decrease=decrease)

    def begun(k: int) -> Solution | None:
        first = evaluate(us[k], locals_, True)
        return None if first is None else refined(first, min(iterations, BEGUN))

    begun_ = in_parallel(begun, [1.0] * len(us), "starts begun")
    found = [solution for solution in begun_ if solution is not None]
    least = min((solution.state.cost for solution in found), default=np.inf)

    def finished(k: int) -> Solution:
        if iterations <= BEGUN or found[k].reason == "converged" or found[k].state.cost > least + BEHIND:
            return found[k]
        return refined(found[k].state, iterations - BEGUN)

    ends = in_parallel(finished, [1.0] * len(found), "starts refined")
    return sorted(ends, key=lambda solution: solution.state.cost)


def lowest(
    evaluator: Evaluator, locals_: Sequence[np.ndarray], us: Sequence[np.ndarray], count: int
) -> list[np.ndarray]:
    """The ``count`` search vectors of lowest cost, lowest first.

    Some windows are simulated at every vector. The others follow in the order of that cost, until it alone, with the
    least that the others have cost so far, exceeds what was found.
    """
    if len(us) <= count:
        return list(us)
    some = range(0, len(locals_), FIRST)
    rest = sorted(set(range(len(locals_))) - set(some))

    def costs(which: Sequence[int], ks: Sequence[int]) -> list[tuple[float, int]]:
        def cost(i: int) -> float:
            state = evaluator(which)(us[ks[i]], [locals_[j] for j in which], False, **SLOPPY) if which else None
            return state.cost if state is not None else np.inf if which else 0.0

        what = "starts tried" if which is some else ""
        return list(zip(in_parallel(cost, [1.0] * len(ks), what), ks, strict=True))

    begun = sorted(item for item in costs(some, range(len(us))) if np.isfinite(item[0]))
    ranked: list[tuple[float, int]] = []
    least = np.inf
    while begun and (len(ranked) < count or begun[0][0] + least <= ranked[count - 1][0]):
        now, begun = begun[:AT_ONCE], begun[AT_ONCE:]
        others = [other for other, _ in costs(rest, [k for _, k in now])]
        least = min([least, *others])
        ranked = sorted([*ranked, *((cost + other, k) for (cost, k), other in zip(now, others, strict=True))])
    return [us[k] for cost, k in ranked[:count] if np.isfinite(cost)]


def _between(low: float, high: float, x: float) -> float:
    """The value a share x of the way from low to high, in the logarithm."""
    return float(np.exp(np.log(low) + x * np.log(high / low)))
