"""Refine a trained parameter estimator by maximum likelihood on simulated trajectories."""

from __future__ import annotations

import logging
from typing import Any

import numpy as np

from ..data.module import TrajectoryData
from ..errors import UserError
from ..identify.likelihood import maximum_likelihood
from ..identify.problem import Problem
from ..identify.result import Estimate
from ..models import FrictionModel
from ..physics import System
from ..physics.base import contact_of, plain_name
from ..physics.mechanism import Mechanism
from .build import Config, build_friction, law_table
from .result import truth_at

log = logging.getLogger(__name__)


def check_refinable(cfg: Config) -> None:
    """Raise :class:`UserError` where there are no parameters to refine."""
    if cfg.get("refine") and not cfg["model"]["name"].startswith("pe"):
        raise UserError(
            "a black box has no parameters to refine",
            where="refine",
            received=f"true with model={cfg['model']['name']}",
            allowed="model=pe1 or model=pe2",
            fix="choose a PE, or leave refine=false",
        )


def refine(cfg: Config, system: System, data: TrajectoryData, model: FrictionModel) -> dict[str, Any]:
    """Estimate the law's parameters on the training trials, from the network's values and from a search of its own.

    A network cannot see what happens between stick and slip, so its mu_s and v_s may lie in another valley of the
    likelihood: the better of the two is kept, and both are told.

    Returns:
        :meth:`Estimate.to_dict` with ``started_from``, the truth where it is known, and the log-likelihoods of both.
    """
    mechanism = Mechanism(system, build_friction(cfg["friction"], system))
    fixed, bounds = (law_table(cfg["friction"], key, mechanism.law) for key in ("fixed", "bounds"))
    recording = data.recording.select(data.splits["train"])
    problem = Problem(mechanism, recording, fixed=fixed, bounds=bounds)
    start = {name: value for name, value in model.physical().items() if name in problem.names}
    log.info("refining by maximum likelihood, from the network's parameters and from a search of its own")
    found = {
        cfg["model"]["name"]: maximum_likelihood(problem, start=start),
        "search": maximum_likelihood(Problem(mechanism, recording, fixed=fixed, bounds=bounds)),
    }
    scores = {name: log_likelihood(estimate) for name, estimate in found.items()}
    best = max(scores, key=lambda name: scores[name])
    result = found[best].to_dict() | {"started_from": best, "log_likelihood": scores}
    for contact in model.contacts:
        obeyed, known = truth_at(cfg["data"], system, contact)
        if obeyed is not None and obeyed.name == mechanism.law.at(contact).name:
            for name, entry in result["parameters"].items():
                if contact_of(name) == contact and plain_name(name) in known:
                    entry["truth"] = float(known[plain_name(name)])
    return result


def log_likelihood(estimate: Estimate) -> float:
    """Gaussian log-likelihood without its constant, noise levels included; -inf for a failed estimate."""
    if not np.isfinite(estimate.cost):
        return -np.inf
    total = -estimate.cost
    for signals in estimate.residuals.values():
        for name, values in signals.items():
            total -= float(np.sum(np.isfinite(values))) * float(np.log(estimate.sigmas[name]))
    return total
