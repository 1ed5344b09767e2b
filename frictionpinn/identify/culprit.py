"""Why no start could be simulated: what the simulation said, and what of the recording speaks against it."""

from __future__ import annotations

import numpy as np

from ..data.inspect import inspect
from ..numerics.simulate import ContactLost, SimulationFailed
from .problem import Problem
from .trial import TrialModel

COARSE = 6.0  # samples to a period of the fastest motion, below which its path is not known between them


def culprit(problem: Problem) -> str:
    """The first trial that fails with what it said, what the check of the recording finds, a coarse time step."""
    said = list(filter(None, (_failure(problem, model) for model in problem.trials)))[:1]
    said += [str(finding) for finding in inspect(problem.recording, problem.mechanism.system)]
    said += [text for model in problem.trials for text in _coarse(model)]
    return "; ".join(dict.fromkeys(said[:4]))


def _failure(problem: Problem, model: TrialModel) -> str:
    values = problem.fixed | problem.start
    try:
        own = model.in_equilibrium(values)
        own.simulate(values, own.local[: own.size(problem.joint)])
    except (ContactLost, SimulationFailed) as failure:
        return f"trial {model.trial}: {failure}"
    return ""


def _coarse(model: TrialModel) -> list[str]:
    """Imposed motions that turn within a few samples."""
    told = []
    for item in model.inputs:
        y = item.y[0]
        crossings = np.count_nonzero(np.diff(np.sign(y - y.mean()))) if np.isfinite(y).all() else 0
        if len(item.names) > 1 and crossings * COARSE / 2 > len(y):
            told.append(f"{item.names[0]} turns every {len(y) / crossings:.2g} samples: the time step is too long")
    return told
