"""A trained network with memory as plain numbers: what every export of one writes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from ..models import StateModel
from ..models.elements import StateFriction
from ..models.state import GAIN, GATE, STEPS
from ..physics import LAWS, FrictionLaw, System
from .portable import Titled


@dataclass(frozen=True)
class PortableState(Titled):
    """The table and the bristles of a trained network with memory, and what its use online needs.

    Attributes:
        name: bb1, bb2, pe1 or pe2.
        numbers: the friction map.
        interval: between samples of the training data, s.
        mobility: slip acceleration per force where the model moves the slip velocity itself, else 0.
        noise: slip velocity, m/s, above which the contact surely slides and is corrected by the measured one.
        gain: share of that correction, per sample.
        steps: per sample.
        force_scale: root mean square force of the training data.
        law, values, identified: see :class:`.portable.PortableModel`.
        system: gives units and equations.
    """

    name: str
    numbers: StateFriction
    interval: float
    mobility: float
    noise: float
    gain: float
    steps: int
    force_scale: float
    law: FrictionLaw | None
    values: dict[str, float]
    identified: dict[str, float]
    system: System

    @classmethod
    def of(
        cls, model: StateModel, system: System, interval: float, refined: Mapping[str, float] | None = None
    ) -> PortableState:
        """Read the numbers of a trained model; arguments as of :meth:`.portable.PortableModel.of`."""
        law = model.hparams["law"]
        return cls(
            name=str(model.hparams["name"]),
            numbers=model.friction(),
            interval=float(interval),
            mobility=float(model.scales["mobility"]) if model.moving else 0.0,
            noise=GATE * max(float(model.scales["slip_noise"]), 1e-12),
            gain=GAIN,
            steps=STEPS,
            force_scale=float(model.scales["force"]),
            law=LAWS[law["name"]]() if law else None,
            values=model.physical(),
            identified=model.physical() | dict(refined or {}),
            system=system,
        )

    @property
    def signals(self) -> tuple[str, ...]:
        """Signals to give at every sample."""
        return ("v_slip", "normal_force", *(("a_frictionless",) if self.mobility else ()))

    @property
    def title(self) -> str:
        return super().title.replace(", trained", " with memory, trained")
