"""Sentences on what the data do not tell, and which experiment would."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..numerics.whiteness import correlation_time
from ..physics.mechanism import Mechanism
from .result import correlation_of, sentences
from .space import Space

HINTS = {
    "v_s": "add slow starts and stops, at a few times v_s",
    "mu_s": "add slow starts from rest",
    "sigma_0": "add small reversals without sliding, sampled fast",
    "sigma_1": "add abrupt stops, sampled fast enough to show the ringing",
    "sigma_2": "add fast sliding at several speeds",
    "mu_c": "add steady sliding",
    "M": "add strong accelerations",
}
FLAT = (
    "friction does not rise towards rest in these data; take a law without that (dahl, coulomb_viscous), or record "
    "slow starts"
)
UNTOLD = 1.0  # standard error of a logarithm: a 95 % interval of a factor 50
BROAD = 0.3  # of the largest slip velocity: a larger Stribeck velocity describes no rise towards rest
MERGED = 1.05  # times the parameter that another must exceed: below, the two are one
CORRELATED = 2.0  # samples over which residuals stay correlated before the model is doubted


def untold(space: Space, u: np.ndarray, information: np.ndarray) -> np.ndarray:
    """Mask of the parameters that do not move the output, or no differently than the others, shape (n,).

    Args:
        u: search vector.
        information: Fisher information of u, shape (n, n).
    """
    T = space.jacobian(u)
    covariance = T @ invert(information) @ T.T
    value = np.where(space.scales > 0, space.scales, space.to_values(u))
    error = np.sqrt(np.maximum(covariance.diagonal(), 0.0)) / np.maximum(np.abs(value), 1e-300)
    alone = np.sqrt(np.maximum(information.diagonal(), 0.0))
    return ~((error <= UNTOLD) & (alone * UNTOLD > 1.0))


def lowest(space: Space, p: np.ndarray, name: str) -> float:
    """What an interval's lower end must exceed to tell anything: 0, or the parameter that this one must exceed."""
    lower = space.below[space.names.index(name)]
    return float(p[lower]) * MERGED if lower >= 0 else 0.0


def invert(information: np.ndarray) -> np.ndarray:
    """Inverse of a symmetric positive matrix whose entries differ by decades; infinite where singular."""
    scale = 1 / np.sqrt(np.maximum(information.diagonal(), 1e-300))
    scaled = information * scale[:, None] * scale
    values, vectors = np.linalg.eigh((scaled + scaled.T) / 2)
    values = np.maximum(values, 1e-14)
    return (vectors / values) @ vectors.T * scale[:, None] * scale


def hints_for(mechanism: Mechanism) -> dict[str, str]:
    """What to record so that a parameter shows, by its name."""
    result = dict(HINTS)
    for effect in mechanism.effects:
        experiment = effect.said().get("experiment", "").rstrip(".")
        for par in effect.parameters_on(mechanism.system, mechanism.law):
            if experiment and par.name not in result:
                result[par.name] = f"record {experiment}"
    return result


def advise(
    mechanism: Mechanism,
    space: Space,
    p: np.ndarray,
    covariance: np.ndarray,
    mask: np.ndarray,
    at: Mapping[str, float],
    limits: Mapping[str, float],
    as_measured: Sequence[str],
    fastest: float,
    memory_time: float,
    told: Mapping[str, tuple[float, float]],
    white: bool,
) -> tuple[str, ...]:
    """Sentences for the result: no sliding, parameters not told or at a bound, correlations, a model that lacks.

    ``p`` are the values, ``limits`` strengths of effects at a physical limit, ``as_measured`` inputs whose noise is
    ignored, ``fastest`` the largest slip velocity, 0 where nothing slides, ``told`` 95 % intervals, ``white`` whether
    the residuals are noise.
    """
    result, hints = [], hints_for(mechanism)
    if fastest == 0.0:
        result.append("the contact hardly slides in this recording: increase the excitation until it does")
    for name, hidden in zip(space.names, mask, strict=True):
        low, high = told.get(name, (np.nan, np.nan))
        below, hint = low <= lowest(space, p, name), hints.get(name, "vary the excitation")
        if low > lowest(space, p, name) and np.isinf(high):
            result.append(f"{name}: at least {low:.2g}, not told from above: {hint}")
        elif below and np.isfinite(high) and space.below[space.names.index(name)] >= 0:
            result.append(f"{name}: at most {high:.2g}: {FLAT}")
        elif below and np.isfinite(high):
            result.append(f"{name}: at most {high:.2g}, not told from below: {hint}")
        elif hidden or (below and np.isinf(high)):
            result.append(f"{name} does not show in these data: {hint}")
    for name, value in limits.items():
        more = ": the data show no such effect" if value == 0 else ""
        result.append(f"{name} ended at {value:g}, its physical limit{more}")
    for name, value in at.items():
        lower = space.below[space.names.index(name)]
        if lower >= 0 and value < MERGED * p[lower]:
            result.append(f"{name} ended at {space.names[lower]}: {FLAT}")
            continue
        nothing = name in ("mu_c", "sigma_2") and value < 2 * space.low[space.names.index(name)]
        either = "leave it out: this model wants none" if nothing else "hold it fixed"
        result.append(f"{name} ended at its bound, {value:.3g}: widen bounds.{name}, or {either}")
    if "v_s" in space.names and p[space.names.index("v_s")] > BROAD * fastest > 0:
        bend = "the Stribeck term bends the whole curve and stands for something else"
        result.append(f"v_s is as large as the speeds in these data: {bend}; take a law without it")
    result += sentences(space.names, np.nan_to_num(correlation_of(covariance)), hints)
    if as_measured:
        result.append(f"too rough for a smooth path, taken as measured without noise: {', '.join(as_measured)}")
    if not white or memory_time > CORRELATED:
        span = f" stay correlated over {memory_time:.0f} samples" if memory_time > CORRELATED else " are no white noise"
        result.append(
            f"residuals{span}: the model lacks something (diagnose.py says what), its inputs are filtered, or a lower "
            "minimum was not found; intervals are widened for the correlation"
        )
    return tuple(result)


def widening(residuals: Mapping[str, Sequence[np.ndarray]]) -> float:
    """Factor on the covariance for correlated residuals: their longest correlation time among the signals."""
    times = [correlation_time(rows) for rows in residuals.values()]
    longest = max(times, default=1.0)
    return longest if longest > CORRELATED else 1.0
