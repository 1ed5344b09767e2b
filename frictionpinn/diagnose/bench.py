"""The declared model and every candidate effect in one compiled mechanism, fitted with whatever is switched on."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from threading import Lock
from typing import Any

import numpy as np

from ..data.recording import Recording
from ..errors import UserError
from ..identify.likelihood import lowest_around
from ..identify.problem import Problem
from ..identify.tether import regained, tethered
from ..identify.trial import TrialModel
from ..numerics.along import samples
from ..numerics.descent import ENDED, GIVEN, Solution, coarse_to_fine
from ..numerics.excess import rms
from ..numerics.minima import assembled, carried
from ..numerics.parallel import in_parallel
from ..numerics.quadratic import moved, reduced
from ..numerics.simulate import Part, Simulation, Simulator
from ..physics.base import plain_name
from ..physics.effect import Effect
from ..physics.mechanism import Mechanism
from ..physics.remainder import Remainder, places
from ..physics.sizes import Sizes
from .fit import Fit, fit_declared

LONGEST = 500.0  # times the steps that simulate all trials once: a budget, beyond which a refit is given up
BACK = 0.1  # of its start value: from where dry friction that vanished beside something missing is estimated anew


class Bench:
    """Fits of one mechanism with any of its effects to some trials; others are kept to check them on.

    Args:
        mechanism: as declared.
        effects: candidates, and what is declared.
        remainders: forces that depend on a variable in any way, for a look at what remains; may be none.
        fitted: trials to fit.
        held_out: trials that no fit sees; may have none.
        start: start values of parameters, SI units.
        options: of :class:`Problem`.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        effects: Sequence[Effect],
        remainders: Sequence[Remainder],
        fitted: Recording,
        held_out: Recording,
        start: Mapping[str, float] | None = None,
        **options: Any,
    ):
        declared = {e.name for e in mechanism.effects}
        every = (*mechanism.effects, *(e for e in effects if e.name not in declared))
        self.mechanism, self.tested = mechanism, Mechanism(mechanism.system, mechanism.law, every)
        self.problem, self.estimate, self.options = fit_declared(mechanism, fitted, start, options)
        self.simulator = Simulator(self.tested, as_shown=True)
        self.probe = Simulator(Mechanism(mechanism.system, mechanism.law, (*every, *remainders)), as_shown=True)
        self.remainders = {r.variable: r for r in remainders}
        self.defaults = {par.name: par.value for par in self.tested.parameters} | mechanism.system.values
        self.declared = tuple(self.problem.names)
        self.held_out = held_out
        self.widths = self.problem.resolutions
        self.judged: dict[Fit, Any] = {}  # what held-out trials say of fits
        self._made: dict[tuple[str, ...], Simulator] = {}
        self._making = Lock()

    @cached_property
    def sizes(self) -> Sizes:
        """How large the effects' parameters are on this data: friction forces as the declared model has them."""
        declared, contacts = self.problem.scales.sizes, self.runs[0].contacts
        forces = {name: rms([run.at(name).F for run in self.runs]) for name in contacts}
        return declared.with_forces({name: force or declared.at(f"{name}.").force for name, force in forces.items()})

    def forces(self, contact: str) -> np.ndarray:
        """Friction force at a contact, all trials together, shape (n,); where there is none a force of usual size."""
        force = np.concatenate([run.at(contact).F for run in self.runs])
        return force if force.any() else np.full_like(force, self.sizes.at(f"{contact}.").force)

    @cached_property
    def runs(self) -> list[Simulation]:
        """Every trial at the declared model's fit."""
        return self.simulate(self.base)

    @cached_property
    def covered(self) -> dict[str, np.ndarray]:
        """Samples of each remainder's variable, all trials together, shape (n,)."""
        at = self.mechanism.system.at
        return {name: np.concatenate([samples(at(r.contact), run, r.symbol) for run in self.runs])
                for name, r in self.remainders.items()}  # fmt: skip

    @cached_property
    def places(self) -> dict[str, float]:
        """Hidden parameters of the remainders, which spread their bumps over what is covered."""
        return {k: v for name, r in self.remainders.items() for k, v in places(r, self.covered[name]).items()}

    @cached_property
    def checked(self) -> Problem | None:
        """The problem of the held-out trials; None where there are none."""
        if not self.held_out.trials:
            return None
        return Problem(self.mechanism, self.held_out, **(self.options | {"sigmas": self.estimate.sigmas}))

    @property
    def from_coarse(self) -> list[float]:
        """A quarter of the coarsest resolution at which a fit begins, s, then the sample; only that without any."""
        return [*self.widths[min(2, len(self.widths) - 1) : -1][:1], 0.0]

    # simulators ----------------------------------------------------------------------------------------------
    def part(self, names: Iterable[str], values: Mapping[str, float]) -> Simulator:
        """The declared mechanism with only the effects that these free parameters, or the others' values, switch on:
        what is switched off costs time too. Compiled on first use.

        Those that bring a bristle are part of all: with one a trial has one unknown more. The whole mechanism where an
        effect cannot act without others that are switched off.
        """
        free, declared, tested = set(names), {e.name for e in self.mechanism.effects}, self.tested
        effects = tuple(e for e in tested.effects if e.name in declared or e.memory or tested.acts(e, values, free))
        key = tuple(e.name for e in effects)
        with self._making:
            if key not in self._made:
                try:
                    self._made[key] = Part(Mechanism(tested.system, tested.law, effects), as_shown=True)
                except UserError:
                    self._made[key] = self.simulator
            return self._made[key]

    def equipped(self, models: Sequence[TrialModel], simulator: Simulator) -> tuple[TrialModel, ...]:
        """Models on a mechanism with effects; where one brings a bristle, its initial state is unknown as well."""
        declared = {contact.z.name for contact in self.mechanism.bristles}
        strokes = {z: self.problem.scales.sizes.at(z).scales["stroke"][1]
                   for z in (contact.z.name for contact in self.tested.bristles) if z not in declared}  # fmt: skip
        return tuple(
            replace(model, simulator=simulator, states=(*model.states, *strokes),
                    start=model.start | dict.fromkeys(strokes, 0.0),
                    force_scales={**model.force_scales, **{z: 0.25 * stroke for z, stroke in strokes.items()}})
            for model in models
        )  # fmt: skip

    # fits ----------------------------------------------------------------------------------------------------
    @cached_property
    def base(self) -> Fit:
        """The declared model as fitted, on the mechanism that holds the effects at their neutral values."""
        minimum = self.estimate.minimum
        assert minimum is not None
        values = self._complete(self.problem.values(minimum.state.u))
        models = self.equipped(minimum.models, self.part(self.declared, values))
        locals_ = tuple(
            np.concatenate([x[: len(old.states)], [new.start[n] for n in new.states[len(old.states) :]],
                            x[len(old.states) :]])
            for x, old, new in zip(minimum.state.locals, minimum.models, models, strict=True)
        )  # fmt: skip
        return Fit(self.declared, values, models, replace(minimum.state, locals=locals_), dict(self.estimate.sigmas),
                   span=self.widths[0])  # fmt: skip

    def _complete(self, values: Mapping[str, float]) -> dict[str, float]:
        return {k: float(v) for k, v in (self.defaults | dict(values)).items() if v is not None}

    def problem_of(
        self,
        problem: Problem,
        names: Sequence[str],
        values: Mapping[str, float],
        simulator: Simulator,
    ) -> Problem:
        """The problem with these parameters free, the others held at their values."""
        # Viscous friction absorbs much of what is missing: it must be free to go.
        viscous = [name for name in problem.names if plain_name(name) == "sigma_2"]
        wider = {name: (0.0, problem.space.bounds[name][1]) for name in viscous}
        trials = self.equipped(problem.trials, simulator)
        return problem.varied(names=names, values=values, simulator=simulator, limits=wider, sizes=self.sizes,
                              trials=trials)  # fmt: skip

    def refit(
        self,
        fit: Fit,
        names: Sequence[str],
        values: Mapping[str, float],
        *,
        sigmas: Mapping[str, float] | None = None,
        widths: Sequence[float] = (0.0,),
        around: bool = False,
        imitating: Fit | None = None,
    ) -> Fit | None:
        """Estimate ``names`` anew from these values and the fit's unknowns of the trials; None where that fails.

        Args:
            fit: where the trials' unknowns start.
            names: free parameters.
            values: of all parameters, SI units.
            sigmas: noise levels; by default the fit's.
            widths: resolutions in time that are followed, s, the coarsest first.
            around: look for lower minima around it.
            imitating: a fit whose motion stands for what was measured, without noise.
        """
        values, sigmas = self._complete(values), dict(sigmas or fit.sigmas)
        for name in {*names} & {*self.problem.names}:
            if plain_name(name) == "mu_c":
                values[name] = max(values[name], BACK * self.problem.start[name])
        simulator = self.probe if fit.models[0].simulator is self.probe else self.part(names, values)
        models = tuple(replace(model, simulator=simulator) for model in fit.models)
        problem = self.problem_of(self.problem, names, values, simulator)
        seen = models if imitating is None else self._simulated(imitating, models)
        steps = LONGEST * sum(len(run.steps.interval) for run in self.runs)
        evaluate = problem.evaluator(seen, sigmas, steps=steps)
        try:
            first = replace(fit.state, u=problem.space.to_search(values))
            found = coarse_to_fine(evaluate, first, problem.space.limits, widths)
            if found is None:
                return None
            if around:
                found = lowest_around(problem, evaluate, problem.apart(seen, sigmas, steps=steps), found)
        except np.linalg.LinAlgError:  # derivatives that overflow
            return None
        state, ended = found.state, found.reason == ENDED
        return Fit(problem.names, problem.values(state.u), models, state, sigmas, widths[-1], fit.span, ended)

    def imitated(self, fit: Fit, names: Sequence[str], values: Mapping[str, float]) -> Fit | None:
        """``names`` estimated from near these values, where the motion is nearest to that of a fit.

        First what the fit simulates stands for what was measured: without noise the likelihood is smooth, and has its
        minimum where the same motion has these parameters. From there the data are fitted.
        """
        values = self.clip(self._complete(values))
        there = self.refit(self._followed(fit, names, values), names, values, imitating=fit)
        return None if there is None else self.refit(there, names, there.values)

    def _followed(self, fit: Fit, names: Sequence[str], values: Mapping[str, float]) -> Fit:
        """The fit with each trial's own unknowns such that its motion at other values is near to its own.

        The nearer of two. It begins as it did, bristles as far bent: so do mechanisms that move alike. Or as the
        quadratic model says: a coupling begins strained where a force goes from one of its masses to the other.
        """
        wider = tuple(dict.fromkeys((*fit.names, *names)))
        new = {par.name for par in self.tested.parameters if par.hidden and par.name in names} - {*fit.names}
        at = self._complete(fit.values | {name: values[name] for name in new})
        simulator = self.part(wider, at)
        models = self._simulated(fit, [replace(model, simulator=simulator) for model in fit.models])
        problem = self.problem_of(self.problem, wider, at, simulator)
        evaluate, u, there = problem.evaluator(models, fit.sigmas), *map(problem.space.to_search, (at, values))
        starts = [[model.bent(local, at, values) for model, local in zip(models, fit.locals, strict=True)]]
        try:
            if (state := evaluate(u, fit.locals, True)) is not None:
                starts.append(moved(state, there - u, problem.space.limits, longest=np.inf)[1])
        except np.linalg.LinAlgError:  # derivatives that overflow
            return fit
        near = [state for own in starts if (state := evaluate(there, own, False)) is not None]
        return replace(fit, state=replace(fit.state, locals=min(near, key=lambda s: s.cost).locals)) if near else fit

    def regained(self, fit: Fit) -> Fit:
        """The fit, or the lower one in which no trial lags behind the others, see
        :func:`frictionpinn.identify.tether.regained`."""
        problem = self.problem_of(self.problem, fit.names, fit.values, fit.models[0].simulator)
        held = tethered(problem)
        try:
            found = None if held is None else regained(problem, held, fit.sigmas, (fit.state, fit.models))
        except np.linalg.LinAlgError:  # derivatives that overflow
            return fit
        if found is None:
            return fit
        state = found.state
        return replace(fit, values=problem.values(state.u), state=state, ended=found.reason == ENDED)

    def together(self, fits: Iterable[Fit]) -> Fit:
        """The lowest of fits of the same parameters, or the lower one that begins with each trial's own unknowns from
        the fit that fits that trial best."""
        best, *others = sorted(fits, key=lambda fit: fit.cost)
        if not others:
            return best
        problem = self.problem_of(self.problem, best.names, best.values, best.models[0].simulator)
        evaluate, bounds = problem.evaluator(best.models, best.sigmas), problem.space.limits
        offered = carried([fit.state for fit in others], best.state.u, bounds)
        state = assembled(evaluate, Solution(best.state, GIVEN), offered, bounds).state
        return best if state is best.state else replace(best, values=problem.values(state.u), state=state)

    def _simulated(self, fit: Fit, models: Sequence[TrialModel]) -> tuple[TrialModel, ...]:
        """The models with what the fit says of every signal in the place of what was measured."""

        def says(k: int) -> TrialModel:
            own, model, local = fit.models[k], models[k], fit.locals[k]
            p, joint = fit.values, self.problem.joint
            y = np.where(np.isnan(model.y), np.nan, own.predict(own.simulate(p, local)))
            inputs = tuple(
                replace(item, y=np.where(np.isnan(item.y), np.nan, own.shown(item, values, p, (), joint)[0]))
                for item, values in zip(model.inputs, own.coefficients(local), strict=True)
            )
            return replace(model, y=y, inputs=inputs)

        return tuple(in_parallel(says, [len(model.t) for model in models]))

    def settle(self, fit: Fit) -> Fit:
        """The fit at the noise levels that its residuals show, and the lowest of the minima around it."""
        sigmas = fit.levels(self.problem.loss)
        found = self.refit(fit, fit.names, fit.values, sigmas=sigmas, around=True)
        return found or fit

    def without(self, fit: Fit, gone: Sequence[str], held: Sequence[str] = ()) -> dict[str, float]:
        """Values with strengths ``gone`` at zero and all else but ``held`` where the quadratic model has its minimum.

        With information S and the step d_1 of what goes, the others move by d_2 = -S_22^-1 S_21 d_1.
        """
        space = self.problem_of(self.problem, fit.names, fit.values, fit.models[0].simulator).space
        out = np.array([name in gone or name in held for name in fit.names])
        step = np.where([name in gone for name in fit.names], -fit.state.u, 0.0)  # zero is zero in the search as well
        S = reduced(fit.state)[0]
        step[~out] = -np.linalg.lstsq(S[np.ix_(~out, ~out)], S[np.ix_(~out, out)] @ step[out], rcond=1e-12)[0]
        u = np.clip(fit.state.u + step, *space.limits)
        return fit.values | dict(zip(fit.names, space.to_values(u).tolist(), strict=True)) | dict.fromkeys(gone, 0.0)

    def clip(self, values: Mapping[str, float]) -> dict[str, float]:
        """Values moved inside the physical limits of their parameters."""
        limits = {par.name: (par.low, par.high) for par in self.tested.parameters}
        return {name: min(max(value, limits[name][0]), limits[name][1]) for name, value in values.items()}

    def simulate(self, fit: Fit, strict: bool = False) -> list[Simulation]:
        """Every trial at the fit; ``strict`` with every candidate, where sensitivities to any are to be added."""

        def work(k: int) -> Simulation:
            model = replace(fit.models[k], simulator=self.simulator) if strict else fit.models[k]
            return model.simulate(fit.values, fit.locals[k], strict=strict)

        return in_parallel(work, [len(model.t) for model in fit.models])
