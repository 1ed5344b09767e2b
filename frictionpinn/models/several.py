"""Several contacts: a map of the same variant for each, trained at once on the balance of all free coordinates."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from ..data.contact import ContactTrial
from ..errors import UserError
from ..physics.base import at_contact
from .base import Batch, FrictionModel, check_loss
from .black_box import BlackBox
from .parameter_estimator import ParameterEstimator
from .state import StateModel

SLOPES = "slopes"  # J in a batch


class SeveralContacts(FrictionModel):
    """One map for each contact; the loss is the force balance of all free coordinates at once.

    The equations of motion E_i + sum_k J_ik F_k = 0 hold for the implied forces F_k*, and the loss is

        sum_i mean((sum_k J_ik (F_k - F_k*))^2) / scale_i^2 + sum_k beside_k,

    with what the loss of each map has beside its force (:meth:`FrictionModel.beside`). That is the residual of the
    equations less what no friction force could explain. Every map sees the signals of its own contact. In a batch
    ``hinge.x`` is the ``x`` of the hinge (see :func:`.base.tensors`), ``slopes`` J of shape (n, equations, contacts).

    Args:
        contacts: contact -> ``scales`` and, of a PE, ``law`` and ``bristle``, as :class:`FrictionModel` takes them;
            with ``state`` networks with memory, see :class:`StateModel`, which follow the measured slip velocities.
        balance: scale of each equation, the root mean square of sum_k J_ik F_k* over the training trials.
        share: whether the networks have the same weights; standardisation and the law's parameters stay their own.
        name, inputs, windows, network, loss, optimizer, context: of every map, see :class:`FrictionModel`.
    """

    def __init__(
        self,
        *,
        name: str,
        inputs: list[str],
        windows: dict[str, list],
        network: dict[str, Any],
        loss: dict[str, Any],
        optimizer: dict[str, Any],
        contacts: dict[str, dict[str, Any]],
        balance: list[float],
        share: bool = False,
        context: dict[str, Any] | None = None,
    ):
        super(FrictionModel, self).__init__()  # the networks are those of the maps
        self.save_hyperparameters(logger=False)
        check_loss(loss)
        if loss["force"] != "normalised":
            raise UserError("equations of motion in different units cannot be added", where="model.loss.force",
                            received=loss["force"], allowed="normalised, with several contacts")  # fmt: skip
        common: dict[str, Any] = {"name": name, "inputs": inputs, "windows": windows, "network": network}
        common |= {"loss": loss, "optimizer": optimizer, "context": context}
        windowed = ParameterEstimator if name.startswith("pe") else BlackBox
        made = {contact: (StateModel if own.get("state") else windowed)(**common, **own)
                for contact, own in contacts.items()}  # fmt: skip
        self.maps = nn.ModuleDict(made)
        first = self.map_of(next(iter(contacts)))
        for contact in contacts if share else ():
            if isinstance(first, StateModel):
                self.map_of(contact).network = first.network
            else:
                self.map_of(contact).network.layers = first.network.layers
        self.own = first.own
        self.features, self.sees_rates = first.features, first.sees_rates
        self.loss, self.optimizer_config = dict(loss), dict(optimizer)
        self.parts: dict[str, Tensor] = {}

    @property
    def contacts(self) -> tuple[str, ...]:
        """Names of the contacts with friction."""
        return tuple(self.maps)

    def map_of(self, contact: str) -> FrictionModel:
        """The model of one contact."""
        return self.maps[contact]  # type: ignore[return-value]

    def arrays(self, trial: ContactTrial, source: str = "online") -> dict[str, np.ndarray]:
        assert trial.slopes is not None
        return {SLOPES: trial.slopes.astype(np.float32)} | self.of_maps(trial, source)

    def of_maps(self, trial: ContactTrial, source: str) -> dict[str, np.ndarray]:
        """What every map is given of one trial, by contact."""
        found: dict[str, np.ndarray] = {}
        for contact in self.contacts:
            own = self.map_of(contact).arrays(trial.at(contact), source)
            found |= {at_contact(contact, name): values for name, values in own.items()}
        return found

    def of_contact(self, batch: Batch, contact: str) -> dict[str, Tensor]:
        """The batch as one map sees it."""
        prefix = at_contact(contact, "")
        return {name.removeprefix(prefix): values for name, values in batch.items() if name.startswith(prefix)}

    def predict(self, batch: Batch) -> dict[str, Tensor]:
        """What every map says of a batch, ``hinge.force``, each of shape (n, 1)."""
        found: dict[str, Tensor] = {}
        for contact in self.contacts:
            told = self.map_of(contact).predict(self.of_contact(batch, contact))
            found |= {at_contact(contact, name): value for name, value in told.items()}
        return found

    def physical(self) -> dict[str, float]:
        """Values of the physical parameters by contact, ``hinge.mu_c``; none for black boxes."""
        own = {contact: self.map_of(contact).physical() for contact in self.contacts}
        return {at_contact(contact, name): value for contact, table in own.items() for name, value in table.items()}

    def losses(self, batch: Batch, outputs: tuple[Tensor, ...] | None = None) -> dict[str, Tensor]:
        """Terms of the loss: ``force``, and those beside it of all contacts together; ``loss`` is their sum."""
        predicted = self.predict(batch)
        balance = self.balance(batch, predicted)
        parts = {"force": balance.square().mean(0).sum()}
        for contact in self.contacts:
            own = self.map_of(contact).beside(self.of_contact(batch, contact), self.of_contact(predicted, contact))
            parts |= {name: parts[name] + value if name in parts else value for name, value in own.items()}
        parts["loss"] = sum(parts.values(), start=torch.zeros((), device=balance.device))
        return parts

    def balance(self, batch: Batch, predicted: dict[str, Tensor]) -> Tensor:
        """What is left of every equation of motion, over its scale, shape (n, equations)."""
        off = [predicted[at_contact(c, "force")] - batch[at_contact(c, "target")] for c in self.contacts]
        scale = torch.as_tensor(self.hparams["balance"], dtype=off[0].dtype, device=off[0].device)
        return (batch[SLOPES].to(off[0].dtype) @ torch.stack(off, dim=1)).squeeze(-1) / scale

    def fit_scales(self, batch: Batch) -> None:
        """Standardise the inputs of every network by the training data."""
        for contact in self.contacts:
            self.map_of(contact).fit_scales(self.of_contact(batch, contact))
