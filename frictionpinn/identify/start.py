"""A start that needs no luck: regression, a coarse design, short windows, a finer grid where minima are many.

Simulated over whole trials, the likelihood has many local minima: a slip that comes too late or not at all shifts all
that follows. Over windows that each hold one stretch of low speed and start in steady sliding or at rest, errors do
not add up. There the stiffness and damping of the bristles come out right from nearly any start, and what is left is
the ridge along which static friction and Stribeck velocity move together: a grid along it finds its lowest point.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import qmc

from ..numerics.parallel import in_parallel
from ..physics.mechanism import Mechanism
from ..physics.scan import DECADES
from .motion import Motion, effective_mass, sliding_regression
from .solve import Evaluate, Solution, levenberg_marquardt
from .space import Space
from .units import Sizes, mean_load, shaped

DESIGNED = ("sigma_0", "sigma_1", "mu_s", "v_s")  # what the sliding samples do not tell
SIZES = {0: 1, 1: 32, 2: 32, 3: 64, 4: 64}  # points of the coarse design by number of such parameters
LARGEST = 128  # points where there are more
FEW = 0.1  # of all the friction: dry friction below is tried as all of it too
WEAKEST = 0.01  # of the larger of dry and viscous friction: where the smaller one starts at least
DAMPING_RATIO = (0.03, 1.0)
STATIC_RATIO = (1.05, 4.0)  # mu_s / mu_c
FLAT = 1.01  # the same where friction hardly rises towards rest
RIDGE = (6, 8)  # grid over mu_s / mu_c and v_s
SLOPPY = {"rtol": 1e-3, "atol": 1e-4}  # for ranking
BEGUN, BEHIND = 6, 60.0  # iterations before refinements are compared; in log-likelihood: given up
TOGETHER = 2  # points completed at once: not the number of cores, on which no result may depend
FIRST = 4  # one window in so many is simulated first: most points of a grid are out after these


@dataclass(frozen=True)
class Scales:
    """Start values by name, SI units; the mass that the contact feels (None where no inertia takes part); sizes.

    ``alone`` holds what mu_c or sigma_2 would be if it made all the friction.
    """

    start: dict[str, float]
    mass: float | None
    sizes: Sizes
    alone: dict[str, float]


def data_start(
    mechanism: Mechanism, motions: Sequence[Motion], fixed: Mapping[str, float], names: Sequence[str]
) -> Scales:
    """Start values of the free parameters: regression where that tells, orders of magnitude elsewhere."""
    values = {par.name: par.value for par in mechanism.parameters} | mechanism.system.values | dict(fixed)
    known = {name: 1.0 if value is None else float(value) for name, value in values.items()}
    found = sliding_regression(mechanism, motions, known, names)
    known |= found
    mass = effective_mass(mechanism, motions, known)
    v = np.concatenate([motion.v_slip for motion in motions])
    t = [np.gradient(motion.v_slip, motion.model.t) for motion in motions]
    velocity = float(np.sqrt(np.mean(v**2))) or 1.0
    acceleration = float(np.sqrt(np.mean(np.concatenate(t) ** 2))) or 1.0
    load = mean_load(motions)
    shares = {"mu_c": load, "sigma_2": velocity}
    reference = max((found[name] * unit for name, unit in shares.items() if name in found), default=0.0)
    alone = {name: reference / unit for name, unit in shares.items() if name in found}
    found |= {name: max(found[name], WEAKEST * value) for name, value in alone.items()}
    mu_c = found.get("mu_c", known.get("mu_c", 1.0))
    force = mu_c * load
    sizes = Sizes(mechanism, motions, max(force, reference))
    stiffness = fixed.get("sigma_0", force / (1e-2 * velocity**2 / acceleration))
    damping = np.sqrt(stiffness * mass) if mass else 1e-2 * stiffness * velocity / acceleration
    rough = {
        "mu_c": mu_c, "mu_s": 1.5 * mu_c, "v_s": 0.02 * velocity, "sigma_0": stiffness, "sigma_1": damping,
        "sigma_2": 0.1 * force / velocity,
    }  # fmt: skip
    own = {par.name for par in (*mechanism.system.parameters, *mechanism.law.parameters)}
    table, moved = {par.name: par for par in mechanism.parameters}, shaped(mechanism, names)
    rough |= {name: sizes.start(table[name], name in moved) for name in names if name not in own}
    return Scales({name: float(found.get(name, rough.get(name, known[name]))) for name in names}, mass, sizes, alone)


def default_bounds(
    mechanism: Mechanism, scales: Scales, given: Mapping[str, Sequence[float]]
) -> dict[str, Sequence[float]]:
    """Bounds around the start where none are given: a decade for friction coefficients and masses, else two.

    Strengths of effects keep their physical limits; what is scanned keeps to its scan.
    """
    wide, table = ("sigma_0", "sigma_1", "sigma_2", "v_s"), {par.name: par for par in mechanism.parameters}
    result: dict[str, Sequence[float]] = {}
    for name, value in scales.start.items():
        par = table[name]
        if given.get(name) is not None:
            result[name] = tuple(given[name])
        elif par.hidden and par.scan is not None:
            result[name] = scales.sizes.ends(par.scan)
        elif par.low >= 0 and par.neutral is None:
            factor, least = 10**DECADES if name in wide else 10.0, max(par.low, 1e-12)
            low = min(max(abs(value) / (100.0 if name == "mu_c" else factor), least), 0.5 * par.high)
            high = max(abs(value) * factor, 10 * low, 10 * scales.alone.get(name, 0.0))
            result[name] = (low, min(high, par.high))
    return {**dict(given), **result}


def coarse_design(
    space: Space, start: Mapping[str, float], scales: Scales, fixed: Mapping[str, float], shapes: Sequence[str] = ()
) -> list[np.ndarray]:
    """Parameter vectors, spread evenly (Sobol) over the bounds of what the sliding samples do not tell.

    ``shapes`` are hidden parameters of effects, which tell little from afar either.
    """
    dims = [name for name in (*DESIGNED, *shapes) if name in space.names]
    mass, alone = scales.mass, scales.alone
    points = qmc.Sobol(max(len(dims), 1), seed=0).random(SIZES.get(len(dims), LARGEST))
    low, high = dict(zip(space.names, space.low, strict=True)), dict(zip(space.names, space.high, strict=True))
    result = []
    dry = alone.get("mu_c", 0.0)
    for k, point in enumerate(points):
        p = dict(start)
        if k % 2 and start.get("mu_c", np.inf) < FEW * dry:  # what looks viscous may be dry friction with drag
            p["mu_c"] = dry
        for name, x in zip(dims, point, strict=False):
            if name == "sigma_1" and mass:
                stiffness = p.get("sigma_0", fixed.get("sigma_0", 1.0))
                p[name] = 2 * _between(*DAMPING_RATIO, x) * np.sqrt(stiffness * mass)
            elif name == "mu_s":
                p[name] = p.get("mu_c", fixed.get("mu_c", 1.0)) * _between(*STATIC_RATIO, x)
            elif space.scales[space.names.index(name)]:
                p[name] = low[name] + x * (high[name] - low[name])
            else:
                p[name] = _between(low[name], high[name], x)
        result.append(np.array([p[name] for name in space.names]))
    if not dims:  # what one kind of friction does not explain may be another's
        for name in alone.keys() & set(space.names):
            others = {other: start[other] * WEAKEST for other in alone if other != name and other in space.names}
            result.append(np.array([({**start, name: alone[name]} | others)[key] for key in space.names]))
    return result


def ridge_grid(space: Space, p: np.ndarray, fixed: Mapping[str, float]) -> list[np.ndarray]:
    """Vectors that differ from p in mu_s / mu_c and v_s; empty where not both are free."""
    if not {"mu_s", "v_s"} <= set(space.names):
        return []
    i, j = space.names.index("mu_s"), space.names.index("v_s")
    mu_c = p[space.names.index("mu_c")] if "mu_c" in space.names else fixed["mu_c"]
    result = []
    for ratio in np.geomspace(*STATIC_RATIO, RIDGE[0]):
        for v_s in np.geomspace(space.low[j], space.high[j], RIDGE[1]):
            result.append(p.copy())
            result[-1][i], result[-1][j] = ratio * mu_c, v_s
    result.append(p.copy())  # no rise towards rest: a law that has too much
    result[-1][i] = FLAT * mu_c
    return result


def search(
    evaluator: Callable[[Sequence[int]], Evaluate],
    space: Space,
    locals_: Sequence[np.ndarray],
    points: Sequence[np.ndarray],
    best: int,
    iterations: int,
    **options,
) -> list[Solution]:
    """Rank parameter vectors by a cheap simulation and refine the best few; lowest cost first.

    Args:
        evaluator: indices of windows -> their (u, locals, derivatives, **simulator's options) -> State or None.
        locals_: local unknowns that every vector starts with.
        points: parameter vectors, SI units.
        best: how many are refined; those that are far behind the best after a few iterations no further.
        iterations: of each at most.
        options: of the Levenberg-Marquardt search.
    """
    evaluate = evaluator(range(len(locals_)))
    us = lowest(evaluator, locals_, [space.to_search(p) for p in points], best)

    def begun(k: int) -> Solution | None:
        first = evaluate(us[k], locals_, True)
        few = min(iterations, BEGUN)
        return None if first is None else levenberg_marquardt(evaluate, first, space.limits, iterations=few, **options)

    found = [solution for solution in in_parallel(begun, [1.0] * len(us)) if solution is not None]
    if iterations > BEGUN:
        least = min((solution.state.cost for solution in found), default=np.inf)

        def finished(k: int) -> Solution:
            if found[k].reason == "converged" or found[k].state.cost > least + BEHIND:
                return found[k]
            return levenberg_marquardt(evaluate, found[k].state, space.limits, iterations=iterations - BEGUN, **options)

        found = in_parallel(finished, [1.0] * len(found))
    return sorted(found, key=lambda solution: solution.state.cost)


def lowest(
    evaluator: Callable[[Sequence[int]], Evaluate],
    locals_: Sequence[np.ndarray],
    us: Sequence[np.ndarray],
    count: int,
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

        return list(zip(in_parallel(cost, [1.0] * len(ks)), ks, strict=True))

    begun = sorted(item for item in costs(some, range(len(us))) if np.isfinite(item[0]))
    ranked: list[tuple[float, int]] = []
    least = np.inf
    while begun and (len(ranked) < count or begun[0][0] + least <= ranked[count - 1][0]):
        now, begun = begun[:TOGETHER], begun[TOGETHER:]
        others = [other for other, _ in costs(rest, [k for _, k in now])]
        least = min([least, *others])
        ranked = sorted([*ranked, *((cost + other, k) for (cost, k), other in zip(now, others, strict=True))])
    return [us[k] for cost, k in ranked[:count] if np.isfinite(cost)]


def _between(low: float, high: float, x: float) -> float:
    return float(np.exp(np.log(low) + x * np.log(high / low)))
