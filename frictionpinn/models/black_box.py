"""Black boxes BB1 and BB2: the friction force itself from the network."""

from __future__ import annotations

from torch import Tensor

from .base import Batch, FrictionModel


class BlackBox(FrictionModel):
    """F_f = F_scale network(x), trained by the force balance alone.

    BB1 sees slip velocity and normal force, BB2 the frictionless acceleration too: at rest it tells the force that
    friction has to hold. Source: Ozmen, Hespanha and Byl, arXiv 2504.12441.
    """

    def respond(self, batch: Batch, *outputs: Tensor):
        return {"force": self.scales["force"] * outputs[0]}
