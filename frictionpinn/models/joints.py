"""Joints of a robot: a map for each, trained at once on the balance of all torques with the bodies' unknown parameters.

At every instant that is compared, behind the low-pass L that model and measurement pass,

    tau_k = C_k beta + L F_k,    load_k = |Y_k pi| in the normal force that F_k sees.

The balance is linear in beta (base parameters, motors' inertias, offsets, a lag), so that beta is eliminated (variable
projection: Golub and Pereyra, SIAM J. Numer. Anal. 10, 1973): the loss is what no beta could explain.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import conv1d

from ..data.contact import ContactTrial
from ..physics.base import at_contact
from .base import Batch
from .several import SeveralContacts

COMPARED, LEFT, UNKNOWN = "compared", "left", "unknown"  # of a batch


@dataclass(frozen=True)
class JointTrial(ContactTrial):
    """A trial of a robot: its joints are its contacts.

    Attributes:
        compared: 1 where torques are compared, else 0, shape (n,).
        left: what friction has to explain there, behind the low-pass, 0 elsewhere, N m, shape (n, joints).
        unknown: derivatives of that in beta, in units of ``balance`` and orthonormal over the trials that a loss is
            summed over, shape (n, joints, beta).
        leads: joint -> u of its bristle to begin with, shape (n,), see :class:`.ParameterEstimator`; none of black
            boxes.
    """

    compared: np.ndarray = field(default_factory=lambda: np.zeros(0))
    left: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    unknown: np.ndarray = field(default_factory=lambda: np.zeros((0, 0, 0)))
    leads: dict[str, np.ndarray] = field(default_factory=dict)


class JointNetworks(SeveralContacts):
    """One map for each joint; the loss is

        sum_k mean(e_k^2) / scale_k^2 + sum_k lambda mean(residual_k^2),    e = (1 - Q Q') (L F - left),

    means over what is compared, Q the orthonormal ``unknown`` columns.

    Args:
        kernel: of the low-pass, an odd number of samples, the middle one now.
        balance: scale of each joint's torque, N m.
        common: see :class:`SeveralContacts`.
    """

    kernel: Tensor

    def __init__(self, *, kernel: list[float], **common: Any):
        super().__init__(**common)
        self.save_hyperparameters(logger=False)
        self.register_buffer("kernel", torch.tensor(kernel, dtype=torch.float32)[None, None])

    def arrays(self, trial: ContactTrial, source: str = "online") -> dict[str, np.ndarray]:
        assert isinstance(trial, JointTrial)
        found = {COMPARED: trial.compared, LEFT: trial.left, UNKNOWN: trial.unknown}
        for joint, u in trial.leads.items():
            found[at_contact(joint, "lead")] = u[:, None]
            found[at_contact(joint, "lead_rate")] = np.gradient(u, trial.t)[:, None]
        return self.of_maps(trial, source) | {key: np.asarray(x, np.float32) for key, x in found.items()}

    def balance(self, batch: Batch, predicted: dict[str, Tensor]) -> Tensor:
        forces = torch.cat([predicted[at_contact(c, "force")] for c in self.contacts], dim=1)
        passed = conv1d(forces.T[:, None], self.kernel, padding="same")[:, 0].T
        scale = torch.as_tensor(self.hparams["balance"], dtype=forces.dtype, device=forces.device)
        e = (passed - batch[LEFT]) * batch[COMPARED][:, None] / scale
        Q = batch[UNKNOWN].flatten(0, 1)
        e = e - (Q @ (Q.T @ e.flatten())).view_as(e)
        return e * (len(e) / batch[COMPARED].sum()).sqrt()  # its mean is that over what is compared
