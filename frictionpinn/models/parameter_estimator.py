"""Parameter estimators PE1 and PE2: the network gives the bristle state, the law's parameters are trained with it."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from ..errors import UserError, choose
from ..numerics.torch_functions import LawFunctions
from ..physics import LAWS, FrictionLaw
from .base import Batch, FrictionModel
from .parameters import LawParameters

BRISTLE = ("load", "steady", "free")


def with_bristle(name: str) -> type[FrictionLaw]:
    """A law by name; :class:`UserError` where it has no bristle state."""
    kind = choose(name, LAWS, "friction")
    if not kind.memory:
        raise UserError(
            "a parameter estimator needs a friction law with a bristle state",
            where="friction",
            received=name,
            allowed=", ".join(name for name, item in LAWS.items() if item.memory),
            fix="choose friction=lugre, or model=bb1 for a law without memory",
        )
    return kind


class ParameterEstimator(FrictionModel):
    """z = network, z' = its derivative along the trajectory (forward mode), F_f = law(v, N, z, z').

    The loss is the force balance plus lambda times the consistency z' - rate(v, N, z) of the law. What the network's
    output u stands for (``bristle``):

    - load: sigma_0 z = tanh(u) g(0, N), a share of the breakaway force;
    - steady: sigma_0 z = tanh(u) g(v, N), a share of the steady force at this velocity;
    - free: z = u F_scale / start of sigma_0, unbounded, as published.

    Where a bristle is known to begin with, a batch holds its u as ``lead``, and the network learns what is not in it.

    PE1 sees slip velocity and normal force, PE2 the frictionless acceleration too.
    Source: Ozmen, Hespanha and Byl, arXiv 2504.12441; the bounded outputs are ours.

    Args:
        law: name, start, bounds, fixed, tie_sigma1 (plain values).
        bristle: see above.
    """

    sees_rates = True

    def __init__(self, *, law: dict[str, Any], bristle: str = "load", **common: Any):
        super().__init__(**common, law=law, bristle=bristle)
        self.save_hyperparameters(logger=False)
        kind = with_bristle(law["name"])
        if bristle not in BRISTLE:
            raise UserError("unknown output", where="model.bristle", received=repr(bristle), allowed=", ".join(BRISTLE))
        self.bristle = bristle
        options = {key: value for key, value in law.items() if key != "name"}
        self.law_parameters = LawParameters(kind(), **options)
        self.functions = LawFunctions(kind())
        self.z_scale = self.scales["force"] / float(law["start"].get("sigma_0", 1.0))

    def physical(self) -> dict[str, float]:
        with torch.no_grad():
            return {name: float(value) for name, value in self.law_parameters().items()}

    def bristle_state(self, p: dict[str, Tensor], u: Tensor, v: Tensor, N: Tensor) -> Tensor:
        """z, m, of the network's output u and the law's parameters p; all of shape (n, 1)."""
        if self.bristle == "free":
            return u * self.z_scale
        speed = torch.zeros_like(v) if self.bristle == "load" else v
        return torch.tanh(u) * self.functions.capacity(speed, N, *p.values()) / p["sigma_0"]

    def _bristle_rate(self, p: dict[str, Tensor], u: Tensor, u_rate: Tensor, batch: Batch) -> Tensor:
        """Derivative of :meth:`bristle_state` along the trajectory, m/s."""
        if self.bristle == "free":
            return u_rate * self.z_scale
        v, N, v_rate, N_rate = (batch[name] for name in ("v", "N", "v_rate", "N_rate"))
        if self.bristle == "load":
            v, v_rate = torch.zeros_like(v), torch.zeros_like(v_rate)
        share = torch.tanh(u)
        g = self.functions.capacity(v, N, *p.values())
        g_rate = self.functions.capacity_rate(v, N, v_rate, N_rate, *p.values())
        return ((1 - share.square()) * u_rate * g + share * g_rate) / p["sigma_0"]

    def respond(self, batch: Batch, *outputs: Tensor):
        p = self.law_parameters()
        (u, u_rate), v, N = outputs, batch["v"], batch["N"]
        if "lead" in batch:
            u, u_rate = u + batch["lead"], u_rate + batch["lead_rate"]
        z, z_rate = self.bristle_state(p, u, v, N), self._bristle_rate(p, u, u_rate, batch)
        force = self.functions.force(v, N, z, z_rate, *p.values())
        return {
            "force": force,
            "z": z,
            "z_rate": z_rate,
            "residual": z_rate - self.functions.rate(v, N, z, *p.values()),
        }
