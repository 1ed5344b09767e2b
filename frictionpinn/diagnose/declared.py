"""The fit of the model as it was declared, whatever the noise."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..data.recording import Recording
from ..errors import UserError
from ..identify.likelihood import maximum_likelihood
from ..identify.problem import Problem
from ..identify.result import FAILED, Estimate
from ..physics.mechanism import Mechanism
from .noise import outliers

LOUDER = 2.5  # times the noise that differences show, where the model cannot be simulated with that
OUTLIERS = 2e-3  # share of lone residuals beyond five standard deviations from which the loss is robust


def fit_declared(
    mechanism: Mechanism, fitted: Recording, start: Mapping[str, float] | None, options: Mapping[str, Any]
) -> tuple[Problem, Estimate, dict[str, Any]]:
    """The problem, its estimate and the options that it took.

    Args:
        mechanism: as declared.
        fitted: trials to fit.
        start: start values of parameters, SI units.
        options: of :class:`Problem`; its loss "auto" is robust where there are outliers, and for laws without memory,
            which jump within a sample.

    Raises:
        UserError: the declared model cannot be fitted.
    """
    auto = options.get("loss", "auto") == "auto"
    options = {**options, "loss": "gaussian" if auto and mechanism.law.memory else options.get("loss", "auto")}
    problem = Problem(mechanism, fitted, **options)
    estimate = maximum_likelihood(problem, start=start)
    if estimate.outcome == FAILED and not options.get("sigmas"):
        # Coloured noise differs little from sample to sample: it is larger than it seems, and paths that follow it
        # lose contact.
        louder = {name: LOUDER * sigma for name, sigma in problem.sigmas.items()}
        problem = Problem(mechanism, fitted, **(options | {"sigmas": louder})).varied(sigmas={})
        estimate = maximum_likelihood(problem, start=start)
    if auto and mechanism.law.memory and estimate.outcome != FAILED and outliers(estimate.residuals) > OUTLIERS:
        options["loss"] = "robust"
        problem = Problem(mechanism, fitted, **options)
        estimate = maximum_likelihood(problem, start=start)
    if estimate.outcome == FAILED:
        raise UserError("the declared model cannot be fitted", where="system, friction", received=mechanism.name,
                        fix="; ".join(estimate.advice))  # fmt: skip
    return problem, estimate, options
