"""Where searches begin that may find more than the one from the default start.

Stiffness and damping of the bristles come out right from nearly any start; a design over what the sliding samples do
not tell, and a grid along the ridge of static friction and Stribeck velocity, have a point near its lowest.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.stats import qmc

from ..physics.base import beside, contact_of, plain_name
from ..physics.beforehand import DAMPING_RATIO, STATIC_RATIO
from ..physics.scan import DECADES
from .problem import Problem
from .space import Space

DESIGNED = ("sigma_0", "sigma_1", "mu_s", "v_s")  # what the sliding samples do not tell
POINTS = (1, 32, 32, 64, 64, 128)  # of the coarse design by number of such parameters; as many where there are more
FEW = 0.1  # of all the friction: dry friction below is tried as all of it, too, beside drag that looks viscous
WEAKER = 0.01  # of what it is alone: where one kind of friction starts beside another that is tried as all of it
FLAT_RATIO = 1.01  # the same where friction hardly rises towards rest
RIDGE = (6, 8)  # grid over mu_s / mu_c and v_s


def coarse_design(problem: Problem) -> list[np.ndarray]:
    """Search vectors, spread evenly (Sobol) over what the sliding samples do not tell: friction near rest, and hidden
    parameters of effects, which tell little from afar either."""
    space, start, fixed, alone = problem.space, problem.start, problem.fixed, problem.scales.alone
    designed = [full for name in DESIGNED for full in space.names if plain_name(full) == name]
    dims = [*designed, *problem.shapes]
    points = qmc.Sobol(max(len(dims), 1), seed=0).random(POINTS[min(len(dims), len(POINTS) - 1)])
    bounds, signed = space.bounds, [name for name, scale in zip(space.names, space.scales, strict=True) if scale]
    dry, result = {name: value for name, value in alone.items() if plain_name(name) == "mu_c"}, []
    for k, point in enumerate(points):
        p = start | {name: whole for name, whole in dry.items() if k % 2 and start.get(name, np.inf) < FEW * whole}
        for name, x in zip(dims, point, strict=False):
            own = plain_name(name)
            if own == "sigma_1" and (mass := problem.scales.masses.get(contact_of(name))):
                stiffness = (fixed | p).get(beside(name, "sigma_0"), 1.0)
                p[name] = 2 * _between(*DAMPING_RATIO, x) * np.sqrt(stiffness * mass)
            elif own == "mu_s":
                p[name] = (fixed | p).get(beside(name, "mu_c"), 1.0) * _between(*STATIC_RATIO, x)
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
        weaker = start | {name: WEAKER * start[name] for name in kinds}
        result += [weaker | {name: alone[name]} for name in kinds]
    return [space.to_search(p) for p in result]


def ridge_grid(space: Space, u: np.ndarray, fixed: Mapping[str, float]) -> list[np.ndarray]:
    """Search vectors that differ from u in mu_s / mu_c and v_s of a contact, for every one where both are free."""
    p, made = space.named(u), []
    for mu_s in (name for name in p if plain_name(name) == "mu_s" and beside(name, "v_s") in p):
        v_s, mu_c = beside(mu_s, "v_s"), {**fixed, **p}[beside(mu_s, "mu_c")]
        speeds = np.geomspace(*space.bounds[v_s], RIDGE[1])
        pairs = [(ratio, speed) for ratio in np.geomspace(*STATIC_RATIO, RIDGE[0]) for speed in speeds]
        pairs.append((FLAT_RATIO, p[v_s]))  # no rise towards rest: a law that has too much
        made += [space.to_search(p | {mu_s: ratio * mu_c, v_s: speed}) for ratio, speed in pairs]
    return made


def _between(low: float, high: float, x: float) -> float:
    """The value a share x of the way from low to high, in the logarithm."""
    return float(np.exp(np.log(low) + x * np.log(high / low)))
