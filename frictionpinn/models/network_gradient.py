"""Value, rate and gradient of a network by hand: what the members of an ensemble are trained with on a CPU.

The same arithmetic as torch.func's ``jvp`` under autograd in half the passes over memory: value and rate go through
each layer's matrix product together, slope and curvature of the activation are computed once, and what a layer leaves
is overwritten where it is not needed again (benchmarks/ensemble.py).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np
import torch
from torch import Tensor

from ..numerics import activations
from .network import FrictionNetwork

Derivatives = tuple[Tensor, Tensor | None]
Activation = Callable[[Tensor, Tensor | None], Derivatives]


def _silu(a: Tensor, rate: Tensor | None) -> Derivatives:
    slope = torch.sigmoid(a)
    if rate is None:
        activations.silu(_flat(a), _flat(slope))
        return slope, None
    bend = torch.empty_like(a)
    activations.silu_with_rate(_flat(a), _flat(slope), _flat(rate), _flat(bend))
    return slope, bend


def _flat(values: Tensor) -> np.ndarray:
    return values.view(-1).numpy()


def _plain(function: Callable[[Tensor], tuple[Tensor, Tensor, Tensor]]) -> Activation:
    """From a function that gives value, slope and curvature."""

    def activate(a: Tensor, rate: Tensor | None) -> Derivatives:
        value, slope, curvature = function(a)
        a.copy_(value)
        if rate is None:
            return slope, None
        bend = curvature * rate
        rate.mul_(slope)
        return slope, bend

    return activate


@_plain
def _tanh(a: Tensor):
    value = a.tanh()
    slope = 1 - value.square()
    return value, slope, -2 * value * slope


@_plain
def _softplus(a: Tensor):
    slope = torch.sigmoid(a)
    return torch.nn.functional.softplus(a), slope, slope - slope.square()


@_plain
def _relu(a: Tensor):
    return a.relu(), (a > 0).to(a.dtype), torch.zeros_like(a)


@_plain
def _gelu(a: Tensor):
    share, density = torch.special.ndtr(a), torch.exp(-a.square() / 2) / math.sqrt(2 * math.pi)
    return a * share, share + a * density, (2 - a.square()) * density


# What each does to its argument a and the rate of a, in place: they become the value and its rate. Returned are the
# slope there and, with a rate, the curvature times the rate of a.
ACTIVATE: dict[str, Activation] = {"silu": _silu, "tanh": _tanh, "softplus": _softplus, "relu": _relu, "gelu": _gelu}


# An operator of torch's own compiler, not of its public interface: a version without it takes the plain product.
ONEDNN = torch.backends.mkldnn.is_available() and hasattr(torch.ops.mkldnn, "_linear_pointwise")


def product(x: Tensor, weight: Tensor) -> Tensor:
    """x weight^T. oneDNN's, where torch has it, is more than twice as fast as MKL's on some processors."""
    if ONEDNN and x.dtype == torch.float32:
        return torch.ops.mkldnn._linear_pointwise(x, weight, None, "none", [], "")
    return x @ weight.T


def rows(network: FrictionNetwork, mean: Tensor, scale: Tensor, x: Tensor, x_rate: Tensor | None) -> Tensor:
    """What the layers see: standardised inputs and, if odd, their mirror images, then the same of their rates."""
    parts = [(x - mean) / scale] + ([] if x_rate is None else [x_rate / scale])
    if network.odd:
        parts = [item for part in parts for item in (part, torch.where(network.signs < 0, -part, part))]
    return torch.cat(parts)


class Pass:
    """One pass through a network and back.

    Args:
        activation: a key of ``ACTIVATE``.
        state: of a model; the network's weights in it are used.
        x: see :func:`rows`.
        odd: whether half of the rows are mirror images.
        rates: whether the second half of the rows are rates.

    Attributes:
        outputs: u of shape (n, 1) and, with rates, u'.
    """

    def __init__(self, activation: str, state: Mapping[str, Tensor], x: Tensor, odd: bool, rates: bool):
        self.names = [key for key in state if key.startswith("network.") and key.endswith((".weight", ".bias"))]
        tensors = [state[key] for key in self.names]
        self.layers, self.odd = list(zip(tensors[::2], tensors[1::2], strict=True)), odd
        self.kept: list[tuple[Tensor, Tensor, Tensor | None]] = []
        self.values = len(x) // 2 if rates else len(x)  # rows that are not rates
        for weight, bias in self.layers[:-1]:
            a = product(x, weight)
            value, rate = a[: self.values].add_(bias), a[self.values :]
            slope, bend = ACTIVATE[activation](value, rate if rates else None)
            self.kept.append((x, slope, bend))
            x = a
        self.last = x
        weight, bias = self.layers[-1]
        y = x @ weight.T
        y[: self.values] += bias
        self.outputs = tuple(self._folded(part) for part in ((y[: self.values], y[self.values :]) if rates else (y,)))

    def _folded(self, y: Tensor) -> Tensor:
        if not self.odd:
            return y
        same, mirrored = y.chunk(2)
        return (same - mirrored) / 2

    def gradients(self, *slopes: Tensor) -> dict[str, Tensor]:
        """Gradients of a scalar in the weights, by name, from those in ``outputs``; usable once."""
        unfolded = [part for g in slopes for part in ((g / 2, -g / 2) if self.odd else (g,))]
        g = torch.cat(unfolded)
        bias = g.new_zeros(1) if self.odd else g[: self.values].sum(0)  # cancels where odd
        found = [bias, g.T @ self.last]  # from the last to the first
        g = g * self.layers[-1][0]
        for k in reversed(range(len(self.kept))):
            x, slope, bend = self.kept[k]
            value = g[: self.values]
            if bend is None:
                value.mul_(slope)
            else:
                activations.pull_back(*(_flat(part) for part in (value, g[self.values :], slope, bend)))
            found += [value.sum(0), product(x.T, g.T).T]
            if k:
                g = product(g, self.layers[k][0].T)
        return dict(zip(self.names, reversed(found), strict=True))
