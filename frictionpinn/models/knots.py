"""Knots over slip velocity and load at which a network with memory is read, and its tables between them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import torch
from torch import Tensor

KNOTS, LOADS = 81, 3  # velocities (asinh-spaced, a factor 1.25 apart) and loads
REACH = 2.0  # times the fastest training sample: where the tables end
REST = 1e-3  # of the root mean square velocity: below it the knots lie evenly


def knots_of(scales: Mapping[str, float], odd: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The knots of a contact.

    Args:
        scales: of its training samples, see :class:`.state.StateModel`.
        odd: whether friction is the same in both directions: the network then sees the speed.

    Returns:
        v0, first and step of asinh(v / v0), first load and step; velocity and load of every knot, (knots, 2); what the
        network sees of them, about -2 to 2, (knots, 2).
    """
    v0, fastest = REST * scales["velocity"], REACH * scales["fastest"]
    ends = np.arcsinh(fastest / v0)
    low, high = scales["load_low"], scales["load_high"]
    margin = max(0.2 * (high - low), 0.05 * high)
    u, N = np.linspace(-ends, ends, KNOTS), np.linspace(low - margin, high + margin, LOADS)
    grid = np.array([v0, u[0], u[1] - u[0], N[0], N[1] - N[0]])
    knots = np.stack(np.meshgrid(v0 * np.sinh(u), N, indexing="ij"), axis=-1).reshape(-1, 2)
    slow = np.arcsinh(knots[:, 0] / v0) / ends
    slow = np.abs(slow) if odd else slow
    return grid, knots, 2 * np.stack([slow, (knots[:, 1] - N.mean()) / (N[-1] - N[0])], axis=1)


def cells(grid: np.ndarray, v: Tensor, N: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Shares and cells of points in the tables."""
    v0, first, step, lowest, apart = grid
    x = ((torch.asinh(v / v0) - first) / step).clamp(0, KNOTS - 1)
    y = ((N - lowest) / apart).clamp(0, LOADS - 1)
    i, j = x.long().clamp_max(KNOTS - 2), y.long().clamp_max(LOADS - 2)
    return x - i, y - j, i, j


def read(grid: np.ndarray, tables: Tensor, v: Tensor, N: Tensor) -> Tensor:
    """The tables, shape (K + 1, velocities, loads), at points, shape (n, K + 1)."""
    x, y, i, j = cells(grid, v, N)
    x, y = x[:, None], y[:, None]
    near, far = (tables[:, i + k].transpose(0, 1) for k in (0, 1))
    at = torch.arange(len(v), device=v.device)
    sides = [(1 - y) * side[at, :, j] + y * side[at, :, j + 1] for side in (near, far)]
    return (1 - x) * sides[0] + x * sides[1]
