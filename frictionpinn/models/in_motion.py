"""What a memoryless network is inside an equation of motion: a law that is sharp at rest, fitted by simulating.

A network trained on noisy samples gives the mean force over all velocities that the noise may hide: online that is
right, in simulation it lets a contact creep that should stick. Here its sliding force reaches to rest, and what
happens there is fitted to the training trials as simulated (:mod:`.rollout`).
"""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any

import numpy as np
import torch

from ..numerics.bristle_law import BristleLaw
from ..numerics.sliding import level, past_rest
from ..physics import LAWS
from .base import FrictionModel
from .parameter_estimator import ParameterEstimator

LAW = BristleLaw(LAWS["lugre"](), alpha=2)


def law_values(values: Mapping[str, float]) -> np.ndarray:
    """Parameters of ``LAW``, in its order, where the force that the network gives of sliding stands for F_c."""
    known = {"mu_c": 1.0, "mu_s": 1.0 + values["peak"], "v_s": values["peak_velocity"]}
    return np.array([known.get(name, values.get(name)) for name in LAW.names], float)


def gain(values: Mapping[str, float], x: np.ndarray) -> np.ndarray:
    """slow^(1 - w) fast^w with w = |x| / (1 + |x|), x the velocity over its root mean square in the training trials."""
    w = np.abs(x) / (1 + np.abs(x))
    return values["slow"] ** (1 - w) * values["fast"] ** w


class InMotion:
    """Friction of a trained BB1 or PE1 in simulation.

    Of a black box, without memory: with x = v + shift tanh(v / creep),
    F = gain(x) N (coulomb tanh(3 x / shift) + weights . hidden(x, N)), hidden the last hidden layer of its network;
    gain goes from ``slow`` at rest to ``fast`` at speed, see :func:`gain`.

    Of a parameter estimator the bristle is a state, of LuGre's law with sigma_0, sigma_1, sigma_2. It settles to what
    the network says of sliding: F_c = gain |sigma_0 z_network(v + shift sign v, N)|, F_s = (1 + peak) F_c,
    v_s = peak_velocity.

    Args:
        model: trained.
        values: shift and creep (m/s), coulomb, slow, fast; of a parameter estimator shift, gain, sigma_0, sigma_1,
            sigma_2, peak, peak_velocity, SI units.
        weights: of a black box, shape (width,).
    """

    def __init__(self, model: FrictionModel, values: Mapping[str, float], weights: torch.Tensor | None = None):
        self.model = copy.deepcopy(model).double().eval().requires_grad_(False)
        self.values = {name: float(value) for name, value in values.items()}
        self.weights = None if weights is None else weights.double()
        self._law = self.model.law_parameters() if isinstance(self.model, ParameterEstimator) else {}

    @property
    def memory(self) -> bool:
        """Whether the bristle is a state."""
        return self.weights is None

    def inputs(self, v: np.ndarray, N: np.ndarray) -> torch.Tensor:
        """What the network sees, shape (n, 2), of slip velocity and normal force, shape (n,) each."""
        columns = {"v_slip": v, "normal_force": N}
        return torch.from_numpy(np.stack([columns[name] for name in self.model.features.inputs], axis=-1))

    @torch.no_grad()
    def sliding(self, v: np.ndarray, N: np.ndarray) -> np.ndarray:
        """Force of sliding at a shifted velocity, shape (n,); of a parameter estimator sigma_0 z alone."""
        if self.weights is not None:
            share = (self.model.network.hidden(self.inputs(v, N)) @ self.weights).numpy()
            share = share + self.values["coulomb"] * np.tanh(3 * v / self.values["shift"])
            return gain(self.values, v / self.model.scales["velocity"]) * N * share
        speed, load = (torch.from_numpy(np.array(value)[:, None]) for value in (v, N))
        u = self.model.network(self.inputs(v, N))
        z = self.model.bristle_state(self._law, u, speed, load)  # type: ignore[operator]
        return (self._law["sigma_0"] * z).squeeze(-1).numpy()

    def __call__(self, v: np.ndarray, N: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Force and bristle rate (0 of a black box), arrays of shape (n,)."""
        p = self.values
        if not self.memory:
            return self.sliding(past_rest(v, p["shift"], p["creep"]), N), np.zeros_like(v)
        settled = level(self.sliding(v + np.copysign(p["shift"], v), N), p["gain"])
        force, rate = LAW.numpy(v, settled, z, *law_values(p))
        return force, rate

    states = 1

    def rates(self, v: float, N: float, z: np.ndarray) -> np.ndarray:
        """Force and bristle rate at one instant, shape (2,), of the state z, shape (1,)."""
        return np.concatenate(self(np.array([v]), np.array([N]), z))

    def settled(self, v: float, N: float) -> np.ndarray:
        """State in steady sliding, shape (1,), at which its rate is 0: that is linear in it."""
        rate, other = (self.rates(v, N, np.array([z]))[1] for z in (0.0, 1.0))
        return np.array([rate / (rate - other) if rate else 0.0])

    def checkpoint(self) -> dict[str, Any]:
        """Plain tensors and values, for :meth:`restore`."""
        return {"values": self.values, "weights": self.weights}

    @classmethod
    def restore(cls, model: FrictionModel, checkpoint: Mapping[str, Any]) -> InMotion:
        """From the trained model and a :meth:`checkpoint`."""
        return cls(model, checkpoint["values"], checkpoint["weights"])
