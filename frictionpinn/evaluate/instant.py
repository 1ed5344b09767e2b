"""A trained model's force, instant by instant: of a memoryless model, and of one whose past grows step by step."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping

import numpy as np
import torch

from ..data.contact import BASE
from ..models import FrictionEnsemble, FrictionModel, ParameterEstimator

_MOMENT = 1e-6  # s, over which the bristle's rate is taken


def memoryless(model: FrictionModel) -> bool:
    """Whether the force is a function of the newest sample of the inputs alone (no windows, no bristle rate)."""
    return model.features.length == 1 and not model.sees_rates


def callable_force(model: FrictionModel) -> Callable[..., torch.Tensor]:
    """A memoryless model as a function (v_slip, N, a_frictionless) -> force, float64 tensors of shape (n,)."""
    precise, inputs = _frozen(model), model.features.inputs

    def force(v_slip: torch.Tensor, normal: torch.Tensor, frictionless: torch.Tensor) -> torch.Tensor:
        columns = dict(zip(BASE, (v_slip, normal.abs(), frictionless), strict=True))
        batch = {"x": torch.stack([columns[name] for name in inputs], dim=-1)}
        return torch.stack([member.predict(batch)["force"] for member in precise]).mean(0).squeeze(-1)

    return force


class _Fixed(torch.nn.Module):
    """Values of a law's parameters, computed once."""

    def __init__(self, values: dict[str, torch.Tensor]):
        super().__init__()
        self.values = values

    def forward(self) -> dict[str, torch.Tensor]:
        return self.values


def _frozen(model: FrictionModel) -> list[FrictionModel]:
    """Copies in double precision (differences of forces are taken) whose parameters stay as they are; of an ensemble
    its members: of a few samples each for itself is several times as fast as all in one batched program.
    """
    found = model.members() if isinstance(model, FrictionEnsemble) else [copy.deepcopy(model)]
    for precise in found:
        precise.double().eval().requires_grad_(False)
        if isinstance(precise, ParameterEstimator):
            precise.law_parameters = _Fixed(precise.law_parameters())  # type: ignore[assignment]
    return found


class WindowedForce:
    """Force of a model from a past that grows step by step.

    Every feature is linear in the last samples of its signal, so their weights are read once, from an impulse.

    Args:
        model: of any variant.
        stride: simulated steps per sample of the training data.
        interval: of the training data, s.
    """

    def __init__(self, model: FrictionModel, stride: int, interval: float):
        self.members = _frozen(model)
        self.names, length = model.features.inputs, model.features.length
        t, zero = np.arange(2 * length) * interval, np.zeros(2 * length)
        impulse = zero.copy()
        impulse[length] = 1.0
        self.weights = {}  # name -> (samples back, features)
        for name in self.names:
            signals = dict.fromkeys(self.names, zero) | {name: impulse}
            self.weights[name] = model.features(t, signals)[length:]
        self.back = np.arange(1, length) * stride

    def of_past(self, past: Mapping[str, np.ndarray], k: int) -> np.ndarray:
        """Contribution to the features, shape (d,), of all but step k; ``past`` holds arrays over the steps."""
        index = np.maximum(k - self.back, 0)
        return sum((past[name][index] @ self.weights[name][1:] for name in self.names), start=np.zeros(()))

    def now(self, values: Mapping[str, np.ndarray]) -> np.ndarray:
        """Contribution to the features, shape (m, d), of m candidates for the newest step."""
        return sum((np.outer(values[name], self.weights[name][0]) for name in self.names), start=np.zeros(()))

    def constant(self, values: Mapping[str, np.ndarray]) -> np.ndarray:
        """Features, shape (m, d), of signals that have long been constant, arrays of shape (m,)."""
        return sum((np.outer(values[name], self.weights[name].sum(0)) for name in self.names), start=np.zeros(()))

    @torch.no_grad()
    def __call__(self, x: np.ndarray, x_rate: np.ndarray, now: Mapping[str, np.ndarray], rates: Mapping) -> np.ndarray:
        """Force, shape (m,), of features and their rates, shape (m, d), and the signals that the law itself sees."""
        batch = {"x": x, "x_rate": x_rate}
        columns = {"v": now["v_slip"], "N": now["normal_force"]}
        columns |= {"v_rate": rates["v_slip"], "N_rate": rates["normal_force"]}
        batch |= {name: np.asarray(values, float)[:, None] for name, values in columns.items()}
        tensors = {name: torch.from_numpy(np.array(values)) for name, values in batch.items()}
        return torch.stack([_force(member, tensors) for member in self.members]).mean(0).squeeze(-1).numpy()


def _force(model: FrictionModel, batch: dict[str, torch.Tensor]) -> torch.Tensor:
    """``model.predict(batch)["force"]``; the bristle's rate by a central difference, ten times as fast as torch's jvp.

    In double precision over a microsecond the two agree to nine digits.
    """
    if not isinstance(model, ParameterEstimator):
        return model.predict(batch)["force"]
    p, places = model.law_parameters(), torch.tensor([[0.0], [_MOMENT], [-_MOMENT]], dtype=torch.float64)
    along = [(batch[name], batch[f"{name}_rate"]) for name in ("x", "v", "N")]
    x, v, N = (torch.cat([value + place * rate for place in places]) for value, rate in along)
    z, later, earlier = model.bristle_state(p, model.network(x), v, N).chunk(3)
    return model.functions.force(batch["v"], batch["N"], z, (later - earlier) / (2 * _MOMENT), *p.values())
