"""What a system is declared by, coordinates, contacts and inputs, and whether what a user says of one is possible."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import sympy as sp

from ..errors import UserError, nearest
from ..show import readable_unit
from .base import TIME, Parameter
from .friction import LAWS

if TYPE_CHECKING:
    from .system import System

PLACES = (0.0, 0.7)  # of all coordinates, at which an energy is looked at: where it is negative, it is nearly anywhere
ROUNDING = 1e-9  # of the largest inertia: singular inertias come out as slightly negative


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


def check_lists(system: System) -> None:
    """Raise :class:`UserError` for declarations that are no tuple of their kind, or a coordinate without its three
    signals."""
    kinds = {"coordinates": Coordinate, "inputs": Input, "parameters": Parameter, "contacts": FrictionalContact}
    for where, kind in kinds.items():
        given = getattr(system, where)
        if not isinstance(given, tuple | list) or not all(isinstance(item, kind) for item in given):
            raise UserError(f"not a tuple of {kind.__name__} in system {system.name}", where=where,
                            received=repr(given)[:60], allowed=f"({kind.__name__}(...),)",
                            fix="mind the comma where there is only one")  # fmt: skip
    for c in system.coordinates:
        for where, names in (("signals", c.signals), ("units", c.units)):
            if isinstance(names, str) or len(names) != 3:
                raise UserError(f"coordinate {c.name} of system {system.name} without three {where}", where=where,
                                received=repr(names), allowed="of position, velocity and acceleration",
                                fix="name all three, also what is not recorded")  # fmt: skip


def check_declared(system: System) -> None:
    """Raise :class:`UserError` for what a system cannot mean: names that are taken or unknown, tables that are none,
    a slip without a velocity, a negative kinetic energy, an input or a force that acts on nothing."""
    names = ["t", *(name for c in system.moving for name in c.signals if name), *(u.name for u in system.inputs)]
    for name in names:
        if names.count(name) > 1:
            raise UserError(f"two signals of one name in system {system.name}", where="coordinates and inputs",
                            received=repr(name), allowed="names that differ, t being time")  # fmt: skip
    taken = {par.name: law.name for law in LAWS.values() for par in law.parameters}
    for name in (par.name for par in system.parameters if par.name in taken):
        raise UserError(f"a parameter of system {system.name} named like one of a friction law", where="parameters",
                        received=repr(name), allowed=f"other names: {taken[name]} has it", fix="rename it")  # fmt: skip
    coordinates = [c.name for c in system.coordinates]
    applied = _said(system, "applied")
    if not isinstance(applied, Mapping):
        raise UserError(f"no table of forces in system {system.name}", where="applied", received=applied,
                        allowed="forces by coordinate", fix=f"return {{'{coordinates[0]}': ...}}")  # fmt: skip
    for name in applied:
        if name not in coordinates:
            raise UserError(f"force on no coordinate of system {system.name}", where="applied", received=repr(name),
                            allowed=", ".join(coordinates),
                            fix=nearest(name, coordinates) or "name the coordinate that it acts on")  # fmt: skip
    slip = _of_contacts(system, "slip_velocity")
    rates = {c.symbols[1] for c in system.coordinates}
    for contact, velocity in slip.items():
        if not sp.sympify(velocity).free_symbols & rates:
            raise UserError(f"no velocity in the slip velocity of system {system.name}",
                            where=f"slip_velocity {contact}".strip(), received=velocity,
                            allowed=f"an expression of {', '.join(f's.{c}_dot' for c in coordinates)}")  # fmt: skip
    energies = [_said(system, method) for method in ("kinetic", "potential", "dissipation")]
    load = _of_contacts(system, "normal_force") if _own_load(system) else {}
    _check_inertia(system, sp.sympify(energies[0]))
    acting = _symbols([*energies, *applied.values(), *slip.values(), *load.values()])
    for item in system.inputs:  # beside a motion that is imposed one may be what effects alone read, as a load
        if item.symbol not in acting and not type(system).massless:
            raise UserError(f"an input of system {system.name} that acts on nothing", where="inputs",
                            received=repr(item.name), allowed="what an energy or a force holds",
                            fix=f"add s.{item.name} to what applied returns, or leave it out")  # fmt: skip


def _said(system: System, method: str) -> Any:
    """What a method of a system returns; :class:`UserError` where it fails or holds symbols that are not its own."""
    where = f"{method} of system {system.name}"
    try:
        said = getattr(system, method)(system.s, system.p)
        found = _symbols(said.values() if isinstance(said, Mapping) else [said])
    except AttributeError as error:
        own = next((letter for letter in "sp" if error.obj is getattr(system, letter)), "")
        if not own:
            raise _failed(where, error) from error
        valid = [f"{own}.{name}" for name in vars(error.obj)]
        raise UserError(f"unknown name in {where}", where=f"{own}.{error.name}", allowed=", ".join(valid),
                        fix=nearest(f"{own}.{error.name}", valid) or "use one of these") from error  # fmt: skip
    except NotImplementedError as error:
        raise UserError(f"system {system.name} without {method}", where=type(system).__name__,
                        fix=f"define {method}(self, s, p)") from error  # fmt: skip
    except UserError:
        raise
    except Exception as error:
        raise _failed(where, error) from error
    known = {*vars(system.s).values(), *vars(system.p).values(), TIME}
    if strange := sorted(map(str, found - known)):
        raise UserError(f"unknown symbol in {where}", where=method, received=strange[0],
                        allowed="those of s and p", fix=f"write s.{strange[0]} or p.{strange[0]}")  # fmt: skip
    return said


def _failed(where: str, error: Exception) -> UserError:
    return UserError(f"{where} fails", received=f"{type(error).__name__}: {error}", fix="correct it")


def _symbols(expressions: Iterable[Any]) -> set[sp.Symbol]:
    return set().union(*(sp.sympify(e, strict=True).free_symbols for e in expressions))


def _own_load(system: System) -> bool:
    """Whether a system says its normal force itself; else the contact has to hold a coordinate."""
    if not system.constraint_load:
        return True
    if not any(c.constrained for c in system.coordinates):
        raise UserError(f"system {system.name} without a normal force", where=type(system).__name__,
                        fix="define normal_force(self, s, p), or a Coordinate(..., constrained=True)")  # fmt: skip
    return False


def _of_contacts(system: System, method: str) -> dict[str, Any]:
    """What a method says of each contact, of all where it says one thing; :class:`UserError` for other contacts."""
    said, names = _said(system, method), [contact.name for contact in system.contacts]
    if not isinstance(said, Mapping):
        return {"": said}
    for name in [*(name for name in said if name not in names), *(name for name in names if name not in said)]:
        alone = "one expression: its contact has no name"
        raise UserError(f"{method} of system {system.name} is not of its contacts", where=method,
                        received=", ".join(map(str, said)), allowed=", ".join(names) if any(names) else alone,
                        fix=nearest(name, filter(None, names)) or "return them so")  # fmt: skip
    return dict(said)


def _check_inertia(system: System, kinetic: sp.Expr) -> None:
    """Raise :class:`UserError` for a free coordinate without inertia, or a negative energy at these parameters."""
    for c in system.free:
        if not type(system).massless and sp.diff(kinetic, c.symbols[1], 2) == 0:
            raise UserError(f"coordinate {c.name} of system {system.name} without kinetic energy", where="kinetic",
                            received=kinetic, allowed=f"an expression with s.{c.name}_dot**2")  # fmt: skip
    rates = [c.symbols[1] for c in system.coordinates]
    values = {par.symbol: system.values[par.name] for par in system.parameters}
    masses = sp.hessian(kinetic, rates).subs(values) if rates else sp.zeros(0)
    for place in PLACES:
        found = np.array(masses.subs(dict.fromkeys(masses.free_symbols, place)).evalf(), dtype=complex).real
        if len(found) and (least := float(np.linalg.eigvalsh(found)[0])) < -ROUNDING * float(np.abs(found).max()):
            raise UserError(f"negative kinetic energy in system {system.name}", where="kinetic", received=kinetic,
                            allowed=f"above 0 for every motion; its least inertia is {least:.3g}",
                            fix="check signs and values of parameters")  # fmt: skip


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
