"""One trial, or one window of it: what was measured, what is unknown there, and the model's distance from it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np

from ..numerics.directions import Directions
from ..numerics.gram import gram
from ..numerics.jumps import jumps_in
from ..numerics.loss import Loss
from ..numerics.motion import Motion
from ..numerics.paths import InputPath
from ..numerics.placing import unplaced
from ..numerics.quadratic import Piece
from ..numerics.resolution import averaged, samples_within
from ..numerics.simulate import Simulation, Simulator
from ..numerics.spline_basis import NoisyInput
from ..physics.base import beside, contact_of

RELATIVE_FLOOR = 1e-12  # of the largest diagonal entry: keeps what no signal sees from making a matrix singular
REACH = 2.0  # times the largest friction force: how far from zero the initial bristle force may be


@dataclass(frozen=True)
class TrialModel:
    """The unknowns of a trial are its initial states, then the coefficients of its noisy inputs.

    Attributes:
        simulator: of the mechanism.
        trial: name of the trial (and window).
        t: times, s, shape (n,).
        outputs: measured signals that the model predicts.
        y: measured outputs, shape (n_out, n), NaN where missing.
        base: input path without the noisy inputs.
        inputs: noisy inputs.
        states: initial states that are unknown, of ``simulator.state_names``.
        start: start values of all states (a bristle state z as the force sigma_0 z where there is a sigma_0), by name;
            without it: steady.
        force_scales: prior standard deviation of each initial bristle force (or of z itself), by the state's name.
        own: values of parameters that are this trial's alone, SI units.
        directions: derivatives of the input path in the inputs' coefficients; made here.
    """

    simulator: Simulator
    trial: str
    t: np.ndarray
    outputs: tuple[str, ...]
    y: np.ndarray
    base: InputPath
    inputs: tuple[NoisyInput, ...]
    states: tuple[str, ...]
    start: dict[str, float]
    force_scales: Mapping[str, float] = field(default_factory=dict)
    own: Mapping[str, float] = field(default_factory=dict)
    directions: Directions | None = None

    def __post_init__(self) -> None:
        if self.inputs and self.directions is None:
            splines = [(item.names[0], item.columns, item.basis) for item in self.inputs]
            object.__setattr__(self, "directions", Directions.of_splines(self.t, len(self.base.names), splines))

    def begun(self, motion: Motion) -> TrialModel:
        """The model that begins where this motion does, as far as its position acts and was not measured."""
        recorded = {name for name, y in zip(self.outputs, self.y, strict=True) if np.isfinite(y).any()}
        lost = [c.signals[0] for c in unplaced(self.simulator.mechanism.system, recorded)]
        return replace(self, start=self.start | {name: float(motion.signals[name][0]) for name in lost})

    @property
    def bristles(self) -> list[tuple[str, str]]:
        """Bristle states and, beside each, the name of its stiffness: (z, sigma_0), (hinge.z, hinge.sigma_0)."""
        return [(name, beside(name, "sigma_0")) for name in self.simulator.bristles]

    def size(self, joint: bool) -> int:
        """Number of local unknowns, with or without the inputs' coefficients."""
        return len(self.states) + (sum(item.basis.size for item in self.inputs) if joint else 0)

    @property
    def local(self) -> np.ndarray:
        """Start of the local unknowns, the inputs' coefficients included."""
        states = [self.start[name] for name in self.states]
        return np.concatenate([states, *(item.coefficients for item in self.inputs)])

    def coefficients(self, local: np.ndarray) -> list[np.ndarray]:
        """Coefficients of every noisy input: those among the local unknowns, or as fitted to the inputs alone."""
        ends = np.cumsum([len(self.states), *(item.basis.size for item in self.inputs)])
        if len(local) == len(self.states):
            return [item.coefficients for item in self.inputs]
        return [local[first:end] for first, end in pairwise(ends)]

    def path(self, local: np.ndarray, p: Mapping[str, float]) -> InputPath:
        """Input path at the local unknowns, as sensors show it; of inputs among these, the truth is the spline."""
        if not self.inputs:
            return self.base
        coefficients, joint = self.base.coefficients.copy(), len(local) > len(self.states)
        for item, values in zip(self.inputs, self.coefficients(local), strict=True):
            coefficients[:, list(item.columns)] = item.basis.path(values)
        path = self.base.through(coefficients)
        return self.simulator.imposed(path, p, self.sensed) if joint else path

    @property
    def sensed(self) -> tuple[str, ...]:
        """Noisy inputs whose sensors effects change."""
        names = (name for item in self.inputs for name in item.names)
        return tuple(name for name in names if name in self.simulator.motion_sensors.parameters)

    def shown(
        self, item: NoisyInput, values: np.ndarray, p: Mapping[str, float], names: Sequence[str], joint: bool
    ) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
        """What sensors show of a noisy input; its spline is the truth where it is among the unknowns (``joint``).

        Returns:
            signals, shape (orders, n); their derivatives, shape (orders, n, size + own), in its coefficients ``values``
            and in those of the parameters ``names`` that its sensors have; and these.
        """
        truth, design, sensors = item.basis.values(values), item.basis.design, self.simulator.motion_sensors
        if not (joint and sensors.of(item.names)):
            return truth, design, ()
        vector, own = self.simulator.parameters(p), tuple(n for n in sensors.of(item.names) if n in names)
        factors, offsets = sensors.lines(item.names, vector).T[:, :, None]
        changes = sensors.derivatives(dict(zip(item.names, truth, strict=True)), vector, own)
        return factors * truth + offsets, np.dstack([factors[:, :, None] * design, changes]), own

    def _moves(self, p: Mapping[str, float]) -> Directions | None:
        """Derivatives of the path, as sensors show it, in the inputs' coefficients."""
        if self.directions is None or not self.sensed:
            return self.directions
        factors = np.ones(len(self.base.names))
        places = [self.base.names.index(name) for name in self.sensed]
        factors[places] = self.simulator.motion_sensors.lines(self.sensed, self.simulator.parameters(p))[:, 0]
        return self.directions.scaled(factors)

    def initial(self, p: Mapping[str, float], local: np.ndarray) -> dict[str, float]:
        """Initial state by name, SI units."""
        y0 = dict(self.start)
        y0.update(zip(self.states, local, strict=False))
        for z, stiffness in self.bristles:
            if z in y0 and stiffness in p:
                y0[z] /= p[stiffness]
        return y0

    def bent(self, local: np.ndarray, p: Mapping[str, float], new: Mapping[str, float]) -> np.ndarray:
        """The local unknowns with which bristles are as far bent at the parameters ``new`` as they were at p."""
        local = np.array(local, dtype=float)
        for z, stiffness in self.bristles:
            if z in self.states and stiffness in p:
                local[self.states.index(z)] *= new[stiffness] / p[stiffness]
        return local

    def in_equilibrium(self, p: Mapping[str, float]) -> TrialModel:
        """The model whose initial bristle force, if it is unknown, starts in equilibrium at the parameters p, SI units.

        Raises:
            ContactLost, SimulationFailed: the model cannot be simulated there.
        """
        sought = [(z, stiffness) for z, stiffness in self.bristles if z in self.states]
        if not sought:
            return self
        start = {name: value for name, value in self.start.items() if name not in dict(sought)}
        steady = replace(self, states=(), start=start, inputs=(), base=self.path(self.local, p), directions=None)
        run = steady.simulate(p, np.zeros(0))
        begun, scales = dict(self.start), dict(self.force_scales)
        for name, stiffness in sought:
            there = run.at(contact_of(name))
            begun[name], largest = float(there.z[0]), float(np.abs(there.z).max())
            if stiffness in p:
                begun[name], largest = begun[name] * p[stiffness], float(np.abs(there.F).max())
            scales[name] = REACH * largest or 1.0
        return replace(self, start=begun, force_scales=scales)

    def simulate(
        self,
        p: Mapping[str, float],
        local: np.ndarray,
        names: Sequence[str] = (),
        joint: bool = False,
        ran: Simulation | None = None,
        **options: Any,
    ) -> Simulation:
        """Simulate at the parameters and local unknowns, with sensitivities of what is measured if ``names`` are given.

        ``ran`` is a strict simulation there, to which they are added; ``options`` are those of the simulator.
        """
        wanted = [*names, *(f"{state}(0)" for state in self.states)] if names else []
        directions: Any = (self._moves(p) if names and joint else None) or {}
        path, y0 = self.path(local, p), self.initial(p, local)
        if ran is not None and names:
            steady = [z for z in self.simulator.bristles if z not in y0]
            changes = self.simulator.differentiate(ran, path, p, wanted, directions, steady=steady, contact=False)
            return replace(ran, sensitivity_names=(*wanted, *directions), sensitivities=changes)
        return self.simulator.simulate(
            self.t, path, p, y0, z0="steady", sensitivities=wanted, directions=directions, contact=False, **options
        )

    def predict(self, run: Simulation) -> np.ndarray:
        """What a simulation says of the measured outputs, shape (n_out, n), SI units."""
        return np.stack([run.signals[name] for name in self.outputs])

    def derivatives(
        self, run: Simulation, p: Mapping[str, float], names: Sequence[str], joint: bool = False
    ) -> np.ndarray:
        """Derivatives of the outputs in the parameters ``names``, then in the local unknowns, (n_out, n, n_d).

        The motion that drives is the true one where it is among the unknowns (``joint``), whatever its sensors show.
        """
        J = np.ascontiguousarray(np.stack([run.sensitivities[name] for name in self.outputs]))
        own = self.simulator.motion_sensors.of(self.sensed) if joint else ()
        J[:, :, [k for k, name in enumerate(names) if name in own]] = 0.0
        for z, stiffness in self.bristles:
            if z not in self.states or stiffness not in p:
                continue
            column = len(names) + self.states.index(z)  # the unknown is the force sigma_0 z
            if stiffness in names:
                J[:, :, list(names).index(stiffness)] -= J[:, :, column] * run.at(contact_of(z)).z[0] / p[stiffness]
            J[:, :, column] /= p[stiffness]
        return J

    def evaluate(
        self,
        p: Mapping[str, float],
        local: np.ndarray,
        sigmas: Mapping[str, float],
        loss: Loss,
        names: Sequence[str] = (),
        ran: Simulation | None = None,
        width: float = 0.0,
        **options: Any,
    ) -> Piece:
        """Cost of the trial, and with ``names`` of free parameters its derivatives, in SI units.

        Args:
            p, local: all parameters, SI units, and the local unknowns; inputs that are not among these stay as fitted.
            sigmas, loss: noise standard deviations by signal, SI units, and what a residual in these units costs.
            names: parameters to differentiate by.
            ran, options: see :meth:`simulate`.
            width: resolution in time at which the outputs are compared, s; 0: sample by sample.

        Raises:
            ContactLost, SimulationFailed: the model cannot be simulated there.
        """
        p, joint = {**p, **self.own}, len(local) > len(self.states)
        run = self.simulate(p, local, names, joint, ran, **options)
        steps = len(run.steps) if ran is None else 0
        model = self.predict(run)
        residuals = {name: row - y for name, row, y in zip(self.outputs, model, self.y, strict=True)}
        scale = np.array([sigmas[name] for name in self.outputs])
        measured, half = np.where(np.isnan(self.y), 0.0, 1.0), samples_within(self.t, width)
        r = _filled((model - self.y) / scale[:, None])
        if half:
            r = averaged(np.ascontiguousarray(r[:, :, None]), measured, half)[:, :, 0]
        cost = loss.cost(r)
        n_g, n_l, first = len(names), len(local), len(self.states)
        if names:
            J = self.derivatives(run, p, names, joint)
            if half:
                J, measured = averaged(J, measured, half), np.ones_like(r)
            weight = measured * loss.weight(r) / scale[:, None] ** 2
            seen = r * scale[:, None] * np.sqrt(weight)
            rows = measured.sum(), (seen**2).sum(), (seen[:, 1:] * seen[:, :-1]).sum()
            H, gradient = gram(J.reshape(-1, n_g + n_l), (r * scale[:, None]).reshape(-1), weight.reshape(-1))
            ll, grad_l = H[n_g:, n_g:], gradient[n_g:]  # views
            jumping = n_l and not half and self.simulator.mechanism.jumps(p, names)
            jumps, near = jumps_in(run, self.simulator.mechanism, self.outputs, r, scale, n_g) if jumping else ((), ())
            steep, pull = (J[near][:, n_g:] * np.sqrt(weight[near])[:, None], seen[near]) if jumps else (None, None)
        for z in self.simulator.bristles:  # held within what friction can be: where the body slides no signal sees it
            if z not in self.states:
                continue
            i, reach = self.states.index(z), self.force_scales.get(z, 1.0)
            distance = float(local[i]) / reach
            cost += 0.5 * distance**2
            if names:
                ll[i, i] += 1 / reach**2
                grad_l[i] += distance / reach
        for item, values in zip(self.inputs, self.coefficients(local), strict=True):
            # A signal that was not measured has no level, and no weight.
            levels = np.array([sigmas.get(name, 1.0) for name in item.names])
            shown, changes, own = self.shown(item, values, p, names, joint)
            difference = shown - item.y
            residuals.update({n: r for n, r in zip(item.names, difference, strict=True) if n in sigmas})
            if not joint:
                continue
            r_in = _filled(difference / levels[:, None])
            cost += loss.cost(r_in)
            if names:
                weight = np.where(np.isnan(item.y), 0.0, loss.weight(r_in) / levels[:, None] ** 2)
                flat = changes.reshape(-1, changes.shape[2])
                H_in, g_in = gram(flat, (r_in * levels[:, None]).reshape(-1), weight.reshape(-1))
                place = [*range(n_g + first, n_g + first + item.basis.size), *(list(names).index(n) for n in own)]
                H[np.ix_(place, place)] += H_in
                gradient[place] += g_in
                first += item.basis.size
        if not names:
            return Piece(cost, residuals, run=run if options.get("strict") else None, steps=steps)
        ll[np.diag_indices(n_l)] += RELATIVE_FLOOR * (ll.diagonal().max() if n_l else 0.0)
        parts = H[:n_g, :n_g], H[:n_g, n_g:], ll, gradient[:n_g], grad_l
        smooth = None if steep is None else (ll - steep.T @ steep, grad_l - steep.T @ pull)
        return Piece(cost, residuals, *parts, steps=steps, rows=rows, jumps=jumps, smooth=smooth)


def _filled(r: np.ndarray) -> np.ndarray:
    """Residuals with zeros where nothing was measured, in place (np.nan_to_num takes ten times as long)."""
    r[np.isnan(r)] = 0.0
    return r
