"""Between a recording and the equations: inputs that act late, and sensors that show something else than the truth."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np
import sympy as sp

from ..physics.mechanism import Mechanism
from .delay import shift_pieces, shift_samples, slopes, together
from .directions import Directions
from .jumps import find_stops
from .paths import DEGREE, InputPath

Signals = dict[str, np.ndarray]
Delays = Mapping[str, Mapping[str, float]]  # see Mechanism.delays


class Drive:
    """What acts, from the inputs as recorded: delayed where an effect says so, the clocks that enter as last inputs.

    No direction changes a clock, and so directions have columns for the recorded inputs alone.
    """

    def __init__(self, mechanism: Mechanism, parameters: tuple[str, ...], delays: Delays):
        names = mechanism.input_signals
        late = {name: terms for name, terms in delays.items() if name not in mechanism.predictions}
        self.delays = {names.index(name): _weights(terms, parameters) for name, terms in late.items()}
        self.clocks = mechanism.clocks
        self.parameters = {name: parameters.index(name) for terms in late.values() for name in terms}

    def path(self, recorded: InputPath, p: np.ndarray) -> InputPath:
        """Return the inputs that act."""
        late = self._late(recorded, p)
        if not self.clocks:
            return late
        clocks = np.zeros((len(late.t) - 1, len(self.clocks), DEGREE + 1))
        lines = late.session.lines(self.clocks)
        clocks[:, :, 0], clocks[:, :, 1] = lines[:, 0] + lines[:, 1] * late.t[:-1, None], lines[:, 1]
        names = (*late.names, *(symbol.name for symbol in self.clocks))
        return InputPath(names, late.t, np.concatenate([late.coefficients, clocks], axis=1), late.session)

    def directions(self, given: Mapping[str, InputPath] | Directions, path: InputPath, p: np.ndarray) -> Directions:
        """Return the changes of what acts for changes of the recorded inputs, a path; these where none acts late."""
        late = self._shifts(p)
        if isinstance(given, Directions):
            return given.late(late) if late and len(given) else given
        made = Directions.of(given, path)
        return Directions.of({name: self._late(own, p) for name, own in given.items()}, path) if late else made

    def delay_direction(self, name: str, recorded: InputPath, p: np.ndarray) -> InputPath:
        """Return the derivative of what acts in the delay parameter ``name``."""
        rates = np.zeros_like(recorded.coefficients)
        for column, weights in self.delays.items():
            rates[:, column] = weights[self.parameters[name]]
        for shift, columns in together({column: float(weights @ p) for column, weights in self.delays.items()}):
            if rates[:, columns].any():
                rates[:, columns] *= shift_pieces(recorded.t, recorded.coefficients[:, columns], shift, rate=True)
        return recorded.through(rates)

    def _shifts(self, p: np.ndarray) -> dict[int, float]:
        """Columns that act late, and by how much, s."""
        shifts = {column: float(weights @ p) for column, weights in self.delays.items()}
        return {column: shift for column, shift in shifts.items() if shift != 0}

    def _late(self, path: InputPath, p: np.ndarray) -> InputPath:
        late = self._shifts(p)
        if not late:
            return path
        coefficients = path.coefficients.copy()
        for shift, columns in together(late):
            coefficients[:, columns] = shift_pieces(path.t, path.coefficients[:, columns], shift)
        return path.through(coefficients)


class Sensors:
    """What the sensors of the predicted signals show, and its derivatives.

    Only signals whose sensor an effect changes are touched.
    """

    def __init__(self, mechanism: Mechanism, parameters: tuple[str, ...], delays: Delays):
        self.parameters = parameters
        predictions = mechanism.predictions
        self.slopes = {c.signals[i]: c.signals[i + 1] for c in mechanism.free for i in (0, 1)}
        self.jumps = mechanism.jumps
        # Without memory a friction force jumps where a body stops, and the acceleration with it.
        self.jumping = {c.signals[2]: c.signals[1] for c in mechanism.free}
        self.delays = {k: _weights(terms, parameters) for k, terms in delays.items() if k in predictions}
        symbols = [par.symbol for par in mechanism.parameters]
        self.shown: dict[str, Callable] = {}
        self.partial: dict[str, tuple[tuple[str, ...], Callable]] = {}
        for name, truth in predictions.items():
            expr = mechanism.outputs[name]
            if expr == truth and name not in self.delays:
                continue
            enter = [par for par in mechanism.parameters if par.symbol in expr.free_symbols]
            derivatives = [sp.diff(expr, symbol) for symbol in (truth, *(par.symbol for par in enter))]
            self.shown[name] = sp.lambdify([truth, *symbols], expr, "numpy")
            self.partial[name] = (
                tuple(par.name for par in enter),
                sp.lambdify([truth, *symbols], derivatives, "numpy"),
            )

    @property
    def own(self) -> frozenset[str]:
        """Parameters that sensors have."""
        entering = {name for names, _ in self.partial.values() for name in names}
        late = {self.parameters[k] for weights in self.delays.values() for k in np.flatnonzero(weights)}
        return frozenset(entering | late)

    def read(self, t: np.ndarray, truth: Mapping[str, np.ndarray], p: np.ndarray) -> Signals:
        """Return what the sensors show, name -> (n,); ``truth`` has all true signals."""
        return {name: function(self._late(name, t, truth, truth, p)[0], *p) for name, function in self.shown.items()}

    def differentiate(
        self,
        t: np.ndarray,
        truth: Mapping[str, np.ndarray],
        changes: Mapping[str, np.ndarray],
        p: np.ndarray,
        names: tuple[str, ...],
    ) -> Signals:
        """Return derivatives of what the sensors show, name -> (n, n_sens).

        Args:
            truth: true signals, (n,) each.
            changes: their derivatives, (n, n_sens) each.
            names: what the derivatives are taken with respect to.
        """
        result = {}
        for name, (own, function) in self.partial.items():
            y, rate = self._late(name, t, truth, truth, p)
            change = self._late(name, t, changes, truth, p)[0].copy()
            for index in np.flatnonzero(self.delays.get(name, ())):
                if self.parameters[index] in names:
                    change[:, names.index(self.parameters[index])] += self.delays[name][index] * rate
            by_truth, *by_own = function(y, *p)
            change *= by_truth
            for parameter, derivative in zip(own, by_own, strict=True):
                if parameter in names:
                    change[:, names.index(parameter)] += derivative
            result[name] = change
        return result

    def _late(
        self,
        name: str,
        t: np.ndarray,
        signals: Mapping[str, np.ndarray],
        truth: Mapping[str, np.ndarray],
        p: np.ndarray,
    ):
        """A signal as late as its sensor shows it, and its derivative in the delay; ``truth`` tells where it jumps."""
        y = signals[name]
        if name not in self.delays:
            return y, np.zeros_like(y)
        delay = float(self.delays[name] @ p)
        velocity = self.jumping.get(name) if self.jumps(dict(zip(self.parameters, p, strict=True))) else None
        found = [] if velocity is None else find_stops(t, truth[velocity], truth[name], truth[name])
        jumps = [(stop.at, stop.time) for stop in found]
        slope = signals[self.slopes[name]] if name in self.slopes else slopes(t, y, jumps)
        return shift_samples(t, y, slope, delay, jumps) if delay else (y, -slope)


class MotionSensors:
    """What the sensors of an imposed motion show of it: shown = factor * true + offset of every signal.

    Position, velocity and acceleration are one motion, and so the sensor of each can be wrong against the others.
    """

    def __init__(self, mechanism: Mechanism):
        self.parameters: dict[str, tuple[str, ...]] = {}
        self._lines: dict[str, Callable] = {}
        symbols = [par.symbol for par in mechanism.parameters]
        for name, line in mechanism.motion_sensors.items():
            entering = line[0].free_symbols | line[1].free_symbols
            own = [par for par in mechanism.parameters if par.symbol in entering]
            changes = [[sp.diff(expr, par.symbol) for expr in line] for par in own]
            self.parameters[name] = tuple(par.name for par in own)
            self._lines[name] = sp.lambdify(symbols, [list(line), *changes], "numpy")

    def of(self, signals: Iterable[str]) -> tuple[str, ...]:
        """Parameters of the sensors of these signals."""
        return tuple(dict.fromkeys(own for name in signals for own in self.parameters.get(name, ())))

    def lines(self, signals: Sequence[str], p: np.ndarray) -> np.ndarray:
        """Factor and offset of each signal, shape (len(signals), 2)."""
        return np.stack([self._lines[name](*p)[0] if name in self._lines else (1.0, 0.0) for name in signals])

    def derivatives(self, true: Mapping[str, np.ndarray], p: np.ndarray, names: Sequence[str]) -> np.ndarray:
        """Derivatives of what is shown in the parameters ``names``, shape (len(true), n, len(names))."""
        y = np.stack([*true.values()])
        result = np.zeros((*y.shape, len(names)))
        for k, signal in ((k, name) for k, name in enumerate(true) if name in self._lines):
            for name, (factor, offset) in zip(self.parameters[signal], self._lines[signal](*p)[1:], strict=True):
                if name in names:
                    result[k, :, names.index(name)] = factor * y[k] + offset
        return result


def _weights(terms: Mapping[str, float], parameters: tuple[str, ...]) -> np.ndarray:
    """The delay as a row over the parameter vector."""
    return np.array([terms.get(name, 0.0) for name in parameters])
