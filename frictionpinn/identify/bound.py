"""What a recording can tell before any fit: the Cramer-Rao bound, and which experiment to do next."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..data.recording import Recording
from ..data.simulated import simulate_trials
from ..errors import UserError
from ..numerics.quadratic import reduced
from ..numerics.simulate import ContactLost, SimulationFailed
from ..physics.mechanism import Mechanism
from ..show import Table, plain
from .problem import Problem
from .result import VARY, Told, hints_of, sentences
from .space import Space
from .uncertainty import covariance_of, interval, untold

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, repr=False)
class Bound(Told):
    """Smallest covariance that an unbiased estimator can have.

    Attributes:
        names: parameters, in the mechanism's order.
        values: name -> value at which it holds, SI units.
        covariance: SI units, shape (n, n); NaN for parameters that do not show in the data.
        space: parameters and their search coordinates u.
        information: Fisher information of u, shape (n, n).
    """

    names: tuple[str, ...]
    values: dict[str, float]
    covariance: np.ndarray
    space: Space
    information: np.ndarray

    @classmethod
    def at(cls, space: Space, u: np.ndarray, information: np.ndarray) -> Bound:
        """The bound at a search vector u, shape (n,), from the information on it."""
        covariance = covariance_of(space, u, information, untold(space, u, information))
        return cls(space.names, space.named(u), covariance, space, information)

    def information_in(self, space: Space) -> np.ndarray:
        """Fisher information of the search vector of another space, whose units follow another recording."""
        own, other = (s.jacobian(s.to_search(self.values)) for s in (self.space, space))
        change = np.linalg.solve(own, other)
        return change.T @ self.information @ change

    @property
    def relative(self) -> dict[str, float]:
        """name -> least standard error over the value."""
        return {name: s / abs(self.values[name]) if self.values[name] else np.inf for name, s in self.std.items()}

    @property
    def advice(self) -> tuple[str, ...]:
        """Sentences on what these data cannot tell or not separate."""
        hidden, hints = [name for name, s in self.std.items() if not np.isfinite(s)], hints_of(self.names)
        told = [f"{name} does not show in these data: {hints.get(name, VARY)}" for name in hidden]
        return (*told, *sentences(self.names, np.nan_to_num(self.correlation), hints))

    def tables(self) -> list[Table]:
        """Least standard errors, absolute and relative; below, what these data cannot tell."""
        rows = [(n, self.values[n], s, f"{100 * self.relative[n]:.2g} %" if np.isfinite(self.relative[n]) else "")
                for n, s in self.std.items()]  # fmt: skip
        title = "least standard errors of any unbiased estimator"
        return [Table(("parameter", "value", "standard error", "relative"), tuple(rows), title, self.advice)]

    def figures(self) -> dict[str, Figure]:
        """95 % intervals relative to the values, and correlations."""
        from ..evaluate.estimate_figures import parameters_figure

        ends = {n: interval(v, self.std[n], positive=False) for n, v in self.values.items()}
        return {"parameters": parameters_figure(self.names, self.values, ends, self.correlation)}

    def to_dict(self) -> dict[str, Any]:
        """Values, least standard errors and correlations as plain types; NaN becomes None."""
        return {
            "parameters": {n: {"value": plain(self.values[n]), "std": plain(s)} for n, s in self.std.items()},
            "correlation": [[plain(x) for x in row] for row in self.correlation],
            "advice": list(self.advice),
        }


def bound(
    mechanism: Mechanism,
    recording: Recording,
    values: Mapping[str, float],
    *,
    sigmas: Mapping[str, float] | None = None,
    inputs: str = "joint",
    **options: Any,
) -> Bound:
    """Cramer-Rao bound of the parameters: the inverse of the Fisher information sum (dy/dp)' (dy/dp) / sigma^2.

    Initial states, and with ``inputs="joint"`` the paths of the noisy inputs, are unknown too and eliminated.

    Args:
        mechanism, values: the model, and parameters at which the bound holds, by name, SI units.
        recording: its times and inputs count; simulated without noise or measured.
        sigmas: noise standard deviations by signal, SI units; None: estimated from the recording.
        inputs: "joint" (as noisy as they are measured) or "known" (exact).
        options: of :class:`Problem`: free, fixed, initial, windows.

    Raises:
        UserError: names or signals that do not fit; the mechanism cannot be simulated at these values.
    """
    inputs = "fixed" if inputs == "known" else inputs
    return bound_of(Problem(mechanism, recording, sigmas=sigmas, inputs=inputs, **options), values)


def bound_of(problem: Problem, values: Mapping[str, float]) -> Bound:
    """Cramer-Rao bound of a problem at parameter values, by name, SI units, within its bounds or not; those that are
    not free are held there.

    Raises:
        UserError: an unknown name, a free parameter without a value; the mechanism cannot be simulated at these values.
    """
    problem.mechanism.check_values(values, "values")
    for name in problem.names:
        if not np.isfinite(values.get(name, np.nan)):
            raise UserError("parameter without a value", where=f"values.{name}", received=values.get(name),
                            fix="give the value at which to plan, or hold it: fixed={name: value}")  # fmt: skip
    held = {name: value for name, value in values.items() if name not in problem.names}
    own = problem.varied(values=held, limits=problem.space.reaching(values))
    u = own.space.to_search(values)
    models = own.models_at(u)
    evaluate = own.evaluator(models, prior=False)
    state = evaluate(u, [model.local[: model.size(own.joint)] for model in models], True)
    if state is None:
        raise UserError("the mechanism cannot be simulated at these values", where="values", received=dict(values))
    return Bound.at(own.space, u, reduced(state)[0])


@dataclass(frozen=True)
class Ranked:
    """One candidate experiment.

    Attributes:
        candidate: as given.
        relative: name -> least relative standard error with the present data and this experiment.
        gain: factor by which it divides the volume of the confidence region (D-optimality), per parameter.
        failure: why it cannot be done (contact lost); empty otherwise.
    """

    candidate: Mapping[str, Any]
    relative: dict[str, float]
    gain: float
    failure: str = ""

    def __str__(self) -> str:
        told = ", ".join(f"{name} {100 * s:.2g} %" for name, s in self.relative.items())
        return f"{dict(self.candidate)}: " + (self.failure or f"gain {self.gain:.2f}; {told}")


def rank_experiments(
    mechanism: Mechanism,
    values: Mapping[str, float],
    candidates: Sequence[Mapping[str, Any]],
    *,
    rate_hz: float,
    sigmas: Mapping[str, float],
    present: Recording | None = None,
    target: str | None = None,
    **options: Any,
) -> list[Ranked]:
    """Rank candidate excitations by the bound that they would give when added to the present data; best first.

    Information adds over trials, so that each candidate is simulated once.

    Args:
        mechanism, values: the model, and parameters at which to plan, by name (an estimate's), SI units.
        candidates: trials as in the configuration: ``duration``, an expression of time for every driven coordinate
            and input, ``initial``, ``constants``.
        rate_hz, sigmas: samples per second, and noise standard deviations by signal, SI units.
        present: recording at hand; None: the experiment stands alone.
        target: parameter whose standard error ranks; None: the volume of the confidence region (D-optimal).
        options: see :func:`bound`.

    Raises:
        UserError: an unknown target, or a candidate that cannot be read.
    """
    base = None if present is None else bound(mechanism, present, values, sigmas=sigmas, **options)
    ranked, own_values = [], dict(options.get("fixed") or {}) | dict(values)
    for candidate in candidates:
        try:
            recording = simulate_trials(mechanism, own_values, [candidate], rate_hz)
            own = bound(mechanism, recording, values, sigmas=sigmas, **options)
        except (ContactLost, SimulationFailed) as error:
            ranked.append(Ranked(candidate, {}, 0.0, str(error)))
            continue
        if target is not None and target not in own.names:
            raise UserError("unknown target", where="target", received=target, allowed=", ".join(own.names))
        u = own.space.to_search(own.values)
        before = np.zeros_like(own.information) if base is None else base.information_in(own.space)
        total = Bound.at(own.space, u, before + own.information)
        with np.errstate(divide="ignore"):
            volumes = [np.linalg.slogdet(M + 1e-9 * np.eye(len(u)))[1] for M in (before, total.information)]
        gain = float(np.exp((volumes[1] - volumes[0]) / 2 / len(u)))
        ranked.append(Ranked(candidate, total.relative, gain))

    def order(item: Ranked) -> tuple[bool, float]:
        error = item.relative.get(target, np.inf) if target else -item.gain
        return bool(item.failure), error if np.isfinite(error) else np.inf

    return sorted(ranked, key=order)
