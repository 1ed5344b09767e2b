"""Where the bristles of a black box start.

Through the balance they start from the reach that fits best, with the same friction at every velocity. Through the
motion that leads into a wrong minimum: friction that rises towards rest within few samples comes out low and wide,
though the motion tells another rise better (by 300 in -2 log likelihood on the pendulum on a box,
benchmarks/networks_choice.py). There LuGre's law is fitted to the same motion first (:func:`.state_start.fit_law`); the
network begins at its friction and departs from there as it likes, unlike that of a parameter estimator.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor

from ..physics import LAWS
from .base import Batch
from .start import complete
from .state_start import fit_law

if TYPE_CHECKING:
    from .elements import StateFriction
    from .state import StateModel

STARTS = {"law": "LuGre's law, fitted to the motion", "reach": "friction that is the same at every velocity"}
LAW = "lugre"
REACHES = 4.0 ** np.arange(-3, 6)  # of that which the data's scale suggests


def start_black_box(model: StateModel, batch: Batch) -> None:
    """Leave a black box where its training on ``batch`` starts."""
    if model.through == "motion" and model.hparams["state"].get("start", "law") == "law":
        start_as_law(model, batch)
    else:
        start_by_reach(model, batch)


def start_as_law(model: StateModel, batch: Batch) -> None:
    """Friction, bristles and the inputs' errors of the law that fits the motion best."""
    law = LAWS[LAW]()
    start, bounds = complete(law, {}, {}, model.scales)
    twin = type(model)(**dict(model.hparams) | {"law": {"name": law.name, "start": start, "bounds": bounds}})
    fit_law(twin.to(batch["v"].device), batch)
    begin_as(model, twin.friction())
    model.discount.copy_(twin.discount)
    if model.errors is not None and twin.errors is not None:
        model.errors.load_state_dict(twin.errors.state_dict())


@torch.no_grad()
def begin_as(model: StateModel, friction: StateFriction) -> None:
    """One bristle that is known, which those of a black box bear together."""
    (kappa, c), K = friction.elements[:2, 0], model.K
    dry, viscous = np.log(kappa * friction.tables[0] / K).ravel(), np.log(friction.tables[1]).ravel()
    model.begins.copy_(torch.from_numpy(np.stack([dry] * K + [viscous], axis=1)))
    own = _own(model)
    _reach(model, own, float(torch.exp(own["stiffness"]).sum()) / kappa)
    model.damping.add_(np.log(c) - torch.logsumexp(model.damping, 0))


def start_by_reach(model: StateModel, batch: Batch) -> None:
    """The reach of least loss, with the friction that the data's scale suggests."""
    own, losses = _own(model), []
    for factor in REACHES:
        _reach(model, own, factor)
        losses.append(model.loss_now(batch))
    _reach(model, own, REACHES[int(np.argmin(losses))])


def _own(model: StateModel) -> dict[str, Tensor]:
    """What depends on how far a bristle bends."""
    return {name: p.detach().clone() for name, p in model.named_parameters() if name in ("stiffness", "damping", "gap")}


@torch.no_grad()
def _reach(model: StateModel, own: dict[str, Tensor], factor: float) -> None:
    """Bristles that bend so much further than ``own`` under the same force."""
    power = {"gap": 1.0, "stiffness": -1.0, "damping": -0.5}
    for name, value in own.items():
        getattr(model, name).copy_(value + power[name] * np.log(factor))
