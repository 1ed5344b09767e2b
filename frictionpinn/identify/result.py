"""What every estimator returns."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

CONVERGED, AT_BOUND, UNIDENTIFIED, NO_EXCITATION, UNEXPLAINED, STOPPED, FAILED = (
    "converged", "at a bound", "not identified", "no excitation", "not explained", "stopped early", "failed",
)  # fmt: skip


@dataclass(frozen=True)
class Estimate:
    """Parameters with their uncertainty, from any estimator.

    Attributes:
        estimator: "maximum_likelihood", "nelder_mead", ...
        names: free parameters, in the mechanism's order.
        values: name -> estimate, SI units; NaN only where the estimation failed.
        units: name -> SI unit.
        covariance: of the estimates, SI units, shape (n, n); NaN rows where there is none.
        ci95: name -> 95 % interval of the data alone; that of a positive parameter is symmetric in its logarithm, or
            where it is told poorly that of its profile: from 0 or to infinity where the data do not bound it.
        outcome: "converged", "at a bound", "not identified", "no excitation", "not explained" (the residuals are no
            noise: the model lacks something, or a lower minimum was not found), "stopped early" or "failed".
        advice: sentences on what to do about it.
        cost: negative log-likelihood at the estimate without its constant: half the weighted sum of squares.
        n_simulations: simulations of the whole recording.
        seconds: wall-clock time.
        sigmas: signal -> noise standard deviation, SI units.
        residuals: trial -> signal -> model minus measurement, shape (n,), SI units.
        details: what only some estimators know; ``prior``: what was expected of static friction and Stribeck velocity,
            in words (the intervals are without it).
    """

    estimator: str
    names: tuple[str, ...]
    values: dict[str, float]
    units: dict[str, str]
    covariance: np.ndarray
    ci95: dict[str, tuple[float, float]]
    outcome: str
    advice: tuple[str, ...]
    cost: float
    n_simulations: int
    seconds: float
    sigmas: dict[str, float]
    residuals: dict[str, dict[str, np.ndarray]] = field(repr=False, default_factory=dict)
    details: dict[str, Any] = field(repr=False, default_factory=dict)

    @property
    def std(self) -> dict[str, float]:
        """name -> standard error, SI units."""
        return dict(zip(self.names, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))

    @property
    def correlation(self) -> np.ndarray:
        """Correlation matrix of the estimates, shape (n, n)."""
        return correlation_of(self.covariance)

    def to_dict(self) -> dict[str, Any]:
        """Everything but the residuals as plain types for JSON; NaN becomes None."""
        return {
            "estimator": self.estimator,
            "outcome": self.outcome,
            "advice": list(self.advice),
            "parameters": {
                name: {
                    "value": plain(self.values[name]),
                    "unit": self.units[name],
                    "std": plain(self.std[name]),
                    "ci95": [plain(x) for x in self.ci95[name]],
                }
                for name in self.names
            },
            "covariance": [[plain(x) for x in row] for row in self.covariance],
            "correlation": [[plain(x) for x in row] for row in self.correlation],
            "prior": dict(self.details.get("prior", {})),
            "cost": plain(self.cost),
            "n_simulations": self.n_simulations,
            "seconds": self.seconds,
            "sigmas": {name: plain(value) for name, value in self.sigmas.items()},
            "rms_residuals": {
                trial: {name: plain(float(np.sqrt(np.nanmean(r**2)))) for name, r in signals.items()}
                for trial, signals in self.residuals.items()
            },
        }

    def __str__(self) -> str:
        lines = [f"{self.estimator}: {self.outcome}, {self.n_simulations} simulations, {self.seconds:.2f} s"]
        width = max(map(len, self.names))
        for name in self.names:
            low, high = self.ci95[name]
            lines.append(f"  {name:{width}s} {self.values[name]:.6g} [{low:.4g}, {high:.4g}] {self.units[name]}")
        return "\n".join([*lines, *("  " + sentence for sentence in self.advice)])


def plain(value: float) -> float | None:
    """A float for JSON; None where it is not finite."""
    return float(value) if math.isfinite(value) else None


def correlation_of(covariance: np.ndarray) -> np.ndarray:
    """Correlation matrix of a covariance matrix, shape (n, n)."""
    deviations = np.sqrt(np.diag(covariance))
    with np.errstate(invalid="ignore", divide="ignore"):
        return covariance / np.outer(deviations, deviations)


def interval(value: float, std: float, positive: bool, z: float = 1.959964) -> tuple[float, float]:
    """95 % interval, symmetric in the logarithm of a positive parameter."""
    if not (math.isfinite(value) and math.isfinite(std)):
        return (math.nan, math.nan)
    if positive and value > 0:
        reach = math.exp(min(z * std / value, 700.0))
        return (float(value / reach), float(value * reach))
    return (float(value - z * std), float(value + z * std))


def sentences(names: tuple[str, ...], correlation: np.ndarray, hints: Mapping[str, str], limit: float = 0.95):
    """One sentence for each pair of parameters that the data hardly separate."""
    result = []
    for i, first in enumerate(names):
        for j in range(i):
            r = correlation[i, j]
            if abs(r) > limit:
                hint = hints.get(first) or hints.get(names[j]) or "vary the excitation"
                result.append(f"{names[j]} and {first} move together (correlation {r:.2f}): {hint}")
    return result
