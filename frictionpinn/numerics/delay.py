"""Paths and samples shifted in time, exactly for the path that is given, with the derivative in the shift."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from .paths import DEGREE, Directions

_NODES = (1 - np.cos(np.pi * np.arange(DEGREE + 1) / DEGREE)) / 2  # ends included: the shifted pieces join
_FROM_NODES = np.linalg.inv(_NODES[:, None] ** np.arange(DEGREE + 1))
_POWERS = np.arange(DEGREE + 1)


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
    piece, weights = _weights(t, shift, rate)
    values = np.einsum("kjd,kjud->kuj", weights, coefficients[piece])
    return (values @ _FROM_NODES.T) / np.diff(t)[:, None, None] ** _POWERS


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
    coefficients, h = directions.coefficients.copy(), np.diff(t)
    for shift, columns in together(shifts):
        coefficients[:, :, columns] = 0.0
        piece, weights = _weights(t, shift)
        low, high = piece.min(axis=1), piece.max(axis=1)
        for given, made, (first, last) in zip(directions.coefficients, coefficients, directions.support, strict=True):
            near = np.flatnonzero((high >= first) & (low <= last))
            if len(near):
                there = slice(near[0], near[-1] + 1)
                values = np.einsum("kjd,kjud->kuj", weights[there], given[:, columns][piece[there]])
                made[there, columns] = (values @ _FROM_NODES.T) / h[there, None, None] ** _POWERS
    return directions.moved(coefficients, t)  # what acts first still does


def _weights(t: np.ndarray, shift: float, rate: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Piece in which each of the six times of a shifted piece lies, (n - 1, 6), and the weights of its powers there."""
    h = np.diff(t)
    times = t[:-1, None] + h[:, None] * _NODES - shift
    piece = np.clip(np.searchsorted(t, times, side="right") - 1, 0, len(h) - 1)
    offset = times - t[piece]
    inside = np.clip(offset, 0.0, h[piece])
    powers = inside[..., None] ** _POWERS
    slopes = np.zeros_like(powers)
    slopes[..., 1:] = powers[..., :-1] * _POWERS[1:]
    return piece, -slopes if rate else powers + (offset - inside)[..., None] * slopes


def shift_samples(t: np.ndarray, y: np.ndarray, slope: np.ndarray, shift: float) -> tuple[np.ndarray, np.ndarray]:
    """y(t - shift) and its derivative in the shift, from samples and slopes joined by cubic Hermite pieces.

    Args:
        t: s, shape (n,).
        y, slope: shape (n, ...); the result is linear in them. Straight lines continue the ends.
        shift: s.
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
    return value + column(times - inside) * rate, -rate
