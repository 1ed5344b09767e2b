"""Other starts for a fit from which something vanished: no search in its logarithm brings it back."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..identify.problem import Problem
from ..identify.solve import KNOWN, Solution, invert, reduced
from ..numerics.parallel import in_parallel
from ..physics.sizes import Sizes

if TYPE_CHECKING:
    from .bench import Bench
    from .fit import Fit

LIFT = 0.2  # of the friction force: where a friction that vanished starts anew
GONE = 1e-2  # of the friction force: Coulomb or viscous friction below it has vanished
PEAK = 1.2, 2.0  # static over Coulomb friction: gone below, where it starts anew
SPEEDS, TOGETHER = 4, 2  # Stribeck velocities tried, and at once
WIDER, START = 2.5, 1.3  # step in the Stribeck velocity; static over Coulomb friction at the start there
BLUNTER = 2  # such steps from which a needle is fitted again
HELD = 12  # iterations at each: those that are likely need half of that
LIKELY = 1.92  # log-likelihood that a 95 % interval allows to lose
OPEN = 0.5  # standard error of the logarithm of static friction from which it may be a needle


def lifted(problem: Problem, sizes: Sizes, values: Mapping[str, float]) -> dict[str, float] | None:
    """Values with Coulomb and viscous friction that vanished brought back, None where neither did.

    What is missing may have pushed them out.

    Args:
        problem: of the declared model.
        sizes: how large parameters are on this data.
        values: of a fit, SI units.
    """
    force, found = sizes.base["{F}"], {}
    for name, unit in (("mu_c", sizes.scales["load"][1]), ("sigma_2", sizes.scales["speed"][1])):
        if name in problem.names and values[name] * unit < GONE * force:
            found[name] = LIFT * force / unit
    return dict(values) | found if found else None


def peaked(problem: Problem, values: Mapping[str, float]) -> list[dict[str, float]]:
    """Values with a static friction that vanished brought back, at some Stribeck velocities; none where it did not.

    Without it the Stribeck velocity shows nowhere, and with that at a bound the static friction does not.

    Args:
        problem: of the declared model: its bounds are those of the Stribeck velocity.
        values: of a fit, SI units.
    """
    space = problem.space
    if not {"mu_c", "mu_s", "v_s"} <= set(problem.names):
        return []
    at = space.names.index("v_s")
    if values["mu_s"] > PEAK[0] * values["mu_c"] and values["v_s"] > PEAK[0] * space.low[at]:
        return []
    speeds = np.geomspace(space.low[at], space.high[at], SPEEDS + 2)[1:-1]
    return [dict(values) | {"mu_s": PEAK[1] * values["mu_c"], "v_s": float(v)} for v in speeds]


def widened(bench: Bench, fit: Fit) -> Fit:
    """The fit with the widest Stribeck peak that the data allow, where they tell a needle from none but not its width.

    A needle that a motion passes within a sample makes derivatives that hold over micrometres only, and score tests
    that find nothing: of a payload of 35 g whose fit gains 50.6 in log-likelihood one promised 0.0 at 0.08 mm/s, and
    50.5 at 0.5 mm/s, as likely. A fit that leaves more than noise is no place for such fine distinctions.
    """
    if not (fit.explains and {"mu_c", "mu_s", "v_s"} <= set(fit.names)):
        return fit
    found, least = [fit], fit.state.cost
    for first in range(1, SPEEDS + 1, TOGETHER):
        peaks = _wider(bench, fit, range(first, first + TOGETHER))  # none: no width shows
        found, least = [*found, *peaks], min([least, *(f.state.cost for f in peaks)])
        if all(f.state.cost > least + LIKELY for f in peaks):  # nor is any that is wider
            break
    best = max((f for f in found if f.state.cost < least + LIKELY), key=lambda f: f.values["v_s"])
    if best is fit:
        return fit
    free = bench.refit(best, fit.names, best.values, iterations=0)
    return fit if free is None else replace(free, minima=fit.minima, searched=fit.searched, starts=fit.starts)


def _wider(bench: Bench, fit: Fit, steps: Sequence[int]) -> list[Fit]:
    """Fits with a Stribeck velocity held so many steps above the fit's, where static friction shows at it."""
    others, k = tuple(name for name in fit.names if name != "v_s"), bench.problem.space.names.index("v_s")
    speeds = [v for v in fit.values["v_s"] * WIDER ** np.array(steps) if v < bench.problem.space.high[k]]

    def held(k: int) -> Fit | None:
        start = {"v_s": float(speeds[k]), "mu_s": START * fit.values["mu_c"]}
        return bench.refit(fit, others, fit.values | start, iterations=HELD)

    made = in_parallel(held, [1.0] * len(speeds))
    return [f for f in made if f is not None and f.values["mu_s"] > PEAK[0] * f.values["mu_c"]]


def blunted(bench: Bench, fit: Fit, bent: Callable[[Fit, Fit], bool]) -> Fit:
    """The fit or, where its static friction is a needle that ``bent`` does not let have, one with a blunter peak.

    A needle may be likelier than any wider peak and still follow but the noise of a few breakaways. It stays one of the
    likelihood's minima: what it leaves open the intervals tell.
    """
    if not (fit.explains and fit.state.curved and {"mu_c", "mu_s", "v_s"} <= set(fit.names)):
        return fit
    if np.sqrt(invert(reduced(fit.state)[0]).diagonal()[fit.names.index("mu_s")]) < OPEN:
        return fit
    starts = [
        {"mu_s": ratio * fit.values["mu_c"], "v_s": fit.values["v_s"] * WIDER**step}
        for step in range(1, BLUNTER + 1) for ratio in (START, PEAK[1])
    ]  # fmt: skip
    made = in_parallel(lambda k: bench.refit(fit, fit.names, bench.clip(fit.values | starts[k])), [1.0] * len(starts))
    best = fit
    for blunter in sorted((f for f in made if f is not None), key=lambda f: f.state.cost):
        best = blunter if bent(blunter, best) else best
    if best is fit:
        return fit
    both = tuple(Solution(f.state, KNOWN) for f in (best, fit))
    return replace(best, minima=(*both, *fit.minima[1:]), searched=True)
