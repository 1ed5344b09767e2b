"""The estimation problem: a mechanism, a recording, what is unknown, and the distance between model and data."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np

from ..data.recording import Recording
from ..errors import UserError, choose
from ..numerics.simulate import ContactLost, SimulationFailed, Simulator
from ..physics.mechanism import Mechanism
from .build import Builder, Channels, difference_sigmas, windows_of
from .loss import choose_loss
from .solve import State
from .space import Space
from .trial import Piece, TrialModel

_POOL = ThreadPoolExecutor(max_workers=max(1, len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 1))
DECADES = 2.0  # reach of the bounds where none are given, to either side of a scale taken from the data


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
        law = [par.name for par in mechanism.law.parameters if par.value is None]
        names = tuple(free) if free is not None else tuple(n for n in law if n not in (fixed or {}))
        defaults = {par.name: par.value for par in mechanism.parameters} | mechanism.system.values
        self.fixed = {k: float(v) for k, v in (defaults | dict(fixed or {})).items() if v is not None and k not in names}
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
        self.trials: tuple[TrialModel, ...] = tuple(_POOL.map(builder.model, trials))
        self.space = Space.build(mechanism, names, dict(bounds or {}), self.fixed)
        self.names = self.space.names
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
        T = self.space.jacobian(u)

        def piece(k: int) -> Piece | None:
            try:
                found = models[k].evaluate(p, locals_[k], sigmas, self.loss, names, joint, **options)
            except (ContactLost, SimulationFailed):
                return None
            if not names:
                return found
            return replace(found, gg=T.T @ found.gg @ T, gl=T.T @ found.gl, grad_g=T.T @ found.grad_g)

        order = sorted(range(len(models)), key=lambda k: -len(models[k].t) * models[k].size(joint))
        found = dict(zip(order, _POOL.map(piece, order), strict=True))
        pieces = tuple(found[k] for k in range(len(models)))
        if any(part is None or not np.isfinite(part.cost) for part in pieces):
            return None
        return State(np.asarray(u, float), tuple(locals_), pieces)
