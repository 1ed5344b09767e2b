"""How large parameters are on some data: orders of magnitude that follow from its force, slip, speed and time."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from .base import Parameter, contact_of
from .scan import Scan

FACTOR = re.compile(r"([*/]?)(\{?[A-Za-z]+\}?|1)(?:\^(\d+))?")  # of a unit


@dataclass(frozen=True)
class Sizes:
    """Orders of magnitude in a recording.

    Attributes:
        scales: offset and size of what effects scan, see :func:`frictionpinn.physics.scan.data_scales`.
        velocity: root mean square of the slip velocity, m/s or rad/s.
        force: dry friction force, in the system's unit of force.
        turns: whether slip is an angle: then lengths are levers.
    """

    scales: Mapping[str, tuple[float, float]]
    velocity: float
    force: float
    turns: bool

    @cached_property
    def base(self) -> dict[str, float]:
        """Size of a quantity by its unit, as in :class:`Parameter`."""
        stroke = self.scales["stroke"][1] or 1.0
        time = stroke / self.velocity
        return {
            "1": 1.0, "s": time, "Hz": 1 / time, "m": 1.0 if self.turns else stroke, "N": self.force,
            "rad": stroke if self.turns else 1.0, "{F}": self.force, "{L}": stroke,
            "kg": self.force * time**2 / stroke,
        }  # fmt: skip

    def at(self, name: str) -> Sizes:
        """Orders of magnitude at the contact of a parameter of that name."""
        return self

    def with_forces(self, forces: Mapping[str, float]) -> Sizes:
        """The same with these dry friction forces, by contact."""
        return replace(self, force=forces[""])

    def of(self, par: Parameter) -> float:
        """Size of a parameter, SI unit: of the values that its effect would scan, else of its unit."""
        if par.scan is not None:
            low, high = self.ends(par.scan)
            size = (high - low) / 4 if par.scan.spacing == "linear" else self.middle(par.scan)
        else:
            size = 1.0
            for sign, name, power in FACTOR.findall(par.unit):
                size *= self.base[name] ** (int(power or 1) * (-1 if sign == "/" else 1))
        return min(size, par.high) if par.high > 0 else size

    def ends(self, scan: Scan) -> tuple[float, float]:
        """Least and largest value of a scan, SI units."""
        values = scan.values(self.scales)
        return float(values[0]), float(values[-1])

    def middle(self, scan: Scan) -> float:
        """Middle of a scan, SI unit, as it is spaced."""
        low, high = self.ends(scan)
        return (low + high) / 2 if scan.spacing == "linear" else float(np.sqrt(low * high))


@dataclass(frozen=True)
class SizesByContact(Sizes):
    """Orders of magnitude at each of several contacts; those of the first for what belongs to none of them.

    Attributes:
        contacts: name of a contact -> orders of magnitude there.
    """

    contacts: Mapping[str, Sizes] = field(default_factory=dict)

    def at(self, name: str) -> Sizes:
        return self.contacts.get(contact_of(name), self)

    def with_forces(self, forces: Mapping[str, float]) -> Sizes:
        contacts = {name: replace(own, force=forces[name]) for name, own in self.contacts.items()}
        return replace(self, force=next(iter(forces.values())), contacts=contacts)

    def of(self, par: Parameter) -> float:
        here = self.at(par.name)
        return super().of(par) if here is self else here.of(par)
