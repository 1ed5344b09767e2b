"""Where searches begin beside the default start, where these tell little from afar."""

from __future__ import annotations

import numpy as np
from scipy.stats import qmc

from ..physics.base import beside, contact_of, plain_name
from ..physics.beforehand import DAMPING_RATIO, STATIC_RATIO
from ..physics.scan import DECADES
from .problem import Problem

UNTOLD = ("sigma_0", "sigma_1", "mu_s", "v_s")  # what sliding samples do not tell
DESIGN_POINTS = 64  # of a design, a power of two: only so is it spread evenly


def designed(problem: Problem, contacts: bool) -> list[np.ndarray]:
    """Search vectors spread evenly (Sobol) over what shapes effects: a wavelength or a frequency has a minimum wherever
    it beats with the true one; and over what sliding samples do not tell of the ``contacts``, if they are asked for.
    None where there is neither."""
    space, start = problem.space, problem.start
    names = [*(name for name in space.names if plain_name(name) in UNTOLD and contacts), *problem.shapes]
    if not names:
        return []
    made = []
    for point in qmc.Sobol(len(names), seed=0).random(DESIGN_POINTS):
        p = dict(start)
        for name, x in zip(names, point, strict=True):
            own, (low, high) = plain_name(name), space.bounds[name]
            known = problem.fixed | p
            if own == "sigma_1" and (mass := problem.scales.masses.get(contact_of(name))):
                low, high = (2 * ratio * np.sqrt(known[beside(name, "sigma_0")] * mass) for ratio in DAMPING_RATIO)
            elif own == "mu_s":
                low, high = (ratio * known[beside(name, "mu_c")] for ratio in STATIC_RATIO)
            elif own == "sigma_0" and name not in problem.bounded:
                low = max(low, start[name] / 10**DECADES)  # a softer one is found by the descent
            signed = space.scales[space.names.index(name)] > 0
            p[name] = low + x * (high - low) if signed else low * (high / low) ** x
        made.append(space.to_search(p))
    return made
