"""The one place where an effect is refused for its value: what the data do not tell from zero, or no mechanism has."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import sympy as sp

from .bench import Bench
from .candidates import Candidate
from .observe import samples, simulations

LIMIT = 0.99  # of the way to a limit: at it
POWER = 0.95  # of the slip velocity's power lies below the frequency of the fastest motion


def impossible(
    bench: Bench,
    candidate: Candidate,
    values: Mapping[str, float],
    ci95: Mapping[str, tuple[float, float]] | None = None,
) -> str:
    """Why an effect cannot be what is missing, by what a refit made of it; empty where it can.

    * the 95 % interval holds zero (of several strengths all do), has no width (numerically degenerate), or is unknown;
    * a share or a mass at the lower limit where nothing is left: a mass, a sensor's scale, friction of one direction;
    * an inertia that makes the moving mass negative;
    * a delay longer than a period of the fastest motion: another cycle would do as well;
    * a wavelength above the stroke: no period was seen.

    Args:
        values: all parameters of the refit, SI units.
        ci95: 95 % intervals of the strengths; None: not known yet.
    """
    table = {par.name: par for par in bench.tested.parameters}
    for name in (*candidate.strengths, *candidate.hidden):
        value, low = values[name], table[name].low
        if not np.isfinite(value):
            return f"{name} is no number"
        if np.isfinite(low) and low < 0 and value <= LIMIT * low:
            return f"{name} at its limit, {low:.3g} {table[name].unit}, where nothing is left of what it changes"
        if name.endswith("wavelength") and value > (stroke := bench.sizes.scales["stroke"][1]):
            return f"{name} of {value:.3g} above the stroke of {stroke:.3g}: no period was seen"
    late = {name: values[name] for name in candidate.strengths if name in _delays(bench, candidate)}
    if late and max(map(abs, late.values())) > (period := fastest_period(bench)):
        name = max(late, key=lambda n: abs(late[n]))
        return f"{name} of {late[name]:.3g} s, longer than a period of the fastest motion, {period:.3g} s"
    if candidate.effect == "inertia" and values["inertia"] < 0 and values["inertia"] <= -moving_mass(bench):
        return f"inertia of {values['inertia']:.3g} makes the moving mass negative"
    return "" if ci95 is None else _untold([ci95[name] for name in candidate.strengths])


def _untold(intervals: list[tuple[float, float]]) -> str:
    if any(not np.isfinite(end) for ci in intervals for end in ci):
        return "these data do not tell how large it is"
    if any(low == high for low, high in intervals):
        return "its 95 % interval has no width: numerically degenerate"
    if all(low <= 0 <= high for low, high in intervals):
        told = "; ".join(f"{low:.3g} to {high:.3g}" for low, high in intervals)
        return f"its 95 % interval holds zero ({told})"
    return ""


def _delays(bench: Bench, candidate: Candidate) -> set[str]:
    effect = next(e for e in bench.tested.effects if e.name == candidate.effect)
    delays = effect.delays(bench.tested.system, bench.tested.law)
    return {name for parameters in delays.values() for name in parameters}


def fastest_period(bench: Bench) -> float:
    """Period of the fastest motion, s: of each trial the frequency below which most of the slip velocity's power lies,
    the largest of all trials."""
    fastest = 0.0
    for run in simulations(bench, bench.base):
        t = np.linspace(run.t[0], run.t[-1], len(run.t))
        power = np.abs(np.fft.rfft(np.interp(t, run.t, run.v_slip))[1:]) ** 2
        if power.sum() > 0:
            k = int(np.searchsorted(np.cumsum(power), POWER * power.sum()))
            fastest = max(fastest, (k + 1) / float(t[-1] - t[0]))
    return 1 / fastest if fastest > 0 else np.inf


def moving_mass(bench: Bench) -> float:
    """Least force per slip acceleration along the motion; infinite where the equation of motion has none."""
    system = bench.mechanism.system
    slipping = [c for c in system.free if system.jacobian[c.name] != 0]
    if system.massless or len(slipping) != 1:
        return np.inf
    (c,) = slipping
    slope = -sp.diff(system.friction_implied, c.symbols[2]) / system.jacobian[c.name]
    return min(float(samples(system, run, slope).min()) for run in simulations(bench, bench.base))
