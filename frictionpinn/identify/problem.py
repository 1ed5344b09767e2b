"""The estimation problem: a mechanism, a recording, what is unknown, and the distance between model and data."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import TypeVar

import numpy as np

from ..data.recording import Recording
from ..errors import choose
from ..numerics.simulate import ContactLost, SimulationFailed, Simulator
from ..physics.mechanism import Mechanism
from .build import Builder, Channels, difference_sigmas, windows_of
from .loss import choose_loss
from .motion import smoothed
from .solve import State
from .space import Space, check_names
from .start import data_start, default_bounds
from .trial import Piece, TrialModel

T = TypeVar("T")
WORKERS = max(1, len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1)
_POOL = ThreadPoolExecutor(max_workers=WORKERS)


def in_parallel(work: Callable[[int], T], loads: Sequence[float]) -> list[T]:
    """[work(0), work(1), ...] on all cores: one batch a core, of about equal load."""
    batches: list[list[int]] = [[] for _ in range(min(WORKERS, len(loads)))]
    totals = [0.0] * len(batches)
    for k in sorted(range(len(loads)), key=lambda k: -loads[k]):
        lightest = totals.index(min(totals))
        batches[lightest].append(k)
        totals[lightest] += loads[k]
    if len(batches) < 2:
        return [work(k) for k in range(len(loads))]
    results = list(_POOL.map(lambda batch: [work(k) for k in batch], batches))
    found = {
        k: value for batch, values in zip(batches, results, strict=True) for k, value in zip(batch, values, strict=True)
    }
    return [found[k] for k in range(len(loads))]


class Problem:
    """What every estimator minimises."""

    def __init__(
        self,
        mechanism: Mechanism,
        recording: Recording,
        free: Sequence[str] | None = None,
        bounds: Mapping[str, Sequence[float]] | None = None,
        fixed: Mapping[str, float] | None = None,
        sigmas: Mapping[str, float] | None = None,
        inputs: str = "joint",
        initial: str = "free",
        windows: float | None = None,
        loss: str = "gaussian",
    ):
        self.mechanism, self.recording = mechanism, recording
        self.simulator = Simulator(mechanism)
        self.loss = choose_loss(loss)
        self.joint = choose(inputs, {"joint": True, "fixed": False}, "inputs")
        choose(initial, {"free": 1, "rest": 1}, "initial")
        check_names(mechanism, (*(free or ()), *(bounds or {}), *(fixed or {})))
        law = [par.name for par in mechanism.law.parameters if par.value is None]
        names = tuple(free) if free is not None else tuple(n for n in law if n not in (fixed or {}))
        defaults = {par.name: par.value for par in mechanism.parameters} | mechanism.system.values
        self.fixed = {
            k: float(v) for k, v in (defaults | dict(fixed or {})).items() if v is not None and k not in names
        }
        trials = windows_of(recording, windows)
        self.channels = Channels.of(mechanism, set().union(*(trial.signals for trial in trials)))
        measured = [
            name
            for name in (*self.channels.outputs, *self.channels.input_names)
            if any(name in trial.signals for trial in trials)
        ]
        self.given = dict(sigmas or {})
        self.sigmas = difference_sigmas(trials, measured) | self.given
        builder = Builder(self.simulator, self.channels, self.sigmas, initial, self.joint)
        self.trials: tuple[TrialModel, ...] = tuple(
            in_parallel(lambda k: builder.model(trials[k]), [len(trial) for trial in trials])
        )
        self.motions = smoothed(mechanism, self.trials, self.sigmas)
        scales = data_start(mechanism, self.motions, self.fixed, names)
        self.mass = scales.mass
        table = {par.name: par for par in mechanism.parameters}
        self.space = Space.build(
            mechanism,
            names,
            default_bounds(mechanism, scales, dict(bounds or {})),
            self.fixed,
            {name: scales.sizes.of(table[name]) for name in names},
        )
        self.shapes = tuple(name for name in self.space.names if table[name].hidden and table[name].scan is not None)
        self.names = self.space.names
        self.start = dict(
            zip(
                self.names,
                np.clip([scales.start[n] for n in self.names], self.space.low, self.space.high).tolist(),
                strict=True,
            )
        )
        self.simulations = 0

    # the model's distance from the data -----------------------------------------------------------------------
    def values(self, u: np.ndarray) -> dict[str, float]:
        """All parameters by name, SI units, at the search vector u."""
        return self.fixed | dict(zip(self.names, self.space.to_values(u).tolist(), strict=True))

    def evaluate(
        self,
        models: Sequence[TrialModel],
        u: np.ndarray,
        locals_: Sequence[np.ndarray],
        derivatives: bool,
        *,
        joint: bool | None = None,
        sigmas: Mapping[str, float] | None = None,
        **options,
    ) -> State | None:
        """Cost at u and the local unknowns, all trials in parallel; None where one cannot be simulated."""
        p, joint = self.values(u), self.joint if joint is None else joint
        sigmas, names = sigmas or self.sigmas, self.names if derivatives else ()
        self.simulations += 1
        change = self.space.jacobian(u)

        def piece(k: int) -> Piece | None:
            try:
                found = models[k].evaluate(p, locals_[k], sigmas, self.loss, names, joint, **options)
            except (ContactLost, SimulationFailed):
                return None
            if not names:
                return found
            return replace(
                found, gg=change.T @ found.gg @ change, gl=change.T @ found.gl, grad_g=change.T @ found.grad_g
            )

        found = in_parallel(piece, [len(model.t) * (8 + model.size(joint)) for model in models])
        pieces = tuple(part for part in found if part is not None)
        if len(pieces) < len(models) or not all(np.isfinite(part.cost) for part in pieces):
            return None
        return State(np.asarray(u, float), tuple(locals_), pieces)
