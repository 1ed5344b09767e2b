"""A PID controller of the position, with anti-windup beside what others add to its torque."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from ..numerics.integrator import OPTIONS
from ..online.check import check_above

INTEGRAL, RATE, LAST, BEGUN = 0, 1, 2, 3  # places in the memory
FILTER = 1e-3  # s: low-pass of the error's rate where none is given


class Gains(NamedTuple):
    """Gains of u = kp e + ki int e + kd e_f', and what limits it; e_f' is the error's rate through a low-pass.

    Attributes:
        kp, ki, kd: force per position, per position and second, per velocity.
        filter: time constant of the low-pass, s.
        limit: largest torque of controller and all that is added to it.
        dead: error, in the unit of position, up to which a reference at rest leaves the integral alone.
    """

    kp: float
    ki: float
    kd: float
    filter: float
    limit: float
    dead: float


@njit(**OPTIONS)
def pid(gains, memory, reference, reading, added, h):
    """Torque of one cycle, limited, ``added`` included; the integral runs back as far as the limit holds it back.

    Args:
        memory: shape (4,), written; zeros at the start.
        reference: position, velocity and acceleration wanted now, shape (3,).
        reading: of the position.
        added: torque that is added, feed-forward and compensation.
        h: cycle, s.
    """
    error = reference[0] - reading
    if memory[BEGUN] == 0.0:
        memory[LAST], memory[RATE], memory[BEGUN] = error, 0.0, 1.0
    memory[RATE] += h / (gains.filter + h) * ((error - memory[LAST]) / h - memory[RATE])
    memory[LAST] = error
    wanted = gains.kp * error + memory[INTEGRAL] + gains.kd * memory[RATE] + added
    torque = min(max(wanted, -gains.limit), gains.limit)
    if reference[1] != 0.0 or abs(error) > gains.dead:
        back = gains.ki / gains.kp * (torque - wanted)
        memory[INTEGRAL] += h * (gains.ki * error + back)
    return torque


def loop_dead_time(delay: float, interval: float, filter: float = FILTER) -> float:
    """Dead time to tune with, s: delay from a command to its effect, half of the hold, low-pass of the error's rate."""
    return delay + interval / 2 + filter


def tuned(inertia: float, dead_time: float, sensitivity: float = 1.4, filter: float = FILTER,
          limit: float = 1e9, dead: float = 0.0) -> Gains:  # fmt: skip
    """The fastest triple pole whose maximum sensitivity stays below a bound, on the axis without friction.

    The loop is (kd s / (T s + 1) + kp + ki / s) exp(-s dead_time) / (inertia s^2) with kp = 3 m w^2, ki = m w^3,
    kd = 3 m w; w is the largest with max |1 / (1 + L)| at most ``sensitivity``.

    Args:
        inertia: kg or kg m^2.
        dead_time: from a reading to the middle of its command's effect, s, see :func:`loop_dead_time`.
        sensitivity: bound of Ms, above 1; 1.4 is the robust choice of the source.
        filter, limit, dead: see :class:`Gains`.

    Raises:
        UserError: an inertia or a dead time that is not above 0, a sensitivity not above 1.

    Source: Astrom and Hagglund, Advanced PID Control (2006), 4.5.
    """
    check_above("inertia", inertia, 0.0)
    check_above("dead_time", dead_time, 0.0)
    check_above("sensitivity", sensitivity, 1.0)
    x = np.geomspace(1e-2, 30.0, 400)  # frequencies, in units of w

    def peak(w: float) -> float:
        return float(np.abs(1 / (1 + _loop(w * x, w, dead_time, filter))).max())

    low, high = 1e-3 / dead_time, 1.0 / dead_time
    for _ in range(60):
        middle = math.sqrt(low * high)
        low, high = (middle, high) if peak(middle) <= sensitivity else (low, middle)
    w, m = low, inertia
    return Gains(3 * m * w**2, m * w**3, 3 * m * w, filter, limit, dead)


def _loop(frequency: np.ndarray, w: float, dead_time: float, filter: float) -> np.ndarray:
    """Frequency response of the open loop, frequencies in rad/s."""
    s = 1j * frequency
    return (3 * w * s / (filter * s + 1) + 3 * w**2 + w**3 / s) * np.exp(-s * dead_time) / s**2


def delay_margin(gains: Gains, dead_time: float) -> float:
    """How much more delay a loop of :func:`tuned` bears than it was tuned for, s: phase margin over crossover."""
    w = 3 * gains.ki / gains.kp
    frequency = w * np.geomspace(1e-2, 30.0, 4000)
    loop = _loop(frequency, w, dead_time, gains.filter)
    crossover = np.flatnonzero(np.abs(loop) >= 1.0)[-1]
    margin = float(np.angle(-loop[crossover]))  # from -180 degrees, which the low-pass does not reach below crossover
    return margin / float(frequency[crossover])


class Controller:
    """The same, for use from Python one cycle at a time.

    Args:
        gains: see :func:`tuned`.
        interval: cycle, s.
    """

    def __init__(self, gains: Gains, interval: float):
        self.gains, self.interval, self._memory = gains, float(interval), np.zeros(4)

    def update(self, reference: np.ndarray, position: float, added: float = 0.0) -> float:
        """Torque of one cycle, limited, ``added`` in it; reference: position, velocity, acceleration, shape (3,)."""
        wanted = np.asarray(reference, dtype=float)
        return float(pid(self.gains, self._memory, wanted, float(position), float(added), self.interval))

    def reset(self) -> None:
        """Forget all cycles."""
        self._memory[:] = 0.0
