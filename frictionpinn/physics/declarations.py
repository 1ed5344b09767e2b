"""What a system is declared by, coordinates, contacts and inputs, and whether what a user says of one is possible."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import sympy as sp

from ..errors import UserError, nearest
from ..show import readable_unit

if TYPE_CHECKING:
    from .system import System


@dataclass(frozen=True)
class Coordinate:
    """A generalised coordinate and the signals that measure it.

    Attributes:
        signals: names of position, velocity and acceleration in a recording, ("x", "v", "a").
        units: their SI units.
        constrained: held at zero by the contact; its equation of motion gives the normal force.
    """

    name: str
    signals: tuple[str, str, str] = ("", "", "")
    units: tuple[str, str, str] = ("m", "m/s", "m/s^2")
    constrained: bool = False

    @cached_property
    def symbols(self) -> tuple[sp.Symbol, sp.Symbol, sp.Symbol]:
        """Symbols of position, velocity and acceleration."""
        q, qd, qdd = sp.symbols(f"{self.name} {self.name}_dot {self.name}_ddot", real=True)
        return q, qd, qdd


@dataclass(frozen=True)
class Input:
    """A measured or prescribed generalised force: signal name, SI unit, and what it is."""

    name: str
    unit: str
    text: str

    @property
    def symbol(self) -> sp.Symbol:
        """The symbol that stands for it."""
        return sp.Symbol(f"{self.name}_in", real=True)


@dataclass(frozen=True)
class FrictionalContact:
    """A place where friction acts.

    Attributes:
        name: empty where the system has no other.
        force_unit, slip_unit: SI units of the friction force and of slip ("N*m" and "rad" for a joint).
        text: what it is.
    """

    name: str
    force_unit: str = "N"
    slip_unit: str = "m"
    text: str = ""


def check_declared(system: System) -> None:
    """Raise :class:`UserError` for signals that share a name, a force on no coordinate, a slip without a velocity."""
    names = ["t", *(name for c in system.moving for name in c.signals if name), *(u.name for u in system.inputs)]
    for name in names:
        if names.count(name) > 1:
            raise UserError(f"two signals of one name in system {system.name}", where="coordinates and inputs",
                            received=repr(name), allowed="names that differ, t being time")  # fmt: skip
    coordinates = [c.name for c in system.coordinates]
    for name in system.applied(system.s, system.p):
        if name not in coordinates:
            raise UserError(f"force on no coordinate of system {system.name}", where="applied", received=repr(name),
                            allowed=", ".join(coordinates),
                            fix=nearest(name, coordinates) or "name the coordinate that it acts on")  # fmt: skip
    slip = system.slip_velocity(system.s, system.p)
    rates = {c.symbols[1] for c in system.coordinates}
    for contact, velocity in slip.items() if isinstance(slip, dict) else [("", slip)]:
        if not sp.sympify(velocity).free_symbols & rates:
            raise UserError(f"no velocity in the slip velocity of system {system.name}",
                            where=f"slip_velocity {contact}".strip(), received=velocity,
                            allowed=f"an expression of {', '.join(f's.{c}_dot' for c in coordinates)}")  # fmt: skip


def check_imposed(system: System) -> None:
    """Raise :class:`UserError` where the input is not a force along the slip of the only coordinate and contact."""
    several = len(system.moving) > 1 or len(system.contacts) > 1
    for c in system.moving:
        u = system.inputs[0].symbol if len(system.inputs) == 1 else sp.Integer(0)
        if several or sp.diff(system.residual(c), u) != -1 or system.jacobian[c.name] != 1:
            raise UserError(
                f"the motion of system {system.name} cannot be imposed",
                where="system.imposed",
                received=True,
                allowed="false; true for one coordinate that one measured force moves",
                fix="leave system.imposed at false",
            )


def check_value(system: System, name: str, value: float) -> None:
    """Raise :class:`UserError` for a parameter that the system has not, or a value out of its physical range."""
    table = {par.name: par for par in system.parameters}
    where = f"system.parameters.{name}"
    if name not in table:
        raise UserError(
            f"unknown parameter of system {system.name}",
            where=where,
            received=value,
            allowed=", ".join(table),
            fix=nearest(name, table) or "use one of the allowed names",
        )
    par = table[name]
    try:
        massless = float(value) == 0 and "kg" in par.unit
        inside = par.low <= float(value) <= par.high and not massless and np.isfinite(float(value))
        inside = inside and not isinstance(value, bool)
    except (TypeError, ValueError):
        inside = False
    if not inside:
        raise UserError(
            f"{par.text} out of its physical range",
            where=where,
            received=f"{value} {readable_unit(par.unit)}",
            allowed=f"{par.low:g} to {par.high:g} {readable_unit(par.unit)}" + (" (not 0)" if "kg" in par.unit else ""),
            fix="give the measured value in SI units",
        )


def checked_driven(system: System, names: tuple[str, ...]) -> tuple[str, ...]:
    """The coordinates whose motion is prescribed; :class:`UserError` for one that the system has not."""
    valid = [c.name for c in system.moving]
    for name in (names,) if isinstance(names, str) else names:
        if isinstance(names, str) or name not in valid:
            raise UserError(
                "not a list of coordinates",
                where="system.driven",
                received=repr(names),
                allowed=", ".join(valid),
                fix=nearest(name, valid) or "give a list of these names",
            )
    return tuple(names)
