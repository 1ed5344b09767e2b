"""Parameter estimators PE1 and PE2: the network gives the bristle state, the law's parameters are trained with it."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor
from torch.func import jvp

from ..errors import UserError, choose
from ..numerics.torch_functions import LawFunctions
from ..physics import LAWS
from .base import Batch, FrictionModel
from .parameters import LawParameters

BRISTLE = ("load", "steady", "free")


class ParameterEstimator(FrictionModel):
    """z = network, z' = its derivative along the trajectory (forward mode), F_f = law(v, N, z, z').

    The loss is the force balance plus lambda times the consistency z' - rate(v, N, z) of the law. What the network's
    output u stands for (``bristle``):

    - load: sigma_0 z = tanh(u) g(0, N), a share of the breakaway force;
    - steady: sigma_0 z = tanh(u) g(v, N), a share of the steady force at this velocity;
    - free: z = u F_scale / start of sigma_0, unbounded, as published.

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
        kind = choose(law["name"], LAWS, "friction")
        if not kind.memory:
            raise UserError(
                "a parameter estimator needs a friction law with a bristle state",
                where="friction",
                received=law["name"],
                allowed=", ".join(name for name, item in LAWS.items() if item.memory),
                fix="choose friction=lugre, or model=bb1 for a law without memory",
            )
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

    def _bristle(self, p: dict[str, Tensor], x: Tensor, v: Tensor, N: Tensor) -> Tensor:
        u = self.network(x)
        if self.bristle == "free":
            return u * self.z_scale
        speed = torch.zeros_like(v) if self.bristle == "load" else v
        return torch.tanh(u) * self.functions.capacity(speed, N, *p.values()) / p["sigma_0"]

    def predict(self, batch: Batch):
        p = self.law_parameters()
        v, N = batch["v"], batch["N"]
        primal, tangent = (batch["x"], v, N), (batch["x_rate"], batch["v_rate"], batch["N_rate"])
        z, z_rate = jvp(lambda *a: self._bristle(p, *a), primal, tangent)[:2]
        force = self.functions.force(v, N, z, z_rate, *p.values())
        return {
            "force": force,
            "z": z,
            "z_rate": z_rate,
            "residual": z_rate - self.functions.rate(v, N, z, *p.values()),
        }
