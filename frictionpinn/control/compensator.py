"""Friction compensation beside a controller: reference and measured position in, torque and its interval out."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import sympy as sp

from ..errors import UserError
from ..numerics.codegen import Kernels, pointer
from ..online.check import check_above, check_adapt, check_least, check_sensors, finite, parameter_vector
from ..physics import CONTACT
from ..physics.base import TRIAL
from ..physics.mechanism import Mechanism
from .filter import ALIKE, DISTURBANCE, RESOLVED, SLOPES, THETA, Memory, Plan
from .recursions import cycle, inertia

WEAR = 0.01  # per root of a second, of ``uneven``: after three hours of motion a surface is as unknown as at first
MOST_CELLS = 512  # a cycle takes time and memory with their square: 8 MB
STILL = 10.0  # steps of the encoder a second: slower, a reference is at rest


class Command(NamedTuple):
    """Torque to add, and its 95 % interval, in the system's unit of force."""

    torque: float
    low: float
    high: float


class Compensator:
    """Torque that cancels the friction of an axis, once in every cycle of its controller.

    The torque is F (1 + b(q_r)) + a |F| + c(q_r) + d, limited. F = F(q_r, v_r, z_r; p) is the mechanism's friction,
    effects included, along the reference (q_r, v_r), with a bristle z_r that is carried along it. With ``adapt`` or
    ``disturbance`` a Kalman filter on the equation of motion (see :mod:`.filter`) reads the encoder, follows the
    parameters named in ``adapt`` and estimates the disturbance d, all else that acts like a friction. With ``stroke``
    and ``uneven`` it learns what a surface may show, too: a share b of the friction and a force c, both between
    ``cells`` places, and the share a by which friction is higher one way. Without any of these, it is a feed-forward;
    without a law (mu_c = 0), a disturbance observer.

    It cannot pump energy into an axis that is to rest: all that feeds back moves to its newest value at the rate
    w = v_r^2 / (v_r^2 + still^2), so at v_r = 0 the torque is a constant, and the work of a constant torque over any
    closed path is zero.

    Args:
        mechanism: one free coordinate and a force or torque on it: drive, joint, pendulum; effects may act on the
            mechanism, not on its sensors.
        parameters: by name, SI units: identified, or known.
        known: with which the controller computes the torque of the motion without friction; what p says beyond them is
            added, too (a load). None: ``parameters``.
        interval: cycle of the controller, s.
        delay: from a command to its effect, s; the reference that :meth:`update` gets is that much ahead.
        resolution: step of the encoder, in the unit of position.
        adapt: parameter -> relative change per square root of a second of motion.
        spread: parameter that adapts -> relative standard deviation at the start; 0 where not given.
        disturbance: change of d per square root of a second, in the unit of force; 0: there is none.
        bandwidth: up to which d follows at most, Hz: readings count as noisy enough for that, however fine the encoder.
            What the equations leave out above it (an elastic gear, the delay's error) is left to the controller.
        stroke: first and last position between which b and c are learned; None: nowhere.
        cells: number of places in it.
        uneven: standard deviation of a, b, and of c as a share of the dry friction; 0: none is learned.
        still: speed of the reference at which half of the feedback is let through; None: ten steps of the encoder a
            second.
        limit: largest torque to add, in the unit of force.
        gain: factor of the torque, for tests of how much over-compensation a loop bears.

    Raises:
        UserError: a mechanism that is no such axis; a parameter without value or out of its range, or mu_s below mu_c;
            a cycle, delay, resolution, limit or speed that is not above 0 (a delay: not below), or a cycle or delay
            that is too long for the bandwidth; a stroke without length.

    Source: H. Olsson and others, Friction models and friction compensation, European Journal of Control 4 (1998).
    """

    def __init__(
        self,
        mechanism: Mechanism,
        parameters: Mapping[str, float],
        *,
        known: Mapping[str, float] | None = None,
        interval: float = 1e-3,
        delay: float = 0.0,
        resolution: float = 1e-6,
        adapt: Mapping[str, float] | None = None,
        spread: Mapping[str, float] | None = None,
        disturbance: float = 0.0,
        bandwidth: float = 30.0,
        still: float | None = None,
        limit: float = 1e9,
        gain: float = 1.0,
        stroke: tuple[float, float] | None = None,
        cells: int = 32,
        uneven: float = 0.0,
    ):
        check_axis(mechanism)
        check_sensors(mechanism)
        for name, value in {
            "interval": interval,
            "resolution": resolution,
            "limit": limit,
            "bandwidth": bandwidth,
            "gain": gain,
        }.items():
            check_above(name, value, 0.0)
        for name, value in {"delay": delay, "disturbance": disturbance, "uneven": uneven}.items():
            check_least(name, value)
        if not (finite(cells) and cells == int(cells) and 2 <= cells <= MOST_CELLS):
            raise UserError("impossible value", where="cells", received=cells,
                            allowed=f"a whole number from 2 to {MOST_CELLS}")  # fmt: skip
        low, high = _stroke(stroke)
        self.mechanism, self.kernels = mechanism, Kernels(mechanism)
        self.names = tuple(par.name for par in mechanism.parameters)
        self.adapt, self.spread = dict(adapt or {}), dict(spread or {})
        for name, value in self.spread.items():
            check_least(f"spread.{name}", value)
        p = parameter_vector(mechanism, self.names, parameters)
        check_adapt(self.adapt, self.names, p, None)
        n_s, n_w, n_u, _ = self.kernels.sizes
        plain, columns = self.kernels.plain, mechanism.input_signals
        self._k, cells = len(self.adapt), int(cells) if high > low and uneven > 0 else 0
        if filters := bool(adapt or disturbance or cells):
            _loop(interval, delay, bandwidth)
        level = uneven * dry_friction(mechanism, parameters)
        surface = np.array([level] * cells + [uneven] * (cells + (cells > 0)))
        size, width = THETA + self._k + len(surface), (high - low) / max(cells - 1, 1)
        clocks = [(n_u - len(mechanism.clocks) + i, int(symbol != TRIAL)) for i, symbol in enumerate(mechanism.clocks)]
        w, m = 2 * math.pi * bandwidth, inertia(pointer(plain.newton), p, self.kernels.sizes)
        # of the encoder's step, or so much that the filter of d has the bandwidth w: of a triple integrator under noise
        # of density q, read with density r, that is (q / r)^(1/6)
        noise = max((disturbance / m) ** 2 / (w**6 * interval), resolution**2 / 12)
        self.plan = Plan(
            *self._compiled(), p,
            p if known is None else parameter_vector(mechanism, self.names, {**parameters, **known}),
            np.array([self.names.index(name) for name in self.adapt], dtype=np.int64),
            np.array(clocks, dtype=np.int64).reshape(-1, 2), (n_s, n_w, n_u, columns.index(actuator(mechanism))),
            float(interval), float(delay / interval), m, noise,
            float(disturbance) ** 2, np.array([*self.adapt.values(), *(WEAR * surface)], dtype=float) ** 2,
            np.array([disturbance / math.sqrt(w), *(self.spread.get(name, 0.0) for name in self.adapt), *surface],
                     dtype=float),
            float(STILL * resolution if still is None else still), RESOLVED * w * ALIKE * width, float(limit),
            filters, float(gain), cells, low, width,
        )  # fmt: skip
        check_above("still", self.plan.still, 0.0)
        past = np.zeros((int(self.plan.lag) + 3, SLOPES + self._k))
        self.memory = Memory(
            np.zeros(size), np.zeros((size, size)), np.zeros(n_s), np.zeros(n_w), np.zeros((n_s, self._k)), p.copy(),
            past, np.zeros(5), np.zeros(1, dtype=np.int64),
        )  # fmt: skip
        self._result = np.zeros(3)

    def _compiled(self) -> tuple[Any, Any, Any]:
        """The first entries of the plan: addresses, which hold in this process alone."""
        plain = self.kernels.plain
        return pointer(plain.newton), pointer(plain.outputs), pointer(self.kernels.strengths(tuple(self.adapt)))

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "plan": self.plan[3:]}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__ |= state
        self.plan = Plan(*self._compiled(), *state["plan"])

    def __repr__(self) -> str:
        told = ", ".join(f"{name} {value:.4g}" for name, value in self.parameters.items() if name in self.adapt)
        return f"Compensator({self.mechanism.name}; adapts {told or 'nothing'})"

    def reset(self) -> None:
        """Forget all cycles; parameters that adapt return to their first values."""
        self.memory.begun[0] = 0

    def update(self, reference: Sequence[float], position: float, torque: float) -> Command:
        """One cycle.

        Args:
            reference: position, velocity and acceleration wanted at the time when the torque will act, SI units.
            position: measured now, SI units; NaN where there is no reading.
            torque: commanded in the cycle before, as the limits let it through, compensation included.

        Raises:
            UserError: a reference or torque that is not finite, a position that is no number.
        """
        try:
            wanted = np.array(reference, dtype=float)
        except (TypeError, ValueError):
            wanted = np.empty(0)
        if wanted.shape != (3,) or not np.isfinite(wanted).all():
            raise UserError("no reference", where="reference", received=reference, allowed="three finite numbers: "
                            "position, velocity, acceleration")  # fmt: skip
        if not (position != position or finite(position)):
            raise UserError("no reading", where="position", received=position, allowed="a finite number, or NaN")
        if not finite(torque):
            raise UserError("not a finite torque", where="torque", received=torque, fix="give the one commanded last")
        cycle(self.plan, self.memory, wanted, float(position), float(torque), self._result)
        return Command(*self._result.tolist())

    @property
    def parameters(self) -> dict[str, float]:
        """Parameters in force, SI units."""
        return dict(zip(self.names, self.memory.p.tolist(), strict=True))

    @property
    def disturbance(self) -> float:
        """What is estimated to act beside the mechanism's friction, counted as friction is, in the unit of force."""
        return float(self.memory.X[DISTURBANCE])

    @property
    def asymmetry(self) -> float:
        """Share by which friction was learned to be higher where the velocity is positive."""
        return float(self.memory.X[-1]) if self.plan.cells else 0.0


def actuator(mechanism: Mechanism) -> str:
    """Name of the input that moves the axis."""
    return next(item.name for item in mechanism.system.inputs if item.symbol in mechanism.system.acting)


def completed(mechanism: Mechanism, values: Mapping[str, float]) -> dict[str, float]:
    """The values, and 1 for every parameter of the law without one: where its friction is subtracted again."""
    return {par.name: 1.0 for par in mechanism.law.parameters if par.value is None} | dict(values)


def check_axis(mechanism: Mechanism) -> None:
    """Raise :class:`UserError` for a mechanism that is not one free coordinate with a force or torque on it."""
    system = mechanism.system
    acting = [item for item in system.inputs if item.symbol in system.acting]
    if system.massless or len(mechanism.free) != 1 or mechanism.driven or len(acting) != 1:
        raise UserError(
            "no axis that a controller moves",
            where="system",
            received=system.name,
            allowed="one free coordinate and one force or torque on it: drive, joint, pendulum",
            fix="declare the axis as one of these",
        )


def dry_friction(mechanism: Mechanism, parameters: Mapping[str, float]) -> float:
    """Dry friction at the edge of sliding, in the system's unit of force: the scale of a compensator's numbers."""
    law, system = mechanism.law, mechanism.system
    names = [par.name for par in mechanism.parameters]
    vector = parameter_vector(mechanism, names, {name: parameters[name] for name in names if name in parameters})
    values = dict(zip(names, vector.tolist(), strict=True))
    rest = {symbol: 0 for c in system.moving for symbol in c.symbols} | {item.symbol: 0 for item in system.inputs}
    capacity = sp.sympify(law.capacity(CONTACT, law.symbols)).subs({CONTACT.v: 0}).subs(CONTACT.N, system.N.subs(rest))
    return float(capacity.subs({par.symbol: values[par.name] for par in mechanism.parameters}))


def _stroke(stroke: Sequence[float] | None) -> tuple[float, float]:
    """First and last position; 0 and 0 for none."""
    if stroke is None:
        return 0.0, 0.0
    ends = tuple(stroke) if np.ndim(stroke) == 1 else ()  # type: ignore[arg-type]
    if not (len(ends) == 2 and all(finite(end) for end in ends) and ends[0] < ends[1]):
        raise UserError("no stroke", where="stroke", received=stroke,
                        allowed="two positions, the lower one first, or none")  # fmt: skip
    return float(ends[0]), float(ends[1])


def _loop(interval: float, delay: float, bandwidth: float) -> None:
    """Raise :class:`UserError` for a cycle or a delay that an observer of this bandwidth, Hz, is too fast for."""
    for name, value, most, why in (
        ("interval", interval, 0.5 / bandwidth, "two cycles in a period of the bandwidth"),
        ("delay", delay, 1.0 / bandwidth, "one period of the bandwidth"),
    ):
        if not value < most:
            raise UserError("loop too slow for the bandwidth", where=name, received=value,
                            allowed=f"below {most:.3g} s, {why} of {bandwidth:g} Hz",
                            fix="seconds are meant; or lower the bandwidth")  # fmt: skip
