"""Inputs of a simulation as piecewise polynomials between the samples."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import sympy as sp
from scipy.interpolate import CubicSpline

from ..errors import UserError
from ..physics.mechanism import Mechanism
from ..physics.system import TIME
from .session import ALONE, Session

DEGREE = 5


def quintic_hermite(t: np.ndarray, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
    """Position, velocity and acceleration between samples, from one C2 polynomial of degree 5 per interval.

    Args:
        t, q, v, a: times, s, and samples of position, velocity and acceleration, each of shape (n,).

    Returns:
        shape (n - 1, 3, 6): coefficients in the offset t - t_k, lowest power first; the velocity's and the
        acceleration's polynomials are the derivatives of the position's.
    """
    h = np.diff(t)
    c = np.zeros((len(h), 3, DEGREE + 1))
    c[:, 0, 0], c[:, 0, 1], c[:, 0, 2] = q[:-1], v[:-1], a[:-1] / 2
    dq = (q[1:] - q[:-1] - h * v[:-1] - h**2 * a[:-1] / 2) / h**3
    dv = (v[1:] - v[:-1] - h * a[:-1]) / h**2
    da = (a[1:] - a[:-1]) / h
    c[:, 0, 3] = 10 * dq - 4 * dv + da / 2
    c[:, 0, 4] = (-15 * dq + 7 * dv - da) / h
    c[:, 0, 5] = (6 * dq - 3 * dv + da / 2) / h**2
    powers = np.arange(1, DEGREE + 1)
    c[:, 1, :-1] = c[:, 0, 1:] * powers
    c[:, 2, :-1] = c[:, 1, 1:] * powers
    return c


def linear(t: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Straight lines between samples: coefficients of shape (n - 1, 6)."""
    c = np.zeros((len(t) - 1, DEGREE + 1))
    c[:, 0], c[:, 1] = u[:-1], np.diff(u) / np.diff(t)
    return c


def cubic(t: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Cubic spline through the samples (not-a-knot): coefficients of shape (n - 1, 6)."""
    c = np.zeros((len(t) - 1, DEGREE + 1))
    c[:, :4] = CubicSpline(t, u).c[::-1].T
    return c


_PLAIN = {"linear": linear, "cubic": cubic}


@dataclass(frozen=True)
class InputPath:
    """Every input u of a mechanism as a function of time.

    Attributes:
        names: signals that fill u, in the order of ``Mechanism.input_signals``.
        t: sample times, s, shape (n,), strictly increasing.
        coefficients: shape (n - 1, n_u, 6), powers of t - t_k, lowest first; SI units.
        session: place in the session, for effects that depend on it.
    """

    names: tuple[str, ...]
    t: np.ndarray
    coefficients: np.ndarray
    session: Session = ALONE

    def __post_init__(self):
        t = _checked_times(self.t)
        shape = (len(t) - 1, len(self.names), DEGREE + 1)
        coefficients = np.ascontiguousarray(self.coefficients, dtype=float)
        if coefficients.shape != shape:
            raise UserError("wrong size", where="coefficients", received=coefficients.shape, allowed=str(shape))
        object.__setattr__(self, "t", t)
        object.__setattr__(self, "coefficients", coefficients)

    def through(self, coefficients: np.ndarray) -> InputPath:
        """The path of other coefficients, of the same shape and at the same times, which are not checked again."""
        made = object.__new__(InputPath)
        fields = {"names": self.names, "t": self.t, "coefficients": coefficients, "session": self.session}
        for name, value in fields.items():
            object.__setattr__(made, name, value)
        return made

    @classmethod
    def from_signals(
        cls,
        mechanism: Mechanism,
        t: np.ndarray,
        signals: Mapping[str, np.ndarray],
        *,
        motion: str = "hermite",
        force: str = "cubic",
        session: Session = ALONE,
    ) -> InputPath:
        """Interpolate samples.

        Args:
            mechanism: says which coordinates are driven and which inputs it has.
            t: sample times, s, shape (n,).
            signals: name -> samples, shape (n,): position, velocity and acceleration of every driven coordinate;
                an absent force counts as zero.
            motion: "hermite" joins the three samples of a driven coordinate by one C2 polynomial of degree 5 (smooth
                or exact signals); "linear" and "cubic" interpolate each on its own (signals that are not each other's
                derivatives, so that noise in a position is not turned into acceleration).
            force: "cubic" or "linear", for the plain inputs.
            session: place of the samples in a session of several trials.

        Raises:
            UserError: times that do not increase, a missing or wrongly sized signal, values that are not finite.
        """
        t = _checked_times(t)
        columns = []
        for coordinate in mechanism.driven:
            samples = [_samples(signals, name, t, required=True) for name in coordinate.signals]
            if motion == "hermite":
                columns.append(quintic_hermite(t, *samples))
            else:
                columns.append(np.stack([_PLAIN[motion](t, column) for column in samples], axis=1))
        for item in mechanism.system.inputs:
            columns.append(_PLAIN[force](t, _samples(signals, item.name, t, required=False))[:, None, :])
        none = np.zeros((len(t) - 1, 0, DEGREE + 1))
        return cls(mechanism.input_signals, t, np.concatenate([none, *columns], axis=1), session)

    @classmethod
    def from_expressions(
        cls, mechanism: Mechanism, t: np.ndarray, expressions: Mapping[str, sp.Expr], session: Session = ALONE
    ) -> InputPath:
        """Inputs given as sympy expressions of ``TIME``, by the name of a driven coordinate's position or of an input.

        Each expression and its first two derivatives are sampled at t and joined by polynomials of degree 5: at
        400 Hz a swing of 1 Hz is met to 1e-14 rad, its acceleration to 1e-8 rad/s^2.

        Raises:
            UserError: an expression is missing for a driven coordinate, or not finite at some time.
        """
        t = _checked_times(t)
        columns = []
        for name in [c.signals[0] for c in mechanism.driven]:
            if name not in expressions:
                raise UserError(
                    "driven coordinate without a path", where=f"inputs.{name}", fix="give it as a function of t"
                )
            columns.append(quintic_hermite(t, *sample_expression(expressions[name], t, f"inputs.{name}")))
        for item in mechanism.system.inputs:
            expr = expressions.get(item.name, sp.Integer(0))
            columns.append(quintic_hermite(t, *sample_expression(expr, t, f"inputs.{item.name}"))[:, :1])
        none = np.zeros((len(t) - 1, 0, DEGREE + 1))
        return cls(mechanism.input_signals, t, np.concatenate([none, *columns], axis=1), session)

    @cached_property
    def samples(self) -> np.ndarray:
        """u at the sample times, shape (n, n_u)."""
        return at_samples(self.coefficients, self.t)

    @cached_property
    def signals(self) -> dict[str, np.ndarray]:
        """name -> samples at t, each of shape (n,)."""
        return {name: self.samples[:, j] for j, name in enumerate(self.names)}

    def __call__(self, time: float) -> np.ndarray:
        """u at one time, shape (n_u,)."""
        k = min(max(int(self.t.searchsorted(time, side="right")) - 1, 0), len(self.t) - 2)
        d = float(time - self.t[k])
        d2 = d * d
        return self.coefficients[k] @ np.array([1.0, d, d2, d * d2, d2 * d2, d * d2 * d2])


def at_samples(coefficients: np.ndarray, t: np.ndarray) -> np.ndarray:
    """What acts at the times t, shape (..., n, n_u)."""
    last = coefficients[..., -1:, :, :] @ (t[-1] - t[-2]) ** np.arange(DEGREE + 1)
    return np.concatenate([coefficients[..., 0], last], axis=-2)


def _checked_times(t: np.ndarray) -> np.ndarray:
    t = np.ascontiguousarray(t, dtype=float)
    if t.ndim != 1 or len(t) < 2:
        raise UserError("too few samples", where="t", received=f"shape {t.shape}", allowed="at least 2 times")
    wrong = ~(np.diff(t) > 0)
    if wrong.any():
        k = int(np.argmax(wrong))
        raise UserError("times do not increase", where=f"t[{k + 1}]", received=t[k + 1], allowed=f"above {t[k]:g} s")
    return t


def _samples(signals: Mapping[str, np.ndarray], name: str, t: np.ndarray, *, required: bool) -> np.ndarray:
    if name not in signals:
        if required:
            raise UserError("missing input signal", where=f"inputs.{name}", fix="give its samples, or its path")
        return np.zeros(len(t))
    column = np.asarray(signals[name], dtype=float)
    if column.shape != t.shape:
        raise UserError("wrong size", where=f"inputs.{name}", received=f"shape {column.shape}", allowed=f"{t.shape}")
    _finite(column, t, f"inputs.{name}")
    return column


def sample_expression(expr: sp.Expr, t: np.ndarray, name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Value, first and second derivative of an expression of ``TIME`` at t, each of shape (n,).

    The impulse in the derivative of a jump (sign) or a kink (abs) is left out.

    Raises:
        UserError: a value that is not finite, with ``name`` and its time.
    """
    derivatives = [sp.diff(sp.sympify(expr), TIME, order) for order in range(3)]
    derivatives = [value.replace(sp.DiracDelta, lambda *_: sp.Integer(0)) for value in derivatives]
    with np.errstate(all="ignore"):
        values = sp.lambdify([TIME], derivatives, modules="numpy", cse=True)(t)
    columns = [np.array(np.broadcast_to(np.asarray(value, dtype=float), t.shape)) for value in values]
    for column in columns:
        _finite(column, t, name)
    return columns[0], columns[1], columns[2]


def _finite(column: np.ndarray, t: np.ndarray, name: str) -> None:
    bad = ~np.isfinite(column)
    if bad.any():
        raise UserError("not a finite number", where=f"{name} at t = {t[int(np.argmax(bad))]:g} s")
