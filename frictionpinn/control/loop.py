"""A closed loop, compiled: plant, encoder, delay, controller, compensator."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from numba import njit, types

from ..errors import UserError
from ..numerics.codegen import Kernels, pointer
from ..numerics.integrator import OK, OPTIONS, integrate
from ..numerics.tableau import METHOD
from ..online.check import check_above
from ..physics.mechanism import Mechanism
from .compensator import Command, Compensator, check_axis, completed
from .pid import Gains, pid
from .recursions import cycle, inputs, remember

PARTS = 2  # a delay is a whole number of such parts of a cycle
RTOL, ATOL, TOLERANCE = 1e-4, 1e-6, 1e-2


class Foreign(NamedTuple):
    """Another simulator's model as addresses: its step, model and data, and views on what it reads and writes.

    Attributes:
        step: void(int64 model, int64 data), one step of ``friction.h`` seconds.
        model, data: addresses.
        q, v, applied: positions, velocities, applied forces, shape (n,) each; the axis is the first.
        steps: in a part of a cycle; 0 where there is no such model.
    """

    step: Any
    model: int
    data: int
    q: np.ndarray
    v: np.ndarray
    applied: np.ndarray
    steps: int


class Body(NamedTuple):
    """The plant's own equations: kernels, parameters and the integrator's tableau."""

    newton: Any
    a: np.ndarray
    c: np.ndarray
    error: np.ndarray
    order: int
    atol: np.ndarray
    places: np.ndarray


@njit(**OPTIONS)
def move(body, plan, foreign, s, w, torque, t):
    """The plant a part of a cycle later, s and w written in place. Returns whether it could be solved."""
    n_s, n_w, n_u, _ = plan.sizes
    if foreign.steps > 0:
        seen, u = np.zeros(3), inputs(plan, 0.0, t)
        out, matrix, pivots = np.zeros(n_w + n_w * (n_s + n_w) + 1), np.empty((n_w, n_w)), np.empty(n_w, np.int64)
        for _ in range(foreign.steps):
            s[0], s[1] = foreign.q[0], foreign.v[0]
            remember(plan, s, w, u, plan.p, out, matrix, pivots)
            plan.outputs(s, w, u, plan.p, seen)
            foreign.applied[0] = torque - seen[2]
            foreign.step(foreign.model, foreign.data)
        s[0], s[1] = foreign.q[0], foreign.v[0]
        return np.isfinite(s[0])
    coefficients = np.zeros((1, n_u, 2))
    coefficients[0, :, 0] = inputs(plan, torque, t)
    for i in range(plan.clocks.shape[0]):
        coefficients[0, plan.clocks[i, 0], 1] = float(plan.clocks[i, 1])
    found = integrate(
        body.newton, body.a, body.c, body.error, body.order, np.array([0.0, plan.h]), coefficients, plan.p, 1,
        body.atol, body.places, RTOL, TOLERANCE, s, np.empty(0, np.int64), np.empty((0, 2)),
    )  # fmt: skip
    if found[0] != OK:
        return False
    s[:], w[:] = found[2][1], found[3][1]
    return True


@njit(**OPTIONS)
def run(body, plan, foreign, state, gains, h, resolution, late, compensates, own, memory, now, ahead, base, log, span):
    """Close the loop over a span of cycles.

    Args:
        state: s, w, the controller's memory, pending torques (newest first), result of the compensator: all written.
        late: parts of a cycle from a command to its effect.
        compensates: whether ``own`` and ``memory`` are asked; else the result in ``state`` is taken as it stands.
        now, ahead: reference at every cycle, and at the middle of its command's effect, shape (n, 3).
        base: torque that the controller adds along the reference in any case, shape (n,).
        log: receives position, velocity, friction force, reading, torque, compensation and its interval, shape (n, 8).
        span: first cycle, and the one after the last.

    Returns:
        the cycle at which the plant could not be solved, or the end of the span.
    """
    s, w, controller, pending, result = state
    seen, u = np.zeros(3), inputs(plan, 0.0, 0.0)
    for k in range(span[0], span[1]):
        reading = encoder(s[0], resolution)
        if compensates:
            cycle(own, memory, ahead[k], reading, pending[0], result)
        torque = pid(gains, controller, now[k], reading, base[k] + result[0], h)
        seen[:] = 0.0
        plan.outputs(s, w, u, plan.p, seen)
        log[k, 0], log[k, 1], log[k, 2], log[k, 3], log[k, 4] = s[0], s[1], seen[2], reading, torque
        log[k, 5], log[k, 6], log[k, 7] = result[0], result[1], result[2]
        for i in range(pending.shape[0] - 1, 0, -1):
            pending[i] = pending[i - 1]
        pending[0] = torque
        for part in range(PARTS):
            acting = pending[(late - part + PARTS - 1) // PARTS]  # the command of so many cycles ago
            if not move(body, plan, foreign, s, w, acting, k * h + part * plan.h):
                return k
    return span[1]


@njit(**OPTIONS)
def encoder(position, resolution):
    """What an encoder shows."""
    return np.round(position / resolution) * resolution


_STEP = types.FunctionType(types.void(types.int64, types.int64))


class Address:
    """A function of another library, void(int64, int64), by its address."""

    _numba_type_ = _STEP

    def __init__(self, address: int):
        self.address = address

    def __wrapper_address__(self) -> int:
        return self.address


# An address must be positive; at 0 steps it is never called.
_NOWHERE = Foreign(Address(1), 0, 0, np.zeros(1), np.zeros(1), np.zeros(1), 0)


@dataclass(frozen=True)
class Plant:
    """An axis that is controlled: its equations, and what stands between it and its controller.

    Attributes:
        mechanism, parameters: the truth, SI units.
        resolution: step of the encoder, in the unit of position.
        delay: from a command to its effect, s, a whole number of half cycles.
        limit: largest torque.
        foreign: makes the same axis in another simulator, from the plant and the length of a part of a cycle; then only
            friction is taken from the mechanism.
    """

    mechanism: Mechanism
    parameters: Mapping[str, float]
    resolution: float
    delay: float
    limit: float
    foreign: Callable[[Plant, float], tuple[Foreign, float, Any]] | None = None


class Adds(Protocol):
    """What a closed loop asks of a compensator, see :class:`Compensator`."""

    def update(self, reference: Sequence[float], position: float, torque: float) -> Command: ...

    def reset(self) -> None: ...


@dataclass(frozen=True)
class Loop:
    """A closed loop that ran: samples at every cycle, shape (n,) each, SI units.

    ``error`` is reference minus position; ``reading`` what the encoder showed; ``torque`` what was commanded,
    ``added`` the compensation in it with its interval ``low`` to ``high``; ``friction`` the true force.
    """

    t: np.ndarray
    reference: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    friction: np.ndarray
    reading: np.ndarray
    torque: np.ndarray
    added: np.ndarray
    low: np.ndarray
    high: np.ndarray

    @property
    def error(self) -> np.ndarray:
        return self.reference[:, 0] - self.position


@njit(**OPTIONS)
def _inverse(plan, reference):
    """Torque of the motion along a reference, less friction, shape (n,)."""
    n_s, n_w, _, _ = plan.sizes
    found, u = np.zeros(reference.shape[0]), inputs(plan, 0.0, 0.0)
    s, w, out, seen = np.zeros(n_s), np.zeros(n_w), np.zeros(n_w + n_w * (n_s + n_w) + 1), np.zeros(3)
    for k in range(reference.shape[0]):
        s[0], s[1], w[0] = reference[k, 0], reference[k, 1], reference[k, 2]
        plan.newton(s, w, u, plan.p, out)
        plan.outputs(s, w, u, plan.p, seen)
        found[k] = out[0] - seen[2]
    return found


def close(
    plant: Plant,
    gains: Gains,
    reference: Callable[[np.ndarray], np.ndarray],
    duration: float,
    compensator: Adds | None = None,
    model: tuple[Mechanism, Mapping[str, float]] | None = None,
    interval: float = 1e-3,
    delay: float = 0.0,
) -> Loop:
    """Run an axis along a reference.

    Args:
        reference: times (n,) -> position, velocity, acceleration (n, 3).
        duration: s.
        compensator: what is added to the controller, a :class:`Compensator` (compiled) or any object with ``update``
            and ``reset`` like its; None: nothing.
        model: axis and parameters from which the controller computes the torque of the motion without friction, for
            which those of the law are not needed.
        interval: cycle, s.
        delay: that controller and compensator believe in, s.

    Raises:
        UserError: a plant that is no axis, a time without a cycle, a delay that is no whole number of half cycles, a
            motion that cannot be simulated.
    """
    check_axis(plant.mechanism)
    check_above("interval", interval, 0.0)
    check_above("duration", duration, 0.0)
    if round(duration / interval) < 1:
        raise UserError("no cycle", where="duration", received=duration, allowed=f"{interval:g} s, a cycle, or more")
    part = interval / PARTS
    late = round(plant.delay / part)
    if plant.delay < 0 or abs(late * part - plant.delay) > 1e-9:
        raise UserError(
            "impossible delay", where="delay", received=plant.delay, allowed=f"0 and multiples of {part:g} s"
        )
    kernels = Kernels(plant.mechanism)
    n_s, n_w, _, _ = kernels.sizes
    n = round(duration / interval)
    t = np.arange(n) * interval
    now, ahead = reference(t), reference(t + delay + interval / 2)
    base = _inverse(Compensator(model[0], completed(*model)).plan, ahead) if model else np.zeros(n)
    foreign, step, kept = plant.foreign(plant, part) if plant.foreign else (_NOWHERE, part, None)
    own = Compensator(plant.mechanism, plant.parameters, interval=step).plan
    atol = np.full(n_s, ATOL * part)
    atol[1] = ATOL
    body = Body(pointer(kernels.plain.newton), METHOD.a, METHOD.c, METHOD.error, METHOD.order_error, atol,
                kernels.places)  # fmt: skip
    compiled = isinstance(compensator, Compensator)
    helper = compensator if isinstance(compensator, Compensator) else Compensator(plant.mechanism, plant.parameters)
    if compensator is not None:
        compensator.reset()
    s, log, result = np.zeros(n_s), np.zeros((n, 8)), np.zeros(3)
    s[0] = now[0, 0]
    state = (s, np.zeros(n_w), np.zeros(4), np.zeros(late // PARTS + 2), result)
    fixed = (body, own, foreign, state, gains, float(interval), float(plant.resolution), late, compiled, helper.plan,
             helper.memory, now, ahead, base, log)  # fmt: skip
    if compiled or compensator is None:
        done = run(*fixed, (0, n))
    else:
        for k in range(n):
            command = compensator.update(ahead[k], float(encoder(s[0], plant.resolution)), float(state[3][0]))
            result[:] = command.torque, command.low, command.high
            done = run(*fixed, (k, k + 1))
            if done == k:
                break
    del kept  # the other simulator's model lived until here
    if done < n:
        raise UserError("plant that cannot be simulated", where=f"t = {done * interval:.3f} s", fix="lower the gains")
    return Loop(t, now, *log.T)
