"""The network inside every variant: a plain multilayer perceptron, odd in the motion if wanted."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import torch
from torch import Tensor, nn

from ..errors import UserError, choose

ACTIVATIONS = {"relu": nn.ReLU, "silu": nn.SiLU, "tanh": nn.Tanh, "gelu": nn.GELU, "softplus": nn.Softplus}


class FrictionNetwork(nn.Module):
    """Standardised features in, one number out: f(x), or (f(x) - f(mirrored x)) / 2 where ``odd``.

    Args:
        signs: +1 or -1 for each feature, shape (d,): what mirroring the motion does to it.
        width, depth: units of a hidden layer, number of hidden layers.
        activation: one of ``ACTIVATIONS``; a smooth one where z' is the network's derivative.
        odd: friction that is the same in both directions is an odd function of the motion.
    """

    signs: Tensor
    mean: Tensor
    scale: Tensor

    def __init__(self, signs: Tensor, width: int, depth: int, activation: str, odd: bool):
        super().__init__()
        for key, value in (("width", width), ("depth", depth)):
            if isinstance(value, bool) or not isinstance(value, int) or value < 1:
                raise UserError(
                    "impossible network", where=f"model.network.{key}", received=value, allowed="a whole number from 1"
                )
        act = choose(activation, ACTIVATIONS, "model.network.activation")
        layers: list[nn.Module] = []
        size = len(signs)
        for _ in range(depth):
            layers += [nn.Linear(size, width), act()]
            size = width
        self.layers = nn.Sequential(*layers, nn.Linear(size, 1))
        self.odd = odd
        self.register_buffer("signs", signs.float())
        self.register_buffer("mean", torch.zeros(len(signs)))
        self.register_buffer("scale", torch.ones(len(signs)))

    def set_scale(self, x: Tensor) -> None:
        """Take mean and spread of the features, shape (n, d), from the training data."""
        mean, spread = x.mean(0), x.std(0)
        if self.odd:
            mean = torch.where(self.signs < 0, torch.zeros_like(mean), mean)
        spread = torch.where(spread > 1e-6 * (mean.abs() + 1e-30), spread, torch.ones_like(spread))
        self.mean.copy_(mean)
        self.scale.copy_(spread)

    def forward(self, x: Tensor) -> Tensor:
        """x of shape (n, d), SI units; returns shape (n, 1), dimensionless."""
        return self._through(self.layers, x)

    def hidden(self, x: Tensor) -> Tensor:
        """Last hidden layer, shape (n, width), whose weighted sum the output is; odd where the output is odd."""
        return self._through(self.layers[:-1], x)

    def _through(self, layers: nn.Module, x: Tensor) -> Tensor:
        u = (x - self.mean) / self.scale
        if not self.odd:
            return layers(u)
        mirrored = torch.where(self.signs < 0, -u, u)
        return (layers(u) - layers(mirrored)) / 2


def perceptron(network: dict[str, Any], outputs: int) -> nn.Sequential:
    """Layers as of the other variants, of slip velocity and load; 0 everywhere at first."""
    activation = choose(network["activation"], ACTIVATIONS, "model.network.activation")
    width, depth = int(network["width"]), int(network["depth"])
    sizes = [2, *[width] * depth]
    layers: list[nn.Module] = []
    for size, more in pairwise(sizes):
        layers += [nn.Linear(size, more), activation()]
    last = nn.Linear(width, outputs)
    nn.init.zeros_(last.weight)
    nn.init.zeros_(last.bias)
    return nn.Sequential(*layers, last)
