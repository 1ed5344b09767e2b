"""Paths and samples shifted in time, exactly for the path that is given, with the derivative in the shift."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numba import njit

from .paths import DEGREE

_NODES = (1 - np.cos(np.pi * np.arange(DEGREE + 1) / DEGREE)) / 2  # ends included: the shifted pieces join
_FROM_NODES = np.linalg.inv(_NODES[:, None] ** np.arange(DEGREE + 1))
Jumps = Sequence[tuple[int, float]]
_OPTIONS: dict[str, Any] = {"cache": True, "nogil": True, "error_model": "numpy"}  # compiled where something is late


def shift_pieces(t: np.ndarray, coefficients: np.ndarray, shift: float, *, rate: bool = False) -> np.ndarray:
    """Pieces of u(t - shift), straight lines before the first and after the last sample; with ``rate`` of the
    derivative in the shift.

    Each new piece meets the shifted path at six times; so the map is linear in the path, and where the path is a
    polynomial of degree 5 over two pieces it is exact.

    Args:
        t: times of the pieces' ends, s, shape (n,).
        coefficients: shape (n - 1, columns, 6), powers of t - t_k.
        shift: s, of any sign.
    """
    return _shifted(t, np.ascontiguousarray(coefficients), *_weights(t, shift, rate))


def together(shifts: Mapping[int, float]) -> list[tuple[float, slice | list[int]]]:
    """Columns by their shift: a slice where they stand side by side."""
    result: list[tuple[float, slice | list[int]]] = []
    for shift in dict.fromkeys(shifts.values()):
        columns = sorted(column for column, own in shifts.items() if own == shift)
        beside = columns[-1] - columns[0] == len(columns) - 1
        result.append((shift, slice(columns[0], columns[-1] + 1) if beside else columns))
    return result


@njit(**_OPTIONS)
def _weights(t, shift, rate):
    """Piece in which each of the six times of a shifted piece lies, (n - 1, 6), and the weights of its powers there."""
    n, count = len(t) - 1, len(_NODES)
    piece, weights = np.empty((n, count), np.int64), np.empty((n, count, count))
    for j in range(count):
        own = 0
        for k in range(n):
            time = t[k] + (t[k + 1] - t[k]) * _NODES[j] - shift
            while own < n - 1 and time >= t[own + 1]:
                own += 1
            offset = time - t[own]
            inside = min(max(offset, 0.0), t[own + 1] - t[own])
            piece[k, j] = own
            power, slope = 1.0, 0.0  # of inside^d
            for d in range(count):
                weights[k, j, d] = -slope if rate else power + (offset - inside) * slope
                slope = (d + 1) * power
                power *= inside
    return piece, weights


@njit(**_OPTIONS)
def _shifted(t, given, piece, weights):
    """Pieces of the shifted columns."""
    made, count = np.empty(given.shape), given.shape[2]
    values = np.empty(count)
    for k in range(len(t) - 1):
        per = 1 / (t[k + 1] - t[k])
        for column in range(given.shape[1]):
            for j in range(count):
                values[j] = 0.0
                for d in range(count):
                    values[j] += weights[k, j, d] * given[piece[k, j], column, d]
            scale = 1.0
            for d in range(count):
                total = 0.0
                for j in range(count):
                    total += _FROM_NODES[d, j] * values[j]
                made[k, column, d] = total * scale
                scale *= per
    return made


def slopes(t: np.ndarray, y: np.ndarray, jumps: Jumps = ()) -> np.ndarray:
    """Slopes of samples, shape (n, ...): central differences, and beside a jump those of its own side."""
    slope = np.gradient(y, t, axis=0)
    for k, _ in jumps:
        if 0 < k < len(t) - 2:
            slope[k] = (y[k] - y[k - 1]) / (t[k] - t[k - 1])
            slope[k + 1] = (y[k + 2] - y[k + 1]) / (t[k + 2] - t[k + 1])
    return slope


def shift_samples(
    t: np.ndarray, y: np.ndarray, slope: np.ndarray, shift: float, jumps: Jumps = ()
) -> tuple[np.ndarray, np.ndarray]:
    """y(t - shift) and its derivative in the shift, from samples and slopes joined by cubic Hermite pieces.

    Args:
        t: s, shape (n,).
        y, slope: shape (n, ...); the result is linear in them. Straight lines continue the ends.
        shift: s.
        jumps: sample before a jump and its time, s: between these samples both sides go on straight up to there.
    """
    h = np.diff(t)
    times = t - shift
    k = np.clip(np.searchsorted(t, times, side="right") - 1, 0, len(h) - 1)
    inside = np.clip(times, t[0], t[-1])

    def column(values: np.ndarray) -> np.ndarray:
        return values.reshape(-1, *[1] * (y.ndim - 1))

    x, width = (inside - t[k]) / h[k], h[k]
    value = column(1 - x**2 * (3 - 2 * x)) * y[k] + column(x**2 * (3 - 2 * x)) * y[k + 1]
    value += column(width * x * (1 - x) ** 2) * slope[k] - column(width * x**2 * (1 - x)) * slope[k + 1]
    rate = column(6 * x * (1 - x) / width) * (y[k + 1] - y[k])
    rate += column((1 - x) * (1 - 3 * x)) * slope[k] + column(x * (3 * x - 2)) * slope[k + 1]
    for before, at in jumps:
        for i in np.flatnonzero(k == before):
            side = before if inside[i] < at else before + 1
            value[i], rate[i] = y[side] + (inside[i] - t[side]) * slope[side], slope[side]
    return value + column(times - inside) * rate, -rate
