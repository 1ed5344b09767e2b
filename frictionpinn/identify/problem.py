"""The estimation problem: a mechanism, a recording, what is unknown, and the distance between model and data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..data.recording import Recording
from ..errors import choose
from ..numerics.parallel import in_parallel
from ..numerics.simulate import ContactLost, SimulationFailed, Simulator
from ..physics.mechanism import Mechanism
from .build import Builder, Channels, difference_sigmas, windows_of
from .loss import LOSSES, choose_loss
from .motion import smoothed
from .prior import Prior
from .solve import Evaluate, State
from .space import Space, check_fixed, check_names
from .start import data_start, default_bounds
from .trial import Piece, TrialModel


class Problem:
    """What every estimator minimises.

    Args:
        mechanism: the model.
        recording: what was measured.
        free: parameters to estimate; by default those of the friction law. Strengths and shapes of effects are held
            unless they are named here.
        bounds: name -> (low, high), SI units; by default wide around what the recording suggests.
        fixed: name -> value of parameters that are known.
        sigmas: signal -> noise standard deviation, SI units; those not given are estimated.
        inputs: "joint" estimates the paths of noisy inputs with the parameters, "fixed" takes them as smoothed.
        initial: "free" or, where every trial starts at "rest", that.
        windows: length, s, of windows with free initial states, for long, unstable or closed-loop recordings; None
            simulates whole trials.
        loss: "gaussian", "robust" (outliers) or "auto", see :func:`frictionpinn.identify.loss.choose_loss`.

    Raises:
        UserError: names, bounds or signals that do not fit.
    """

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
        loss: str = "auto",
    ):
        self.mechanism, self.recording = mechanism, recording
        self.simulator = Simulator(mechanism)
        self.loss = choose_loss(loss, mechanism)
        self.coarse_loss = LOSSES["gaussian"] if loss == "auto" else self.loss  # jumps do not make outliers there
        self.joint = choose(inputs, {"joint": True, "fixed": False}, "inputs")
        choose(initial, {"free": 1, "rest": 1}, "initial")
        check_names(mechanism, (*(free or ()), *(bounds or {}), *(fixed or {})))
        check_fixed(mechanism, fixed or {})
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
        self.scales = scales
        self.bounded = frozenset(name for name, pair in (bounds or {}).items() if pair is not None)
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
        self.prior = Prior.of(self.space, self.start, self.fixed)
        self._calls: list[bool] = []

    @property
    def simulations(self) -> int:
        """How often the recording was simulated so far."""
        return len(self._calls)  # appending is safe in threads

    # the model's distance from the data -----------------------------------------------------------------------
    def values(self, u: np.ndarray) -> dict[str, float]:
        """All parameters by name, SI units, at the search vector u."""
        return self.fixed | dict(zip(self.names, self.space.to_values(u).tolist(), strict=True))

    def evaluator(
        self,
        models: Sequence[TrialModel],
        sigmas: Mapping[str, float] | None = None,
        joint: bool | None = None,
        **given,
    ) -> Evaluate:
        """:meth:`evaluate` of these trials and noise levels, as searches call it; ``given`` are further options."""

        def evaluate(u, locals_, derivatives, **options):
            return self.evaluate(models, u, locals_, derivatives, joint=joint, sigmas=sigmas, **(given | options))

        return evaluate

    def evaluate(
        self,
        models: Sequence[TrialModel],
        u: np.ndarray,
        locals_: Sequence[np.ndarray],
        derivatives: bool,
        *,
        joint: bool | None = None,
        sigmas: Mapping[str, float] | None = None,
        ran: State | None = None,
        width: float = 0.0,
        prior: bool = True,
        **options,
    ) -> State | None:
        """Cost at u and the local unknowns, all trials in parallel; None where one cannot be simulated.

        ``ran`` is the state there from ``strict`` simulations: with derivatives, nothing is simulated again. ``width``
        is the resolution in time, s; without ``prior`` the cost is that of the data alone.
        """
        loss = self.coarse_loss if width else self.loss
        p, joint = self.values(u), self.joint if joint is None else joint
        sigmas, names = sigmas or self.sigmas, self.names if derivatives else ()
        runs = [None] * len(models) if ran is None else [part.run for part in ran.pieces]
        if not derivatives or any(run is None for run in runs):
            self._calls.append(derivatives)
        change = self.space.jacobian(u)

        def piece(k: int) -> Piece | None:
            try:
                found = models[k].evaluate(p, locals_[k], sigmas, loss, names, joint, runs[k], width, **options)
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
        if prior and len(self.prior.target):
            pieces = (self.prior.added(pieces[0], u), *pieces[1:])
        return State(np.asarray(u, float), tuple(locals_), pieces)
