"""The declared model and every candidate effect in one compiled mechanism, fitted with whatever is switched on."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from ..data.recording import Recording
from ..identify.likelihood import maximum_likelihood
from ..identify.problem import Problem
from ..identify.solve import KNOWN, Evaluate, Solution, cycled, levenberg_marquardt, moved, reduced
from ..identify.trial import TrialModel
from ..numerics.parallel import in_parallel
from ..numerics.simulate import Simulation, Simulator
from ..physics.mechanism import Mechanism
from ..physics.sizes import Sizes
from .declared import fit_declared
from .fit import Fit
from .parts import Parts
from .restarts import peaked

LONGEST = 150.0  # times the steps that simulate all trials once: a refit that takes more is given up
WEIGHED = 0.1  # relative change of the noise levels below which a search at others still counts
RELAXED = 1e3  # factor by which viscous friction may fall below the bounds of the declared model
SHORT = 12  # iterations of a try that may be given up
NEAR = 50.0  # log-likelihood: behind what is to be beaten by more it is
REFIT: dict[str, Any] = {"iterations": 40, "decrease": 0.05}


class Bench:
    """Fits of one mechanism with any of its effects to some trials; others are kept to check them on.

    Args:
        mechanism: as declared.
        tested: the same with every candidate effect.
        probed: that with forces that depend on a variable in any way, for a look at what remains.
        fitted: trials to fit.
        held_out: trials that no fit sees; may have none.
        options: of :class:`Problem`.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        tested: Mechanism,
        probed: Mechanism,
        fitted: Recording,
        held_out: Recording,
        start: Mapping[str, float] | None = None,
        **options: Any,
    ):
        self.mechanism, self.tested = mechanism, tested
        self.problem, self.estimate, options = fit_declared(mechanism, fitted, start, options)
        self.parts, self.probe = Parts(mechanism, tested), Simulator(probed)
        self.simulator = self.parts.whole
        self.defaults = {par.name: par.value for par in tested.parameters} | tested.system.values
        self.declared = tuple(self.problem.names)
        self.held_out = held_out
        self.options = options
        self.judged: dict[tuple, Any] = {}  # what the held-out trials said of fits

    @cached_property
    def sizes(self) -> Sizes:
        """How large the effects' parameters are on this data."""
        runs = self.simulate(self.base())
        force = float(np.sqrt(np.mean(np.concatenate([run.F for run in runs]) ** 2)))
        return replace(self.problem.scales.sizes, force=force)

    @cached_property
    def usual_steps(self) -> int:
        """Steps of the integrator that simulate all trials once, at the declared model's fit."""
        return sum(len(run.steps.interval) for run in self.simulate(self.base()))

    @cached_property
    def checked(self) -> Problem | None:
        """The problem of the held-out trials; None where there are none."""
        if not self.held_out.trials:
            return None
        return Problem(self.mechanism, self.held_out, **(self.options | {"sigmas": self.estimate.sigmas}))

    # fits ----------------------------------------------------------------------------------------------------
    def base(self) -> Fit:
        """The declared model as fitted, on the mechanism that holds the effects at their neutral values."""
        assert self.estimate.minimum is not None
        state, before = self.estimate.minimum.state, self.estimate.minimum.models
        values = self._complete(self.problem.values(state.u))
        models = self.equipped(before, self.parts.of(self.declared, values))
        locals_ = tuple(_longer(x, old, new) for x, old, new in zip(state.locals, before, models, strict=True))
        return Fit(self.declared, values, models, replace(state, locals=locals_), dict(self.estimate.sigmas))

    def equipped(self, models: Sequence[TrialModel], simulator: Simulator) -> tuple[TrialModel, ...]:
        """Models on a mechanism with effects; where one brings a bristle, its initial state is unknown as well."""
        if self.mechanism.memory or not self.tested.memory:
            return tuple(replace(model, simulator=simulator) for model in models)
        stroke = self.problem.scales.sizes.scales["stroke"][1]
        return tuple(
            replace(model, simulator=simulator, states=(*model.states, "z"), start=model.start | {"z": 0.0},
                    force_scale=0.25 * stroke)
            for model in models
        )  # fmt: skip

    def _complete(self, values: Mapping[str, float]) -> dict[str, float]:
        return {k: float(v) for k, v in (self.defaults | dict(values)).items() if v is not None}

    def problem_of(
        self,
        problem: Problem,
        names: Sequence[str],
        values: Mapping[str, float],
        simulator: Simulator,
        limits: Mapping[str, tuple[float, float]] | None = None,
    ) -> Problem:
        """The problem with these parameters free, the others held at their values."""
        wider: dict[str, tuple[float, float]] = {}
        if "sigma_2" in problem.names:  # viscous friction absorbs much of what is missing: it must be free to go
            low, high = problem.space.bounds["sigma_2"]
            wider["sigma_2"] = (low / RELAXED, high)
        return problem.varied(
            names=names, values=values, simulator=simulator, limits=wider | dict(limits or {}), sizes=self.sizes
        )

    @cached_property
    def starts(self) -> list[dict[str, float]]:
        """Parameters of the declared model from short windows, where what is missing does not add up: best first."""
        return [
            dict(zip(self.declared, self.problem.space.to_values(s.state.u).tolist(), strict=True))
            for s in (self.estimate.minimum.starts[:1] if self.estimate.minimum else ())
        ]

    def refit(
        self,
        fit: Fit,
        names: Sequence[str],
        values: Mapping[str, float],
        sigmas: Mapping[str, float] | None = None,
        limits: Mapping[str, tuple[float, float]] | None = None,
        **options: Any,
    ) -> Fit | None:
        """Estimate ``names`` anew from these values and the fit's unknowns of the trials; None where that fails.

        ``options`` are those of :func:`levenberg_marquardt`.
        """
        values, sigmas = self._complete(values), dict(sigmas or fit.sigmas)
        probing = fit.models[0].simulator is self.probe
        simulator = self.probe if probing else self.parts.of(names, values)
        models = tuple(replace(model, simulator=simulator) for model in fit.models)
        problem = self.problem_of(self.problem, names, values, simulator, limits)
        evaluate = self._evaluator(problem, models, sigmas)
        first = evaluate(problem.space.to_search(np.array([values[name] for name in problem.names])), fit.locals, True)
        if first is None:
            return None
        try:
            found = levenberg_marquardt(evaluate, first, problem.space.limits, **(REFIT | options))
        except np.linalg.LinAlgError:  # derivatives that overflow
            return None
        return Fit(problem.names, problem.values(found.state.u), models, found.state, sigmas)

    def settle(self, fit: Fit, bent: Callable[[Fit, Fit], bool] = lambda old, new: False) -> Fit:
        """The lowest minimum that a search from all starts finds, at the noise that the fit's residuals show.

        The fit stays in its own where ``bent`` says of that and the lowest that the latter is not to be had.
        """
        sigmas = fit.levels(self.problem.loss)
        new = self.refit(fit, fit.names, fit.values, sigmas)
        found: Fit | None
        if new is None:
            new, found = fit, self._anew(fit, True)
        elif fit.searched and max(abs(np.log(sigmas[name] / fit.sigmas[name])) for name in sigmas) < WEIGHED:
            found = replace(new, minima=fit.minima, searched=True) if fit.minima else self._around(new)
        else:
            found = self._anew(new, True, fit.starts)
        if found is None or found.state.cost > new.state.cost or (found.state is not new.state and bent(new, found)):
            return replace(new, searched=True, starts=fit.starts)
        return found

    def without(self, fit: Fit, gone: Sequence[str], held: Sequence[str] = ()) -> Fit:
        """The fit with strengths ``gone`` at zero and all else but ``held`` where the quadratic model has its minimum.

        With information S and the step d_1 of what goes, the others move by d_2 = -S_22^-1 S_21 d_1.
        """
        if not fit.state.curved:
            return replace(fit, values=fit.values | dict.fromkeys(gone, 0.0))
        space = self.problem_of(self.problem, fit.names, fit.values, fit.models[0].simulator).space
        out = np.array([name in gone or name in held for name in fit.names])
        step = np.where([name in gone for name in fit.names], -fit.state.u, 0.0)  # zero is zero in the search as well
        S = reduced(fit.state)[0]
        step[~out] = -np.linalg.lstsq(S[np.ix_(~out, ~out)], S[np.ix_(~out, out)] @ step[out], rcond=1e-12)[0]
        u, locals_ = moved(fit.state, step, space.limits)
        values = fit.values | dict(zip(fit.names, space.to_values(u).tolist(), strict=True)) | dict.fromkeys(gone, 0.0)
        return replace(fit, values=values, state=replace(fit.state, locals=tuple(locals_)))

    def _evaluator(self, problem: Problem, models: Sequence[TrialModel], sigmas: Mapping[str, float]) -> Evaluate:
        # A shape that makes the equations so stiff is no candidate.
        return problem.evaluator(models, sigmas, steps=LONGEST * self.usual_steps)

    def clip(self, values: Mapping[str, float]) -> dict[str, float]:
        """Values moved inside the physical limits of their parameters."""
        limits = {par.name: (par.low, par.high) for par in self.tested.parameters}
        return {name: min(max(value, limits[name][0]), limits[name][1]) for name, value in values.items()}

    def search(self, fit: Fit, starts: Sequence[Solution] = ()) -> Fit:
        """The fit or, where a search from all starts finds it, a better one.

        Of a fit that such a search led to, only a static friction that vanished is brought back. ``starts`` are those
        of a search at other noise levels.
        """
        anew = None if fit.searched else self._anew(fit, fit.explains, starts)
        if anew is not None and anew.state.cost < fit.state.cost and anew.explains and not fit.explains:
            return anew  # out of the wrong minimum
        back = peaked(self.problem, fit.values)
        near = fit.state.cost + NEAR
        found = in_parallel(lambda k: tried(self, fit, fit.names, back[k], near), [1.0] * len(back))
        lower = [f for f in (anew, *found) if f is not None and f.state.cost < fit.state.cost]
        if lower:
            return min(lower, key=lambda f: f.state.cost)
        return replace(fit, searched=True, starts=fit.starts if anew is None else anew.starts)

    def _around(self, fit: Fit) -> Fit:
        """The lowest minimum that restarts around the fit find."""
        problem = self.problem_of(self.problem, fit.names, fit.values, fit.models[0].simulator)
        evaluate = self._evaluator(problem, fit.models, fit.sigmas)
        found, limits = Solution(fit.state, KNOWN), problem.space.limits
        minima = cycled(evaluate, found, limits, self.problem.resolutions)
        state = minima[0].state
        return replace(fit, values=problem.values(state.u), state=state, minima=tuple(minima), searched=True)

    def _anew(self, fit: Fit, thorough: bool, starts: Sequence[Solution] = ()) -> Fit | None:
        """A search from all starts, given or of short windows, and if ``thorough`` around the lowest that it finds."""
        simulator = self.parts.of(fit.names, fit.values)
        problem = self.problem_of(self.problem, fit.names, fit.values, simulator)
        problem = problem.varied(trials=self.equipped(self.problem.trials, simulator), sigmas=fit.sigmas)
        known = (Solution(fit.state, KNOWN), fit.models) if fit.state.curved else None
        estimate = maximum_likelihood(problem, start=problem.start, known=known, starts=starts, thorough=thorough)
        if (minimum := estimate.minimum) is None:
            return None
        values = problem.values(minimum.state.u)
        found = Fit(problem.names, values, minimum.models, minimum.state, dict(fit.sigmas))
        minima = minimum.minima if thorough else ()
        return replace(found, minima=minima, searched=True, starts=minimum.starts)

    def simulate(self, fit: Fit, strict: bool = False) -> list[Simulation]:
        """Every trial at the fit; ``strict`` with every candidate, where sensitivities to any are to be added."""

        def work(k: int) -> Simulation:
            model = replace(fit.models[k], simulator=self.simulator) if strict else fit.models[k]
            return model.simulate(fit.values, fit.locals[k], strict=strict)

        return in_parallel(work, [len(model.t) for model in fit.models])


def tried(
    bench: Bench,
    fit: Fit,
    names: Sequence[str],
    values: Mapping[str, float],
    near: float,
    limits: Mapping[str, tuple[float, float]] | None = None,
) -> Fit | None:
    """Refit, given up after a short try that does not bring the cost below ``near``."""
    found = bench.refit(fit, names, values, limits=limits, iterations=SHORT)
    if found is None or found.state.cost > near:
        return found
    more = bench.refit(found, found.names, found.values, limits=limits)
    return found if more is None else more


def _longer(local: np.ndarray, old: TrialModel, new: TrialModel) -> np.ndarray:
    """A trial's unknowns with those of the states that were added, at their start."""
    n = len(old.states)
    added = [new.start[name] for name in new.states[n:]]
    return np.concatenate([local[:n], added, local[n:]])
