"""A fit to the trials of a problem, whether it leaves anything but noise, and that of the model as declared."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ..data.recording import Recording
from ..errors import UserError
from ..identify.likelihood import maximum_likelihood
from ..identify.problem import Problem
from ..identify.result import FAILED, Estimate
from ..identify.trial import TrialModel
from ..numerics.coloured import outliers
from ..numerics.loss import Loss
from ..numerics.quadratic import State
from ..physics.mechanism import Mechanism

LOUDER = 2.5  # times the noise that differences show, where the model cannot be simulated with that
OUTLIERS = 0.2  # share of lone residuals in the sum of squares: noise levels told without them differ by a tenth


@dataclass(frozen=True, eq=False)
class Fit:
    """A fit to the trials of a problem; no other is equal to it.

    Attributes:
        names: parameters that were estimated.
        values: all parameters of the tested mechanism by name, SI units.
        models: of the trials.
        state: unknowns and cost.
        sigmas: noise levels that weighted the residuals, SI units.
        width: resolution in time at which model and measurement were compared, s; 0: sample by sample.
        span: time over which what a model lacks may stay correlated, s.
        ended: whether the search for it came to an end.
    """

    names: tuple[str, ...]
    values: dict[str, float]
    models: tuple[TrialModel, ...]
    state: State
    sigmas: dict[str, float]
    width: float = 0.0
    span: float = 0.0
    ended: bool = True

    @property
    def locals(self) -> tuple[np.ndarray, ...]:
        """Unknowns of each trial."""
        return self.state.locals

    @property
    def cost(self) -> float:
        """Negative log-likelihood, and half of log n for every parameter (Bayesian information criterion)."""
        count = sum(len(model.t) * len(model.outputs) for model in self.models)
        level = sum(np.log(self.sigmas[n]) * np.isfinite(r).sum() for n, own in self._residuals.items() for r in own)
        return self.state.cost + float(level + 0.5 * len(self.names) * np.log(count))

    @property
    def _residuals(self) -> dict[str, list[np.ndarray]]:
        names = dict.fromkeys(name for piece in self.state.pieces for name in piece.residuals)
        return {name: [p.residuals[name] for p in self.state.pieces if name in p.residuals] for name in names}

    def levels(self, loss: Loss) -> dict[str, float]:
        """Noise of every signal as the residuals show it, SI units."""
        result = dict(self.sigmas)
        for name in self._residuals:
            r = self.state.left(name)
            result[name] = (loss.sigma(r, len(r)) if len(r) else 0.0) or result[name]
        return result

    @cached_property
    def white(self) -> bool:
        """Whether the residuals of the outputs are as white as noise, see
        :func:`frictionpinn.numerics.whiteness.whiteness`."""
        outputs = dict.fromkeys(name for model in self.models for name in model.outputs)
        interval = min(float(np.median(np.diff(model.t))) for model in self.models)
        return self.state.white(outputs, round(self.span / interval))


def fit_declared(
    mechanism: Mechanism, fitted: Recording, start: Mapping[str, float] | None, options: Mapping[str, Any]
) -> tuple[Problem, Estimate, dict[str, Any]]:
    """The problem, its estimate and the options that it took.

    Args:
        mechanism: as declared.
        fitted: trials to fit.
        start: start values of parameters, SI units.
        options: of :class:`Problem`; its loss "auto" is robust, too, where lone residuals make much of the sum of
            squares: outliers.

    Raises:
        UserError: the declared model cannot be fitted.
    """
    auto = options.get("loss", "auto") == "auto"
    options = dict(options)
    if auto:  # where the motion is imposed, it is measured where a force without memory jumps
        options["loss"] = "gaussian" if mechanism.system.massless else "auto"
    problem = Problem(mechanism, fitted, **options)
    estimate = maximum_likelihood(problem, start=start, profiles=False)
    if estimate.outcome == FAILED and not options.get("sigmas"):
        # Coloured noise differs little from sample to sample: it is larger than it seems, and paths that follow it
        # lose contact.
        louder = {name: LOUDER * sigma for name, sigma in problem.sigmas.items()}
        problem = Problem(mechanism, fitted, **(options | {"sigmas": louder})).varied(sigmas={})
        estimate = maximum_likelihood(problem, start=start, profiles=False)
    if auto and not problem.loss.robust and estimate.outcome != FAILED and outliers(estimate.residuals) > OUTLIERS:
        options["loss"] = "robust" if mechanism.law.memory else "auto"
        problem = Problem(mechanism, fitted, **options)
        estimate = maximum_likelihood(problem, start=start, profiles=False)
    if estimate.outcome == FAILED:
        raise UserError("the declared model cannot be fitted", where="system, friction", received=mechanism.name,
                        fix="; ".join(estimate.advice))  # fmt: skip
    return problem, estimate, options
