"""Paths and samples shifted in time, exactly for the path that is given, with the derivative in the shift."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numba import njit

from .directions import Directions
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
    made, columns = np.empty(coefficients.shape), np.arange(coefficients.shape[1])
    piece, weights = _weights(t, shift, rate)
    _shifted(t, np.ascontiguousarray(coefficients), columns, piece, weights, 0, len(t) - 2, made)
    return made


def together(shifts: Mapping[int, float]) -> list[tuple[float, slice | list[int]]]:
    """Columns by their shift: a slice where they stand side by side."""
    result: list[tuple[float, slice | list[int]]] = []
    for shift in dict.fromkeys(shifts.values()):
        columns = sorted(column for column, own in shifts.items() if own == shift)
        beside = columns[-1] - columns[0] == len(columns) - 1
        result.append((shift, slice(columns[0], columns[-1] + 1) if beside else columns))
    return result


def shift_directions(t: np.ndarray, directions: Directions, shifts: Mapping[int, float]) -> Directions:
    """Directions of paths some of whose columns act late, column -> s: each where it acts alone."""
    given, support = directions.coefficients, directions.support.copy()
    coefficients, places = np.zeros_like(given), np.arange(given.shape[2])
    prompt = [column for column in places if column not in shifts]
    coefficients[:, :, prompt] = given[:, :, prompt]
    for shift, columns in together(shifts):
        piece, weights = _weights(t, shift, False)
        low, high = piece.min(axis=1), piece.max(axis=1)
        for k, (first, last) in enumerate(directions.support):
            near = np.flatnonzero((high >= first) & (low <= last))
            if len(near):
                ends = int(near[0]), int(near[-1])
                _shifted(t, given[k], places[columns], piece, weights, *ends, coefficients[k])
                support[k] = min(support[k, 0], ends[0]), max(support[k, 1], ends[1])
    support[:, 0] = np.minimum.accumulate(support[::-1, 0])[::-1]  # in order still: too early costs little
    return Directions.between_samples(directions.names, t, coefficients, support, directions.order)


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
def _shifted(t, given, columns, piece, weights, first, last, made):
    """Pieces first to last of the shifted columns into ``made``."""
    count = given.shape[2]
    values = np.empty(count)
    for k in range(first, last + 1):
        per = 1 / (t[k + 1] - t[k])
        for column in columns:
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
