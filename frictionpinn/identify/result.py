"""What every estimator returns, and in words what the data do not tell and which experiment would."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from ..data.inspect import no_slip
from ..numerics.descent import ENDED, Solution
from ..numerics.excess import rms
from ..physics.base import plain_name
from ..show import Shown, Table, estimated, interval, plain, readable_unit
from .problem import Problem
from .trial import TrialModel

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..evaluate.search_methods import Improvement

CONVERGED, AT_BOUND, UNIDENTIFIED, NO_EXCITATION, UNEXPLAINED, STOPPED, FAILED = (
    "converged", "at a bound", "not identified", "no excitation", "not explained", "stopped early", "failed",
)  # fmt: skip
HINTS = {
    "v_s": "add slow starts and stops, at a few times v_s",
    "mu_s": "add slow starts from rest",
    "sigma_0": "add small reversals without sliding, sampled fast",
    "sigma_1": "add abrupt stops, sampled fast enough to show the ringing",
    "sigma_2": "add fast sliding at several speeds",
    "mu_c": "add steady sliding",
    "M": "add strong accelerations",
}
VARY = "vary the excitation"  # where no experiment is known to help
FLAT = (
    "friction does not rise towards rest in these data; take a law without that (dahl, coulomb_viscous), or record "
    "slow starts"
)
BROAD = 0.3  # of the largest slip velocity: a larger Stribeck velocity describes no rise towards rest
MERGED = 1.05  # times the parameter that another must exceed: below, the two are one
CORRELATED = 2.0  # samples over which residuals stay correlated before the model is doubted
INSEPARABLE = 0.95  # correlation beyond which two parameters are hardly separated


@dataclass(frozen=True)
class Minimum(Solution):
    """Where a search for the likelihood's minimum ended, and the models of the trials there."""

    models: tuple[TrialModel, ...]


class Told(Shown):
    """Parameters by ``names`` with the ``covariance`` of what is known of them, SI units, shape (n, n)."""

    most_rows = None
    names: tuple[str, ...]
    covariance: np.ndarray

    @property
    def std(self) -> dict[str, float]:
        """name -> standard error, SI units."""
        return dict(zip(self.names, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))

    @property
    def correlation(self) -> np.ndarray:
        """Correlation matrix, shape (n, n)."""
        return correlation_of(self.covariance)


@dataclass(frozen=True, repr=False)
class Estimate(Told):
    """Parameters with their uncertainty, from any estimator.

    Attributes:
        estimator: "maximum_likelihood", "nelder_mead", ...
        names: free parameters, in the mechanism's order.
        values: name -> estimate, SI units; NaN only where the estimation failed.
        units: name -> SI unit; "N*m at a preload of 1" of a friction coefficient that stands for the friction itself.
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
        prior: name -> what was expected of static friction and Stribeck velocity, in words.
        minimum: of the likelihood; None where it failed, and of other estimators.
        path: of a search method: every improvement, the first one first.
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
    prior: dict[str, str] = field(repr=False, default_factory=dict)
    minimum: Minimum | None = field(repr=False, default=None)
    path: tuple[Improvement, ...] = field(repr=False, default=())

    def to_dict(self) -> dict[str, Any]:
        """What there is to report as plain types for JSON; NaN becomes None."""
        parameters = {}
        for name in self.names:
            ends = [plain(x) for x in self.ci95[name]]
            value, std = plain(self.values[name]), plain(self.std[name])
            parameters[name] = {"value": value, "unit": self.units[name], "std": std, "ci95": ends}
        return {
            "estimator": self.estimator,
            "outcome": self.outcome,
            "advice": list(self.advice),
            "parameters": parameters,
            "covariance": [[plain(x) for x in row] for row in self.covariance],
            "correlation": [[plain(x) for x in row] for row in self.correlation],
            "prior": dict(self.prior),
            "cost": plain(self.cost),
            "n_simulations": self.n_simulations,
            "seconds": self.seconds,
            "sigmas": {name: plain(value) for name, value in self.sigmas.items()},
            "rms_residuals": {
                trial: {name: plain(rms([r])) for name, r in signals.items()}
                for trial, signals in self.residuals.items()
            },
        }

    def tables(self) -> list[Table]:
        """Parameters with their intervals; below, what the data do not tell."""
        rows = [(n, estimated(self.values[n], ends := self.ci95[n]), readable_unit(self.units[n]), interval(ends))
                for n in self.names]  # fmt: skip
        title = f"{self.estimator}: {self.outcome}, {self.n_simulations} simulations, {self.seconds:.2f} s"
        return [Table(("parameter", "value", "unit", "95 % interval"), tuple(rows), title, self.advice)]

    def figures(self) -> dict[str, Figure]:
        """Intervals relative to the estimates and their correlations; the fit over the measurement."""
        from ..evaluate.estimate_figures import parameters_figure, residuals_figure

        drawn = {"parameters": parameters_figure(self.names, self.values, self.ci95, self.correlation)}
        return drawn | ({"residuals": residuals_figure(self)} if self.residuals else {})


def correlation_of(covariance: np.ndarray) -> np.ndarray:
    """Correlation matrix of a covariance matrix, shape (n, n)."""
    deviations = np.sqrt(np.diag(covariance))
    with np.errstate(invalid="ignore", divide="ignore"):
        return covariance / np.outer(deviations, deviations)


def verdict(
    problem: Problem,
    minimum: Minimum,
    covariance: np.ndarray,
    ci95: Mapping[str, tuple[float, float]],
    hidden: Collection[str],
    at_limit: Collection[str],
    at_bound: Collection[str],
    memory: float,
    white: bool,
) -> tuple[str, tuple[str, ...]]:
    """The outcome of an estimation, and sentences on what to do about it.

    Args:
        problem, minimum: what was solved, and where the search ended.
        covariance, ci95: of the estimates, SI units, shape (n, n), and their 95 % intervals.
        hidden: parameters that do not show.
        at_limit, at_bound: strengths of effects at a physical limit; parameters at a bound that was given.
        memory, white: samples over which residuals stay correlated, and whether they are noise.
    """
    space, p, result = problem.space, problem.space.to_values(minimum.state.u), []
    hints = hints_of(space.names)
    for effect in problem.mechanism.effects:
        experiment = effect.said().get("experiment", "").rstrip(".")
        for par in effect.parameters_on(problem.mechanism.system, problem.mechanism.law):
            if experiment:
                hints.setdefault(par.name, f"record {experiment}")
    slides = any(motion.fast.any() for motion in problem.motions)
    still = no_slip(problem.recording, problem.mechanism.system)
    if still:
        result.append(f"{still}: increase the excitation until it breaks loose")
    elif not slides:
        result.append("the contact hardly slides in this recording: increase the excitation until it does")
    # Where nothing shows beside residuals that are not noise, the model is at fault and no excitation would help.
    lost, open_ended = not white and len(hidden) == len(p), False
    for i, (name, lower) in enumerate(zip(space.names, space.below, strict=True)):
        low, high = (np.nan, np.nan) if space.scales[i] or name in at_bound else ci95[name]
        least = float(p[lower]) * MERGED if lower >= 0 else 0.0  # what an interval must exceed to tell anything
        hint, open_ended = hints.get(name, VARY), open_ended or (low <= least and (np.isinf(high) or lower >= 0))
        if low > least and np.isinf(high):
            result.append(f"{name}: at least {low:.2g}, not told from above: {hint}")
        elif low <= least and np.isfinite(high):
            why = f": {FLAT}" if lower >= 0 else f", not told from below: {hint}"
            result.append(f"{name}: at most {high:.2g}{why}")
        elif not lost and (name in hidden or low <= least):
            result.append(f"{name} does not show in these data: {hint}")
    value = dict(zip(space.names, p.tolist(), strict=True))
    for name in at_limit:
        more = ": the data show no such effect" if value[name] == 0 else ""
        result.append(f"{name} ended at {value[name]:g}, its physical limit{more}")
    for name in at_bound:
        lower = space.below[space.names.index(name)]
        if lower >= 0 and value[name] < MERGED * p[lower]:
            result.append(f"{name} ended at {space.names[lower]}: {FLAT}")
            continue
        result.append(f"{name} ended at its bound, {value[name]:.3g}: widen bounds.{name}, or hold it fixed")
    for v_s in (name for name in space.names if plain_name(name) == "v_s"):
        if slides and value[v_s] > BROAD * problem.scales.sizes.at(v_s).scales["speed"][1]:
            bend = "the Stribeck term bends the whole curve and stands for something else"
            result.append(f"{v_s} is as large as the speeds in these data: {bend}; take a law without it")
    result += sentences(space.names, np.nan_to_num(correlation_of(covariance)), hints)
    smooth = {name for model in problem.trials for item in model.inputs for name in item.names}
    rough = [name for name in problem.channels.input_names if name in problem.sigmas and name not in smooth]
    if rough and problem.joint:
        result.append(f"too rough for a smooth path, taken as measured without noise: {', '.join(rough)}")
    if not white or memory > CORRELATED:
        span = f" stay correlated over {memory:.0f} samples" if memory > CORRELATED else " are no white noise"
        result.append(
            f"residuals{span}: the model lacks something (diagnose.py says what), its inputs are filtered, or a lower "
            "minimum was not found; intervals are widened for the correlation"
        )
    outcome = UNEXPLAINED if not white else CONVERGED if minimum.reason in (ENDED, "stuck") else STOPPED
    outcome = AT_BOUND if at_bound else UNIDENTIFIED if (hidden and not lost) or open_ended else outcome
    outcome = outcome if slides and not still and (lost or len(hidden) < len(p)) else NO_EXCITATION
    return outcome, tuple(result)


def hints_of(names: Iterable[str]) -> dict[str, str]:
    """What to record to tell each of these parameters better, those of several contacts too."""
    return {name: HINTS[own] for name in names if (own := plain_name(name)) in HINTS}


def sentences(names: tuple[str, ...], correlation: np.ndarray, hints: Mapping[str, str]) -> list[str]:
    """One sentence for each pair of parameters that the data hardly separate."""
    result = []
    for i, first in enumerate(names):
        for j in range(i):
            r = correlation[i, j]
            if abs(r) > INSEPARABLE:
                hint = hints.get(first) or hints.get(names[j]) or VARY
                result.append(f"{names[j]} and {first} move together (correlation {r:.2f}): {hint}")
    return result
