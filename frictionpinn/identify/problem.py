"""The estimation problem: a mechanism, a recording, what is unknown, and the distance between model and data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from ..data.noise import check_levels
from ..data.recording import Recording, Trial
from ..errors import choose
from ..numerics.loss import LOSSES, choose_loss
from ..numerics.motion import smoothed
from ..numerics.parallel import in_parallel
from ..numerics.paths import DEGREE
from ..numerics.quadratic import Evaluate, Piece, State
from ..numerics.simulate import ContactLost, SimulationFailed, Simulator
from ..numerics.smoothing import difference_sigma
from ..physics.mechanism import Mechanism
from ..physics.sizes import Sizes
from .build import Channels, trial_model
from .scales import Scales, default_bounds
from .space import Prior, Space
from .trial import TrialModel

LONG_TRIAL = 4000  # samples: a trial with more is cut into windows of about half as many
COARSE_SHARE = 0.25  # of the usual time between two peaks of the slip velocity: a stop is placed better than that
REFINEMENT = 2.0  # factor from one resolution to the next: a minimum lies well within the basin of the next


def simulated_alone(recording: Recording, length_s: float | None = None) -> list[Trial]:
    """Trials and windows of the recording that are simulated each on its own, see ``windows`` of :class:`Problem`."""
    return recording.cut(length_s, longest=LONG_TRIAL, least=DEGREE + 3)


class Problem:
    """What every estimator minimises.

    Args:
        mechanism, recording: the model, and what was measured.
        free: parameters to estimate; by default those of the friction law. Strengths and shapes of effects are held
            unless they are named here.
        bounds: name -> (low, high), SI units; by default wide around what the recording suggests.
        fixed: name -> value of parameters that are known.
        sigmas: signal -> noise standard deviation, SI units; those not given are estimated.
        inputs: "joint" estimates the paths of noisy inputs with the parameters, "fixed" takes them as smoothed.
        initial: "free" or, where every trial starts at "rest", that.
        windows: length, s, of windows with free initial states, for long, unstable or closed-loop recordings; None
            simulates whole trials.
        loss: "gaussian", "robust" (outliers) or "auto", see :func:`frictionpinn.numerics.loss.choose_loss`.

    Attributes:
        mechanism, recording: as given.
        names: free parameters, in the mechanism's order; ``start``, ``fixed``: values of these and of all others.
        space: the free parameters' bounds and search coordinates; ``bounded``: those whose bounds were given.
        shapes: free hidden parameters of effects that are to be searched over their range.
        prior: what is known of them beforehand.
        sigmas: signal -> noise standard deviation, SI units; ``given``: those of them that are known.
        trials: models of the trials; ``motions``: these smoothed; ``channels``: signals of the recording.
        scales: where parameters start on this data, and how large they are.
        simulator, loss, joint: of the mechanism, of the residuals, and whether inputs are unknown, too.

    Raises:
        UserError: names, bounds, signals or noise levels that do not fit.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        recording: Recording,
        free: Sequence[str] | None = None,
        bounds: Mapping[str, Sequence[float] | None] | None = None,
        fixed: Mapping[str, float] | None = None,
        sigmas: Mapping[str, float] | None = None,
        inputs: str = "joint",
        initial: str = "free",
        windows: float | None = None,
        loss: str = "auto",
    ):
        self.mechanism, self.simulator, self.recording = mechanism, Simulator(mechanism, as_shown=True), recording
        self.loss = choose_loss(loss, mechanism)
        self.coarse_loss = LOSSES["gaussian"] if loss == "auto" else self.loss  # jumps do not make outliers there
        self.joint = choose(inputs, {"joint": True, "fixed": False}, "inputs")
        rest = choose(initial, {"free": False, "rest": True}, "initial")
        mechanism.check_names((*(free or ()), *(bounds or {}), *(fixed or {})), "free")
        mechanism.check_values(fixed or {}, "fixed")
        law = [par.name for par in mechanism.law.parameters if par.value is None]
        names = tuple(free) if free is not None else tuple(n for n in law if n not in (fixed or {}))
        held = {par.name: par.value for par in mechanism.parameters} | mechanism.system.values | dict(fixed or {})
        self.fixed = {name: float(v) for name, v in held.items() if v is not None and name not in names}
        trials = simulated_alone(recording, windows)
        self.channels = Channels.of(mechanism, set().union(*(trial.signals for trial in trials)))
        self.given = dict(sigmas or {})
        check_levels(self.given)
        self.sigmas: dict[str, float] = {}
        for name in (*self.channels.outputs, *self.channels.input_names):
            series = [(trial.t, trial.signals[name]) for trial in trials if name in trial.signals]
            if series:
                self.sigmas[name] = difference_sigma(series) or 1e-9
        self.sigmas |= self.given

        def model(k: int) -> TrialModel:
            return trial_model(trials[k], self.simulator, self.channels, self.sigmas, rest, self.joint)

        self.trials: tuple[TrialModel, ...] = tuple(in_parallel(model, [len(trial) for trial in trials]))
        recorded = [model.path(model.local[: len(model.states)], {}).signals for model in self.trials]
        shown = [dict(zip(model.outputs, model.y, strict=True)) for model in self.trials]
        self.motions = smoothed(mechanism, [model.t for model in self.trials], recorded, shown, self.sigmas)
        self.trials = tuple(model.begun(motion) for model, motion in zip(self.trials, self.motions, strict=True))
        self.scales = Scales.of(mechanism, self.motions, self.fixed, names)
        self.bounded = frozenset(name for name, pair in (bounds or {}).items() if pair is not None)
        self.space = self._space(names, dict(bounds or {}), self.scales)
        self.names, low, high = self.space.names, self.space.low, self.space.high
        self.shapes = tuple(p.name for p in mechanism.parameters if p.name in self.names and p.hidden and p.scan)
        inside = np.clip([self.scales.start[n] for n in self.names], low, high).tolist()
        self.start = dict(zip(self.names, inside, strict=True))
        self.prior = Prior.of(self.space, self.start, self.fixed)
        self._calls: list[float] = []  # shares of the recording that were simulated

    def _space(self, names: Sequence[str], bounds: Mapping[str, Sequence[float] | None], scales: Scales) -> Space:
        whole = default_bounds(self.mechanism, scales, bounds)
        sizes = {par.name: scales.sizes.of(par) for par in self.mechanism.parameters if par.name in names}
        return Space.build(self.mechanism, names, whole, self.fixed, sizes)

    def varied(
        self,
        *,
        names: Sequence[str] | None = None,
        values: Mapping[str, float] | None = None,
        simulator: Simulator | None = None,
        limits: Mapping[str, tuple[float, float]] | None = None,
        sizes: Sizes | None = None,
        sigmas: Mapping[str, float] | None = None,
        trials: Sequence[TrialModel] | None = None,
        prior: bool = True,
        counted: bool = False,
    ) -> Problem:
        """A new problem over the same recording; what is not given stays as it is here.

        Args:
            names: free parameters; the others are held.
            values: name -> where a parameter starts or is held, SI units: no range is searched for its start.
            simulator: of the mechanism to fit: this one, with other effects.
            limits: name -> bounds, SI units; others keep theirs, or have those that the values suggest.
            sizes: how large parameters are, where the mechanism has others.
            sigmas: signal -> noise standard deviation that is known, SI units; other levels stay and are estimated.
            trials: models of the trials, where these have other unknowns.
            prior: whether what is known beforehand counts; once left out it stays so.
            counted: whether its simulations are counted as those of this one.

        Raises:
            UserError: names or bounds that do not fit the mechanism.
        """
        made, values = copy(self), dict(values or {})
        made._calls = self._calls if counted else []
        if simulator is not None:
            made.simulator, made.mechanism = simulator, simulator.mechanism
            made.trials = tuple(replace(model, simulator=simulator) for model in self.trials)
        made.trials = made.trials if trials is None else tuple(trials)
        if sigmas is not None:
            made.given, made.sigmas = dict(sigmas), self.sigmas | dict(sigmas)
        known, wanted = self.fixed | self.start | values, self.names if names is None else names
        made.start = {name: known[name] for name in wanted}
        made.fixed = {name: value for name, value in known.items() if name not in wanted}
        made.shapes = tuple(name for name in self.shapes if name in wanted and name not in values)
        made.scales = replace(self.scales, start=made.start, sizes=sizes or self.scales.sizes)
        made.space = made._space(wanted, self.space.bounds | dict(limits or {}), made.scales)
        made.names = made.space.names
        made.prior = Prior.of(made.space, self.prior.expected if prior else {}, made.fixed)
        return made

    @property
    def simulations(self) -> int:
        """How often the recording was simulated so far."""
        return round(sum(self._calls))  # appending is safe in threads

    @cached_property
    def resolutions(self) -> list[float]:
        """Resolutions in time at which the model is compared with the data, s, from the coarsest to the sample (0)."""
        times = np.concatenate([np.diff(motion.t[motion.edges]) for motion in self.motions])
        coarsest = COARSE_SHARE * float(np.median(times))
        count = 1 + int(np.log(max(coarsest / self.interval, 1.0)) / np.log(REFINEMENT))
        return [*(coarsest / REFINEMENT**k for k in range(count)), 0.0]

    @property
    def interval(self) -> float:
        """Usual time between two samples, s, of the trial that was sampled fastest."""
        return min(float(np.median(np.diff(model.t))) for model in self.trials)

    # the model's distance from the data -----------------------------------------------------------------------
    def values(self, u: np.ndarray) -> dict[str, float]:
        """All parameters by name, SI units, at the search vector u."""
        return self.fixed | self.space.named(u)

    def models_at(self, u: np.ndarray) -> tuple[TrialModel, ...]:
        """The trials with initial bristle forces that start in equilibrium at the search vector u.

        Raises:
            ContactLost, SimulationFailed: they cannot be simulated there.
        """
        return tuple(model.in_equilibrium(self.values(u)) for model in self.trials)

    def evaluator(
        self,
        models: Sequence[TrialModel],
        sigmas: Mapping[str, float] | None = None,
        *,
        prior: bool = True,
        width: float | Sequence[float] = 0.0,
        steps: float = np.inf,
        **options: Any,
    ) -> Evaluate:
        """The cost of these trials as a search calls it: evaluate(u, locals, derivatives, ran, beside, width, ...).

        That is the state at a search vector u, shape (n,), and the unknowns of every trial, with ``derivatives`` if
        wanted; None where a trial cannot be simulated. Where ``ran``, the state there from ``strict`` simulations, is
        given, nothing is simulated again; nor are trials whose unknowns are those of ``beside``, a state at the same u.

        Args:
            models: of the trials.
            sigmas: signal -> noise standard deviation, SI units; by default the problem's.
            prior: whether the prior is counted; without it the cost is that of the data alone.
            width: resolution in time at which model and data are compared, s, of all trials or of each; 0: sample by
                sample.
            steps: of the integrator, all trials together, after which nothing is simulated any longer; those of this
                evaluator are counted, which then is for one search.
            options: of the simulator.
        """
        sigmas, spent = sigmas or self.sigmas, 0

        def evaluate(u, locals_, derivatives, *, ran=None, beside=None, width=width, **more) -> State | None:
            nonlocal spent
            if spent > steps:
                return None
            p, change, names = self.values(u), self.space.jacobian(u), self.names if derivatives else ()
            widths, own, taken = np.broadcast_to(width, len(models)), options | more, [0] * len(models)
            runs = [part.run for part in ran.pieces] if ran else [None] * len(models)
            kept = {k: part for k, part in enumerate(beside.pieces if beside else ()) if locals_[k] is beside.locals[k]}
            if not derivatives or any(run is None for run in runs):
                self._calls.append((len(models) - len(kept)) / len(self.trials))

            def piece(k: int) -> Piece | None:
                loss = self.coarse_loss if widths[k] else self.loss
                try:
                    found = models[k].evaluate(p, locals_[k], sigmas, loss, names, runs[k], widths[k], **own)
                except (ContactLost, SimulationFailed) as failure:
                    taken[k] = failure.steps
                    return None
                taken[k] = found.steps
                if not names:
                    return found
                gg, gl, grad_g = change.T @ found.gg @ change, change.T @ found.gl, change.T @ found.grad_g
                return replace(found, gg=gg, gl=gl, grad_g=grad_g)

            loads = [len(m.t) * (8 + len(x)) for m, x in zip(models, locals_, strict=True)]
            found = in_parallel(lambda k: kept.get(k) or piece(k), loads)
            spent += sum(taken)
            pieces = tuple(part for part in found if part is not None)
            if len(pieces) < len(models) or not all(np.isfinite(part.cost) for part in pieces):
                return None
            if prior and len(self.prior.target) and 0 not in kept:  # counted with the first trial
                part, known, r = pieces[0], self.prior, self.prior.distance(u)
                part = replace(part, cost=part.cost + 0.5 * float(r @ r))
                if names:
                    part = replace(part, gg=part.gg + known.information, grad_g=part.grad_g + known.rows.T @ r)
                pieces = (part, *pieces[1:])
            return State(np.asarray(u, float), tuple(locals_), pieces)

        return evaluate

    def apart(
        self, models: Sequence[TrialModel], sigmas: Mapping[str, float] | None = None, **options: Any
    ) -> list[Evaluate]:
        """The cost of every trial by itself, of the data alone, see :meth:`evaluator`: at given parameters, where
        trials have nothing in common."""
        return [self.evaluator([model], sigmas, prior=False, **options) for model in models]
