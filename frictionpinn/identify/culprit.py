"""Why no start could be simulated: what the simulation said, and what of the recording speaks against it."""

from __future__ import annotations

import math

import numpy as np

from ..numerics.simulate import ContactLost, SimulationFailed
from .problem import Problem
from .trial import TrialModel

OFF = 2.0  # times its signal's rate: a rate that is more off is another thing
TURNS = 4.0  # turns of an angle beyond which degrees are likelier
COARSE = 6.0  # samples to a period of the fastest motion, below which its path is not known between them


def culprit(problem: Problem) -> str:
    """The first trial that fails with what it said, rates that are none, angles beyond reason, a coarse time step."""
    said = list(filter(None, (_failure(problem, model) for model in problem.trials)))[:1]
    said += [text for model in problem.trials for text in (*_rates(problem, model), *_inputs(model))]
    return "; ".join(dict.fromkeys(said[:4]))


def _failure(problem: Problem, model: TrialModel) -> str:
    values = problem.fixed | problem.start
    try:
        own = model.in_equilibrium(values)
        own.simulate(values, own.local[: own.size(problem.joint)])
    except (ContactLost, SimulationFailed) as failure:
        return f"trial {model.trial}: {failure}"
    return ""


def _rates(problem: Problem, model: TrialModel) -> list[str]:
    """Measured rates that are not the rates of what they are said to be."""
    measured = dict(zip(model.outputs, model.y, strict=True))
    measured |= {name: row for item in model.inputs for name, row in zip(item.names, item.y, strict=True)}
    told = []
    for c in problem.mechanism.system.moving:
        for low, high in zip(c.signals[:2], c.signals[1:], strict=True):
            if low in measured and high in measured and np.isfinite([measured[low][1:], measured[high][1:]]).all():
                # Over a quarter of the trial: the noise of single differences would count.
                lag = max(len(model.t) // 20, 1)
                moved = measured[low][lag:] - measured[low][:-lag]
                steps = np.diff(model.t) * (measured[high][1:] + measured[high][:-1]) / 2
                total = np.concatenate([[0.0], np.cumsum(steps)])
                other = total[lag:] - total[:-lag]
                ratio = float(moved @ other) / max(float(other @ other), 1e-300)
                if not 1 / OFF < ratio < OFF:
                    told.append(f"{low}' is {ratio:.3g} times {high}")
    return told


def _inputs(model: TrialModel) -> list[str]:
    """Angles through many turns, and steps in which an input's motion goes too far."""
    told = []
    for item in model.inputs:
        y, name = item.y[0], item.names[0]
        if len(item.names) < 2 or not np.isfinite(y).all():
            continue
        if np.ptp(y) > TURNS * 2 * math.pi:
            told.append(f"{name} goes from {y.min():.3g} to {y.max():.3g}: degrees?")
        middle = y - y.mean()
        crossings = int(np.count_nonzero(np.diff(np.sign(middle)) != 0))
        if crossings * COARSE / 2 > len(y):
            told.append(f"{name} turns every {len(y) / max(crossings, 1):.2g} samples: the time step is too long")
    return told
