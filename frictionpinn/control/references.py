"""Motions that an axis is asked for: position, velocity and acceleration at any time."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable

import numpy as np

from ..errors import UserError, choose
from ..online.check import finite

Reference = Callable[[np.ndarray], np.ndarray]  # times (n,) -> position, velocity, acceleration (n, 3)
CORNER = 0.02  # s, of a triangle: the time in which it turns
HARMONICS = ((0.31, 1.0, 0.0), (0.73, 0.5, 1.1), (1.37, 0.25, 2.3), (2.41, 0.12, 0.4))  # Hz, share of amplitude, phase


def triangle(amplitude: float, period: float) -> Reference:
    """Constant speed there and back, from rest at 0, turning at constant acceleration within ``CORNER`` seconds."""
    if period < 4 * CORNER:
        raise UserError("triangle that turns before it has speed", where="reference.period", received=period,
                        allowed=f"{4 * CORNER:g} s or more: a turn takes {CORNER:g} s", fix="take a sine")  # fmt: skip
    speed = 4 * amplitude / period

    def at(t: np.ndarray) -> np.ndarray:
        t = np.maximum(np.asarray(t, dtype=float), 0.0)
        q, v, a = np.zeros_like(t), np.full_like(t, speed), np.zeros_like(t)
        start = np.minimum(t, CORNER / 2)  # from rest to speed
        rate = speed / (CORNER / 2)
        q, v = rate * start**2 / 2 + speed * (t - start), rate * start
        a = np.where(t < CORNER / 2, rate, 0.0)
        for k in range(int(t.max() / (period / 2)) + 2):  # every turn adds twice the speed the other way
            sign, since = -1.0 if k % 2 == 0 else 1.0, t - (period / 4 + k * period / 2) + CORNER / 2
            inside = np.clip(since, 0.0, CORNER)
            rate = 2 * speed / CORNER
            q += sign * (rate * inside**2 / 2 + 2 * speed * np.maximum(since - CORNER, 0.0))
            v += sign * rate * inside
            a += sign * rate * ((since > 0) & (since < CORNER))
        return np.stack([q, v, a], axis=-1)

    return at


def sine(amplitude: float, period: float, phase: float = 0.0) -> Reference:
    """amplitude (sin(w t + phase) - sin(phase)), begun from rest over the first quarter of a period."""
    w = 2 * np.pi / period
    return _ramped(lambda t: _harmonic(amplitude, w, phase, t), period / 4)


def multisine(amplitude: float, period: float) -> Reference:
    """A sum of four sines without a common period, begun from rest over the first quarter of ``period``."""

    def at(t: np.ndarray) -> np.ndarray:
        parts = [_harmonic(share * amplitude, 2 * np.pi * f * 2 / period, phase, t) for f, share, phase in HARMONICS]
        return np.sum(parts, axis=0)

    return _ramped(at, period / 4)


def point_to_point(amplitude: float, period: float) -> Reference:
    """Minimum-jerk moves of 2 amplitude there and back in a quarter of the period each, with rests as long."""

    def at(t: np.ndarray) -> np.ndarray:
        phase = np.mod(np.asarray(t, dtype=float), period) / (period / 4)
        x = np.where(phase < 1, phase, np.where(phase < 2, 1.0, np.where(phase < 3, 3 - phase, 0.0)))
        back = np.where((phase >= 2) & (phase < 3), -1.0, 1.0)
        moving, size, scale = (x > 0) & (x < 1), 2 * amplitude, 4 / period
        q = size * x**3 * (10 - 15 * x + 6 * x**2)
        v = np.where(moving, back * size * 30 * x**2 * (1 - x) ** 2 * scale, 0.0)
        a = np.where(moving, size * 60 * x * (1 - x) * (1 - 2 * x) * scale**2, 0.0)
        return np.stack([q, v, a], axis=-1)

    return at


def _harmonic(amplitude: float, w: float, phase: float, t: np.ndarray) -> np.ndarray:
    angle = w * t + phase
    rows = (np.sin(angle) - np.sin(phase), w * np.cos(angle), -(w**2) * np.sin(angle))
    return amplitude * np.stack(rows, axis=-1)


def _ramped(path: Reference, over: float) -> Reference:
    """The path in a time that begins at rest: tau = t - over/2 after a smooth start."""

    def at(t: np.ndarray) -> np.ndarray:
        x = np.clip(np.asarray(t, dtype=float) / over, 0.0, 1.0)
        rate, curve = 3 * x**2 - 2 * x**3, np.where(x < 1, (6 * x - 6 * x**2) / over, 0.0)
        own = over * (x**3 - x**4 / 2) + np.maximum(t - over, 0.0)
        q, v, a = np.moveaxis(path(own), -1, 0)
        return np.stack([q, v * rate, a * rate**2 + v * curve], axis=-1)

    return at


def halted(path: Reference, at_time: float, over: float = 0.1) -> Reference:
    """The path up to a time, then smoothly to rest: its own time slows down within ``over`` seconds."""

    def at(t: np.ndarray) -> np.ndarray:
        t = np.asarray(t, dtype=float)
        x = np.clip((t - at_time) / over, 0.0, 1.0)
        rate, curve = 1 - 3 * x**2 + 2 * x**3, np.where((x > 0) & (x < 1), -(6 * x - 6 * x**2) / over, 0.0)
        own = np.minimum(t, at_time) + over * (x - x**3 + x**4 / 2)
        q, v, a = np.moveaxis(path(own), -1, 0)
        return np.stack([q, v * rate, a * rate**2 + v * curve], axis=-1)

    return at


REFERENCES: dict[str, Callable[..., Reference]] = {
    "triangle": triangle,
    "sine": sine,
    "point_to_point": point_to_point,
    "multisine": multisine,
}


def reference(name: str, amplitude: float, period: float, **options: float) -> Reference:
    """A reference by name; amplitude in the unit of position, period in s, of a sine its phase in rad.

    Raises:
        UserError: an unknown name or option, an amplitude or a period that is not above 0, a triangle too fast to turn.
    """
    make = choose(name, REFERENCES, "reference")
    known = list(inspect.signature(make).parameters)[2:]
    for key, value in {"amplitude": amplitude, "period": period, **options}.items():
        if key in options and key not in known:
            raise UserError("unknown option", where=f"reference.{key}", allowed=", ".join(known) or f"none of a {name}")
        if not (finite(value) and (key in options or value > 0)):
            allowed = "a finite number" + ("" if key in options else " above 0")
            raise UserError("impossible value", where=f"reference.{key}", received=value, allowed=allowed)
    return make(amplitude, period, **options)


def stroke(paths: Iterable[Reference], duration: float) -> tuple[float, float]:
    """First and last position of motions of so many seconds."""
    t = np.linspace(0.0, duration, 1 + round(1e3 * duration))
    q = np.concatenate([path(t)[:, 0] for path in paths])
    return float(q.min()), float(q.max())
