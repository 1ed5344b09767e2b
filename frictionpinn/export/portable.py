"""A trained model as plain numbers: what every export writes, whatever language reads it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from torch import nn

from ..data.contact import BASE
from ..errors import UserError
from ..evaluate.instant import WindowedForce
from ..models import FrictionEnsemble, FrictionModel, ParameterEstimator
from ..physics import LAWS, FrictionLaw, System

Layer = tuple[np.ndarray, np.ndarray]


class Titled:
    """What every exported model tells of itself: its contact, its units, one line."""

    name: str
    system: System

    @property
    def contact(self) -> str:
        """Name of the contact; empty where the system has no other."""
        return self.system.contacts[0].name if len(self.system.whole.contacts) > 1 else ""

    @property
    def units(self) -> dict[str, str]:
        """SI unit of every signal, of its rate, and of the outputs."""
        force, slip = self.system.force_unit, self.system.slip_unit
        units = {"v_slip": f"{slip}/s", "normal_force": force, "a_frictionless": f"{slip}/s^2"}
        units |= {"v_slip_rate": f"{slip}/s^2", "normal_force_rate": f"{force}/s", "a_frictionless_rate": f"{slip}/s^3"}
        return units | {"force": force, "z": slip, "z_rate": f"{slip}/s"}

    @property
    def title(self) -> str:
        """One line that says what this is."""
        return (
            f"friction model {self.name}{f' of {self.contact}' if self.contact else ''}, trained on {self.system.title}"
        )


@dataclass(frozen=True)
class PortableModel(Titled):
    """Features, network and law of a trained model.

    The features are x = sum over signals and samples of weights[signal][back] * value, ``back`` = 0 the newest. The
    network maps u = (x - mean) / scale through its layers, half the difference to the mirrored input where ``odd``.
    A black box gives F = force_scale * network; a parameter estimator's network gives the bristle state.

    Attributes:
        name: bb1, bb2, pe1 or pe2.
        inputs: signals that the network sees, of ``v_slip``, ``normal_force`` (its magnitude), ``a_frictionless``.
        interval: between samples, s.
        weights: signal -> (samples, features).
        mean, scale, signs: of the features, shape (d,).
        layers: weight (out, in) and bias (out,) of each linear layer.
        law, values: the friction law and the parameters trained with the network, SI units; None for a black box.
        identified: the law's parameters to use without the network: refined, where the run refined them.
        bristle: what the network's output stands for: load, steady or free; "" for a black box.
        z_scale: of ``free``.
        system: gives units and equations.
    """

    name: str
    inputs: tuple[str, ...]
    interval: float
    weights: dict[str, np.ndarray]
    mean: np.ndarray
    scale: np.ndarray
    signs: np.ndarray
    layers: tuple[Layer, ...]
    activation: str
    odd: bool
    force_scale: float
    law: FrictionLaw | None
    values: dict[str, float]
    identified: dict[str, float]
    bristle: str
    z_scale: float
    system: System

    @classmethod
    def of(
        cls, model: FrictionModel, system: System, interval: float, refined: Mapping[str, float] | None = None
    ) -> PortableModel:
        """Read the numbers of a trained model.

        Args:
            model: of any variant.
            system: that it was trained on.
            interval: of its training data, s.
            refined: the law's parameters where the run refined them.
        """
        if isinstance(model, FrictionEnsemble):
            raise UserError(
                "an ensemble is not handed on as one model",
                where="run",
                received=f"{model.size} members",
                allowed="a run of one network",
                fix="train with ensemble=1",
            )
        estimator = isinstance(model, ParameterEstimator)
        network = model.network
        linear = [layer for layer in network.layers if isinstance(layer, nn.Linear)]
        return cls(
            name=str(model.hparams["name"]),
            inputs=model.features.inputs,
            interval=float(interval),
            weights=WindowedForce(model, 1, interval).weights,
            mean=_array(network.mean),
            scale=_array(network.scale),
            signs=_array(network.signs),
            layers=tuple((_array(layer.weight), _array(layer.bias)) for layer in linear),
            activation=str(model.hparams["network"]["activation"]),
            odd=bool(network.odd),
            force_scale=float(model.scales["force"]),
            law=LAWS[model.hparams["law"]["name"]]() if estimator else None,
            values=model.physical(),
            identified=model.physical() | dict(refined or {}),
            bristle=model.bristle if isinstance(model, ParameterEstimator) else "",
            z_scale=float(model.z_scale) if isinstance(model, ParameterEstimator) else 1.0,
            system=system,
        )

    @property
    def estimator(self) -> bool:
        """Whether it is a parameter estimator: it then sees rates of the signals too."""
        return self.law is not None

    @property
    def length(self) -> int:
        """Samples that the longest window needs."""
        return len(next(iter(self.weights.values())))

    @cached_property
    def signals(self) -> tuple[str, ...]:
        """Signals to give: those of the network, and those of the law."""
        needed = {*self.inputs, *(("v_slip", "normal_force") if self.estimator else ())}
        return tuple(name for name in BASE if name in needed)


def _array(tensor: torch.Tensor) -> np.ndarray:
    return tensor.detach().cpu().numpy().astype(float)
