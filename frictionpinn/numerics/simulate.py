"""Simulation of a mechanism, with forward sensitivities to its parameters, initial states and inputs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from ..errors import UserError, nearest
from ..physics.mechanism import Mechanism
from .bristle import resting_states, steady_bristles
from .codegen import Kernels
from .differentiate import Wanted, differentiate
from .directions import Directions
from .measure import Drive, MotionSensors, Sensors
from .paths import DEGREE, InputPath
from .simulation import ContactLost, Simulation, SimulationFailed, Steps
from .stepping import PLAIN, STRICT, integrate_path, observed

__all__ = ["ContactLost", "Part", "Simulation", "SimulationFailed", "Simulator", "Steps"]

_NONE: Mapping = MappingProxyType({})
_NO_PATH = InputPath((), np.arange(2.0), np.zeros((1, 0, DEGREE + 1)))
_NOTHING = Wanted((), np.empty(0, np.int64), np.empty(0, np.int64), Directions.of({}, _NO_PATH))
Values = Mapping[str, float] | Sequence[float] | np.ndarray


class Simulator:
    """Compiled simulator of one mechanism.

    R(q, v, a, z, z', u; p) = 0 is solved stage by stage for the accelerations and z' by Newton's method with the
    analytic Jacobian, in an L-stable, stiffly accurate method of order 3 with adaptive steps that end at every
    sample. So the bristle's rate in sliding (2e4 1/s) does not limit the step, and the normal force may depend on
    the accelerations sought. A mechanism's first use on a machine compiles its equations (about a second).
    ``outside`` holds the parameters that act elsewhere than in the equations: in a sensor, or by the delay of an input.
    With ``as_shown`` the motion is told at the times at which sensors show it: where all of them are late alike, the
    inputs act late instead, so that no prediction is read between samples, where an acceleration may jump.

    Source: Kvaerno, Singly diagonally implicit Runge-Kutta methods with an explicit first stage, BIT 44 (2004).
    """

    def __init__(self, mechanism: Mechanism, as_shown: bool = False):
        self.mechanism, self.as_shown = mechanism, as_shown
        self.kernels = Kernels(mechanism)
        self.parameter_names = tuple(par.name for par in mechanism.parameters)
        self._defaults = {par.name: par.value for par in mechanism.parameters} | mechanism.system.values
        delays = mechanism.delays_of_inputs if as_shown else mechanism.delays
        self._drive = Drive(mechanism, self.parameter_names, delays)
        self._sensors = Sensors(mechanism, self.parameter_names, delays)
        self.motion_sensors = MotionSensors(mechanism)
        free, self.bristles = mechanism.free, tuple(contact.z.name for contact in mechanism.bristles)
        self.outside = frozenset({*self._drive.parameters, *self._sensors.own})
        self.state_names = (*(c.signals[0] for c in free), *(c.signals[1] for c in free), *self.bristles)

    def __reduce__(self):
        return type(self), (self.mechanism, self.as_shown)  # compiled code is loaded anew in the other process

    def parameters(self, p: Values) -> np.ndarray:
        """Return the parameter vector, shape (n_p,), SI units, in the order of ``parameter_names``.

        Args:
            p: that vector, or name -> value; a parameter of the system that is not named takes the system's value,
                one of the law its default.

        Raises:
            UserError: an unknown name, a wrong number of values, a parameter without a finite value.
        """
        return self._vector(self._named(p, self.parameter_names, "parameters"))

    def _vector(self, values: Mapping[str, float]) -> np.ndarray:
        names, defaults = self.parameter_names, self._defaults
        given = [values.get(name, defaults[name]) for name in names]
        vector = np.array(given, dtype=float)  # None becomes nan
        for k in np.flatnonzero(~np.isfinite(vector)):
            raise UserError(
                "parameter without a finite value", where=names[k], received=given[k], fix="give it a number"
            )
        return vector

    def simulate(
        self,
        t: np.ndarray,
        inputs: InputPath | Mapping[str, np.ndarray],
        p: Values,
        y0: Values = _NONE,
        *,
        z0: float | str = 0.0,
        sensitivities: Sequence[str] = (),
        directions: Mapping[str, InputPath] | Directions = _NONE,
        rtol: float = 1e-5,
        atol: float = 1e-6,
        steps: Steps | None = None,
        strict: bool = False,
        contact: bool = True,
    ) -> Simulation:
        """Integrate the mechanism over the sample times.

        Args:
            t: sample times, s, shape (n,), increasing, not necessarily uniform.
            inputs: path of the driven coordinates and inputs, or their samples by signal name, see
                :meth:`InputPath.from_signals`.
            p: parameters, see :meth:`parameters`.
            y0: initial state: name -> value or the vector of ``state_names``; at rest at 0 where not given.
            z0: initial state of the bristles that y0 does not name; "steady" for static equilibrium at rest (the body
                stays if it can stick) and steady sliding in motion.
            sensitivities: names of parameters, and of initial states as "x(0)".
            directions: name -> derivative of the input path with respect to a quantity of the caller's (a spline
                coefficient), on the same times: sensitivities to it are added; for many simulations as
                :class:`Directions`.
            rtol, atol: error allowed in a step, relative and, for velocities, absolute (m/s or rad/s). By default the
                velocity of the pendulum on a box is within 1e-5 m/s.
            steps: take these steps of an earlier simulation of the same times instead of choosing any (parameters
                little changed: a step that was small enough for Newton's method there is not halved here).
            strict: solve the equations as closely as sensitivities need, see :meth:`differentiate`; with sensitivities
                always.
            contact: sensitivities of slip velocity, normal and friction force too.

        Raises:
            ContactLost: the normal force reaches zero.
            SimulationFailed: no solution, or steps that would have to be too small.
            UserError: a wrong name, size or value.
        """
        recorded = self._path(t, inputs)
        vector = self.parameters(p)
        y0 = self._named(y0, self.state_names, "y0")
        wanted = self._wanted(sensitivities, directions, recorded, vector)
        path = self._drive.path(recorded, vector)
        start = self._start(y0, z0, path.coefficients[0, :, 0], vector)
        solve = STRICT if strict or wanted.names else PLAIN
        found = integrate_path(self.kernels, path, vector, start, (rtol, atol, solve), steps)
        truth = observed(self.kernels, path, recorded, vector, *found)
        result = truth
        if shown := self._sensors.read(path.t, truth.signals, vector):
            result = replace(truth, signals=truth.signals | shown)
        if not wanted.names:
            return result
        steady = np.array([z0 == "steady" and name not in y0 for name in self.bristles], dtype=np.bool_)
        changes = self._changes(result, recorded, path, vector, wanted, steady, contact)
        names = (*sensitivities, *directions)
        if names != wanted.names:
            order = [wanted.names.index(name) for name in names]
            changes = {name: columns[:, order] for name, columns in changes.items()}
        return replace(result, sensitivity_names=names, sensitivities=changes)

    def differentiate(
        self,
        run: Simulation,
        inputs: InputPath,
        p: Values,
        sensitivities: Sequence[str],
        directions: Mapping[str, InputPath] | Directions = _NONE,
        *,
        steady: bool | Sequence[str] = True,
        contact: bool = True,
    ) -> dict[str, np.ndarray]:
        """Sensitivities of a simulation, at its parameters or at others that lead to the same motion.

        So the shape of an effect that is at its neutral strength can be varied without simulating again. At other
        parameters not for those that move a state of an effect, or that delay an input.

        Args:
            run: of this simulator, ``strict``.
            inputs: its input path.
            p: parameters, see :meth:`parameters`.
            sensitivities, directions: see :meth:`simulate`.
            steady: whether the initial bristle states were "steady", or the names of those that were.
            contact: see :meth:`simulate`.

        Returns:
            signal -> derivatives, shape (n, n_sens), see :class:`Simulation`.
        """
        vector = self.parameters(p)
        wanted = self._wanted(sensitivities, directions, inputs, vector)
        path = self._drive.path(inputs, vector)
        changes = self._changes(run, inputs, path, vector, wanted, self.settled(steady), contact)
        if (names := (*sensitivities, *directions)) == wanted.names:
            return changes
        order = [wanted.names.index(name) for name in names]
        return {name: columns[:, order] for name, columns in changes.items()}

    def settled(self, steady: bool | Sequence[str]) -> np.ndarray:
        """Which of the bristles began "steady": all, none, or those that are named; shape (bristles,)."""
        named = self.bristles if steady is True else () if steady is False else steady
        return np.array([name in named for name in self.bristles], dtype=np.bool_)

    def _changes(
        self,
        run: Simulation,
        inputs: InputPath,
        path: InputPath,
        p: np.ndarray,
        wanted: Wanted,
        steady: np.ndarray,
        contact: bool,
    ) -> dict[str, np.ndarray]:
        """Derivatives of everything that a simulation shows, by name; without ``contact`` not of what acts there."""
        changes = differentiate(self.kernels, path, p, run.states, run.unknowns, run.steps, wanted, steady, contact)
        return self.shown(run, inputs, p, changes, wanted.names)

    def imposed(self, motion: InputPath, p: Values, sensed: Sequence[str] | None = None) -> InputPath:
        """The input path of a true motion of the driven coordinates: what their sensors show of it.

        ``sensed`` are the signals of which the truth is given, by default all; the others stay as they are.
        """
        names = tuple(self.motion_sensors.parameters) if sensed is None else sensed
        if not names:
            return motion
        coefficients, columns = motion.coefficients.copy(), [motion.names.index(name) for name in names]
        factors, offsets = self.motion_sensors.lines(names, self.parameters(p)).T
        coefficients[:, columns] *= factors[:, None]
        coefficients[:, columns, 0] += offsets
        return motion.through(coefficients)

    def acting(self, inputs: InputPath, p: np.ndarray) -> InputPath:
        """The path that acts at a parameter vector: delayed where an effect says so, with the clocks that enter."""
        return self._drive.path(inputs, p)

    def shown(
        self, run: Simulation, inputs: InputPath, p: np.ndarray, changes: Mapping[str, np.ndarray], names: Sequence[str]
    ) -> dict[str, np.ndarray]:
        """Derivatives as the sensors show them, from those of what is; ``names`` as in :class:`Wanted`."""
        truth = dict(inputs.signals)
        for j, c in enumerate(self.mechanism.free):
            truth.update(zip(c.signals, (run.q[:, j], run.v[:, j], run.a[:, j]), strict=True))
        if run.required is not None:
            truth |= dict.fromkeys(self.mechanism.predictions, run.required)
        return dict(changes) | self._sensors.differentiate(inputs.t, truth, changes, p, tuple(names))

    # what the caller gave -------------------------------------------------------------------------------------
    def _named(self, values: Values, names: tuple[str, ...], where: str) -> dict[str, float]:
        if not isinstance(values, Mapping):
            if np.shape(values) != (len(names),):
                raise UserError(
                    "wrong number of values", where=where, received=np.shape(values), allowed=f"({', '.join(names)})"
                )
            values = dict(zip(names, values, strict=True))
        for name in values:
            if name not in names:
                fix = nearest(name, names) or "remove it"
                raise UserError("unknown name", where=f"{where}.{name}", allowed=", ".join(names), fix=fix)
        return dict(values)

    def _path(self, t: np.ndarray, inputs: InputPath | Mapping[str, np.ndarray]) -> InputPath:
        if not isinstance(inputs, InputPath):
            return InputPath.from_signals(self.mechanism, t, inputs)
        if inputs.names != self.mechanism.input_signals or not (inputs.t is t or np.array_equal(inputs.t, t)):
            raise UserError(
                "input path of another mechanism or other times",
                where="inputs",
                received=", ".join(inputs.names),
                allowed=", ".join(self.mechanism.input_signals) + " at the times t",
                fix="build it for this mechanism and these times",
            )
        return inputs

    def _wanted(
        self,
        names: Sequence[str],
        directions: Mapping[str, InputPath] | Directions,
        path: InputPath,
        p: np.ndarray,
    ) -> Wanted:
        """What to differentiate with respect to: delays of inputs become directions, directions what acts."""
        if not names and not directions:
            return _NOTHING
        valid = (*self.parameter_names, *(f"{name}(0)" for name in self.state_names))
        for name in names:
            if name not in valid:
                fix = nearest(name, valid) or "use one of these"
                raise UserError("unknown sensitivity", where=name, allowed=", ".join(valid), fix=fix)
        ready = self._drive.directions(directions, path, p)
        late = {name: self._drive.delay_direction(name, path, p) for name in names if name in self._drive.parameters}
        if late:
            ready = ready.beside(Directions.of(late, path))
        plain, n_p, m = [n for n in names if n not in ready], len(self.parameter_names), len(self.mechanism.free)
        place = {name: i for i, name in enumerate(valid)}
        index = np.array([place[name] for name in plain] + [-1] * len(ready), dtype=np.int64)
        columns, states = np.where(index < n_p, index, -1), np.where(index >= n_p, index - n_p, -1)
        states[states >= 2 * m] += len(self.mechanism.states)
        return Wanted((*plain, *ready), columns, states, ready)

    def _start(self, y0: dict[str, float], z0: float | str, u: np.ndarray, p: np.ndarray) -> np.ndarray:
        start = np.array([y0.get(name, 0.0) for name in self.state_names], dtype=float)
        if isinstance(z0, str) and z0 != "steady":
            raise UserError("unknown initial bristle state", where="z0", received=z0, allowed="a number or 'steady'")
        m = len(self.mechanism.free)
        start = np.concatenate([start[: 2 * m], np.zeros(len(self.mechanism.states)), start[2 * m :]])
        start = resting_states(self.kernels, start, u, p)
        free = [name not in y0 for name in self.bristles]
        if any(free):
            z = start[len(start) - len(free) :]
            z[free] = steady_bristles(self.kernels, start, u, p, np.array(free))[free] if z0 == "steady" else float(z0)
        if not np.isfinite(start).all():
            raise UserError("initial state that is not finite", where="y0", received=start.tolist())
        return start


class Part(Simulator):
    """A simulator that takes the parameters of a wider mechanism too, and leaves out what it lacks."""

    def parameters(self, p: Values) -> np.ndarray:
        """See :meth:`Simulator.parameters`; names of other parameters are passed over."""
        return self._vector(p) if isinstance(p, Mapping) else super().parameters(p)
