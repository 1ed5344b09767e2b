"""A mechanical system with frictional contacts, derived from its energies by Lagrange's method."""

from __future__ import annotations

from copy import copy
from functools import cached_property
from types import SimpleNamespace

import sympy as sp

from ..errors import UserError, nearest
from ..show import readable_unit
from .base import TIME, Parameter, contact_of
from .declarations import (
    Coordinate,
    FrictionalContact,
    Input,
    check_declared,
    check_imposed,
    check_lists,
    check_value,
    checked_driven,
)
from .force_balance import forces_implied, simplified

__all__ = ["TIME", "Coordinate", "FrictionalContact", "Input", "System"]

# What a system with several contacts derives anew for each of them.
OF_ONE_CONTACT = ("v_slip", "N", "jacobian", "slip_position", "a_slip", "a_frictionless", "feedback",
                  "friction_implied", "_views")  # fmt: skip


class System:
    """Base class of all systems: subclasses give energies, forces and the slip velocity, the rest is derived.

    Subclasses set the class attributes and override :meth:`kinetic` and :meth:`slip_velocity`, and where they need
    them :meth:`potential`, :meth:`dissipation` (Rayleigh), :meth:`applied` and :meth:`normal_force`. Methods receive
    ``s``, a namespace with the symbols of every coordinate (``s.x``, ``s.x_dot``, ``s.x_ddot``) and input, and ``p``,
    the parameter symbols.

    With E the Euler-Lagrange expression of a coordinate (left-hand side minus applied forces) and
    J_k = d v_slip_k / d qd, the equation of motion is E + sum_k J_k F_k = 0 over the contacts k.

    A system with several contacts names them in ``contacts``; :meth:`slip_velocity` and :meth:`normal_force` then
    return a table by contact. ``v_slip``, ``N`` and all that follows from them belong to one contact: ask for them as
    ``system.at("hinge").v_slip``.

    Attributes:
        contacts: its contacts; one without a name where a subclass says nothing.
        driven: coordinates whose motion is prescribed when simulating (the swing of the PoB).
        massless: the motion is imposed and the force measured: no equation of motion is integrated (damper, or any
            system of one coordinate with ``imposed``: its inertia then adds to the force that is predicted).
        force_unit, slip_unit: SI units of the friction force and of slip ("N*m" and "rad" for a joint).
        lever: parameter and angle (coordinate) that place a swinging body's centre of mass, where there is one.
    """

    name: str = ""
    title: str = ""
    coordinates: tuple[Coordinate, ...] = ()
    inputs: tuple[Input, ...] = ()
    parameters: tuple[Parameter, ...] = ()
    driven: tuple[str, ...] = ()
    massless: bool = False
    contacts: tuple[FrictionalContact, ...] = ()
    force_unit: str = "N"
    slip_unit: str = "m"
    lever: tuple[str, str] | None = None
    equations_allowed: tuple[str, ...] = ("lagrange",)

    def __init__(
        self,
        equations: str = "lagrange",
        driven: tuple[str, ...] | None = None,
        imposed: bool = False,
        **values: float,
    ):
        if equations not in self.equations_allowed:
            raise UserError(
                "unknown equations",
                where="system.equations",
                received=repr(equations),
                allowed=", ".join(self.equations_allowed),
                fix=nearest(equations, self.equations_allowed) or "use the default, lagrange",
            )
        check_lists(self)
        self.contacts = self.contacts or (FrictionalContact("", self.force_unit, self.slip_unit),)
        self.equations = equations
        self.driven = self.driven if driven is None else checked_driven(self, driven)
        self.values = {par.name: par.value for par in self.parameters}
        for name, value in values.items():
            check_value(self, name, value)
            self.values[name] = float(value)
        check_declared(self)
        if imposed not in (True, False):
            raise UserError("not a switch", where="system.imposed", received=repr(imposed), allowed="True or False")
        self.imposed = bool(imposed)
        if self.imposed and not type(self).massless:
            check_imposed(self)
            self.massless = True

    def __repr__(self) -> str:
        values = ", ".join(
            f"{par.name} = {self.values[par.name]:g} {readable_unit(par.unit)}" for par in self.parameters
        )
        return f"{self.name}, {self.title}: {values}" + (", its motion imposed" if self.imposed else "")

    # what a subclass says ------------------------------------------------------------------------------------
    def kinetic(self, s: SimpleNamespace, p: SimpleNamespace) -> sp.Expr:
        """Kinetic energy, J."""
        return sp.Integer(0)

    def potential(self, s: SimpleNamespace, p: SimpleNamespace) -> sp.Expr:
        """Potential energy, J."""
        return sp.Integer(0)

    def dissipation(self, s: SimpleNamespace, p: SimpleNamespace) -> sp.Expr:
        """Rayleigh dissipation function of dampers other than the contact, W."""
        return sp.Integer(0)

    def applied(self, s: SimpleNamespace, p: SimpleNamespace) -> dict[str, sp.Expr]:
        """Generalised applied force of each coordinate, by the coordinate's name."""
        return {}

    def slip_velocity(self, s: SimpleNamespace, p: SimpleNamespace) -> sp.Expr | dict[str, sp.Expr]:
        """Slip velocity of the contact, or of each by name, linear in the generalised velocities."""
        raise NotImplementedError

    def normal_force(self, s: SimpleNamespace, p: SimpleNamespace) -> sp.Expr | dict[str, sp.Expr]:
        """Normal force of the contact, or of each by name; by default the constraint force."""
        return self.constraint_force()

    def constraint_force(self) -> sp.Expr:
        """The force that holds the constrained coordinate at zero: its Euler-Lagrange expression."""
        for coordinate in self.coordinates:
            if coordinate.constrained:
                return self.euler_lagrange(coordinate)
        raise NotImplementedError

    @property
    def constraint_load(self) -> bool:
        """Whether the normal force is by default that of the constrained coordinate."""
        return type(self).normal_force is System.normal_force

    # its contacts --------------------------------------------------------------------------------------------
    def at(self, contact: str) -> System:
        """The system as one contact sees it: ``v_slip``, ``N``, units and all that follows are that contact's.

        Raises:
            UserError: it has no such contact.
        """
        if len(self.contacts) == 1 and contact in ("", self.contacts[0].name):
            return self
        if contact not in self._views:
            raise UserError(f"unknown contact of system {self.name}", where="contact", received=contact,
                            allowed=", ".join(self._views) or "none by name",
                            fix=nearest(contact, self._views))  # fmt: skip
        return self._views[contact]

    @cached_property
    def _views(self) -> dict[str, System]:
        views: dict[str, System] = {}
        for contact in self.contacts if len(self.contacts) > 1 else ():
            views[contact.name] = view = copy(self)
            for name in OF_ONE_CONTACT:
                view.__dict__.pop(name, None)
            view.contacts, view._whole = (contact,), self
            view.force_unit, view.slip_unit = contact.force_unit, contact.slip_unit
        return views

    _whole: System | None = None  # of a view: the system with all contacts

    @property
    def whole(self) -> System:
        """The system with all its contacts."""
        return self._whole or self

    def _of_contact(self, said: sp.Expr | dict[str, sp.Expr]) -> sp.Expr:
        """What :meth:`slip_velocity` or :meth:`normal_force` says of the only contact."""
        if not isinstance(said, dict):
            return sp.sympify(said)
        if len(self.contacts) > 1:
            names = ", ".join(contact.name for contact in self.contacts)
            raise UserError(f"system {self.name} has several contacts", where="system", received=self.name,
                            allowed="a system with one contact here",
                            fix=f"ask for one of them: {names}")  # fmt: skip
        return sp.sympify(said[self.contacts[0].name])

    # what follows from it ------------------------------------------------------------------------------------
    @cached_property
    def s(self) -> SimpleNamespace:
        """Symbols of the coordinates, their rates and the inputs."""
        space: dict[str, sp.Symbol] = {}
        for coordinate in self.coordinates:
            space.update({symbol.name: symbol for symbol in coordinate.symbols})
        space.update({item.name: item.symbol for item in self.inputs})
        return SimpleNamespace(**space)

    @cached_property
    def p(self) -> SimpleNamespace:
        """Symbols of the parameters."""
        return SimpleNamespace(**{par.name: par.symbol for par in self.parameters})

    @cached_property
    def moving(self) -> tuple[Coordinate, ...]:
        """Coordinates that move (all but the constrained ones)."""
        return tuple(c for c in self.coordinates if not c.constrained)

    @cached_property
    def free(self) -> tuple[Coordinate, ...]:
        """Coordinates whose equation of motion holds the friction force and no unknown drive."""
        return tuple(c for c in self.moving if c.name not in self.driven)

    def _time_derivative(self, expr: sp.Expr) -> sp.Expr:
        total = sp.Integer(0)
        for coordinate in self.coordinates:
            q, qd, qdd = coordinate.symbols
            total += sp.diff(expr, q) * qd + sp.diff(expr, qd) * qdd
        return total

    def _contact_holds(self, expr: sp.Expr) -> sp.Expr:
        zero = {symbol: 0 for c in self.coordinates if c.constrained for symbol in c.symbols}
        return simplified(expr.subs(zero))

    @cached_property
    def _derived(self) -> dict[str, sp.Expr]:
        return {}

    def euler_lagrange(self, coordinate: Coordinate) -> sp.Expr:
        """d/dt dT/dqd - dT/dq + dV/dq + dD/dqd - Q of a coordinate, without the contact's friction and normal force."""
        if coordinate.name in self._derived:
            return self._derived[coordinate.name]
        q, qd, _ = coordinate.symbols
        kinetic, potential = self.kinetic(self.s, self.p), self.potential(self.s, self.p)
        expr = self._time_derivative(sp.diff(kinetic, qd)) - sp.diff(kinetic, q) + sp.diff(potential, q)
        expr += sp.diff(self.dissipation(self.s, self.p), qd)
        applied = self.applied(self.s, self.p).get(coordinate.name, sp.Integer(0))
        return self._derived.setdefault(coordinate.name, self._contact_holds(expr - applied))

    def residual(self, coordinate: Coordinate) -> sp.Expr:
        """The Euler-Lagrange expression in the chosen form of the equations (an override may publish another)."""
        return self.euler_lagrange(coordinate)

    @cached_property
    def v_slip(self) -> sp.Expr:
        """Slip velocity as an expression."""
        return self._contact_holds(self._of_contact(self.slip_velocity(self.s, self.p)))

    @cached_property
    def N(self) -> sp.Expr:
        """Normal force as an expression."""
        return self._contact_holds(self._of_contact(self.normal_force(self.s, self.p)))

    @cached_property
    def jacobian(self) -> dict[str, sp.Expr]:
        """J = d v_slip / d qd, by coordinate name."""
        return {c.name: sp.diff(self.v_slip, c.symbols[1]) for c in self.moving}

    @cached_property
    def slip_position(self) -> sp.Expr | None:
        """The position whose rate is the slip velocity; None where the slip velocity cannot be integrated simply."""
        if any(not sp.sympify(j).is_constant(*self._motion) for j in self.jacobian.values()):
            return None
        return sum((j * c.symbols[0] for c in self.moving for j in [self.jacobian[c.name]]), start=sp.Integer(0))

    @property
    def _motion(self) -> tuple[sp.Symbol, ...]:
        return tuple(symbol for c in self.coordinates for symbol in c.symbols)

    @cached_property
    def carried(self) -> sp.Expr:
        """Force that the imposed motion needs beside friction: its inertia; 0 where nothing is imposed."""
        if not self.massless or not self.imposed:
            return sp.Integer(0)
        (c,) = self.moving
        return self.residual(c).subs(self.inputs[0].symbol, 0)

    @cached_property
    def acting(self) -> frozenset[sp.Symbol]:
        """Symbols that take part in what a simulation solves: the free coordinates' equations and the contacts."""
        rows = (self.carried,) if self.massless else tuple(self.residual(c) for c in self.free)
        at_contacts = (e for view in self.each for e in (view.v_slip, view.N))
        return frozenset().union(*(sp.sympify(e).free_symbols for e in (*at_contacts, *rows)))

    @property
    def each(self) -> tuple[System, ...]:
        """The system as each of its contacts sees it."""
        return tuple(self.whole.at(contact.name) for contact in self.whole.contacts)

    @cached_property
    def friction_implied(self) -> sp.Expr:
        """The friction force that the measured motion implies: the least-squares solution of E + sum_k J_k F_k = 0.

        Raises:
            UserError: fewer equations than contacts hold a friction force, and do not tell the forces apart.
        """
        names = [contact.name for contact in self.whole.contacts]
        return forces_implied(self.whole, names)[self.contacts[0].name]

    @cached_property
    def a_slip(self) -> sp.Expr:
        """Slip acceleration: the time derivative of the slip velocity."""
        return simplified(self._time_derivative(self.v_slip))

    @cached_property
    def a_frictionless(self) -> sp.Expr:
        """Slip acceleration if the contact had no friction; that of the imposed motion where it is imposed."""
        if self.massless:
            return self.a_slip
        accelerations = [c.symbols[2] for c in self.free]
        solution = sp.solve([self.residual(c) for c in self.free], accelerations, dict=True)[0]
        free = self.a_slip.subs(solution)
        return simplified(free) if len(self.whole.contacts) == 1 else free  # of two links it would take a minute

    @cached_property
    def feedback(self) -> tuple[sp.Expr, sp.Expr]:
        """Slopes of a_frictionless in slip position and slip velocity where slip is that of the only free coordinate;
        0 elsewhere, where the slip alone does not tell the motion."""
        if self.massless or len(self.free) != 1 or self.slip_position is None:
            return sp.Integer(0), sp.Integer(0)
        (c,) = self.free
        q, qd, _ = c.symbols
        lever = self.jacobian[c.name]
        return sp.diff(self.a_frictionless, q) / lever, sp.diff(self.a_frictionless, qd) / lever

    @property
    def signal_units(self) -> dict[str, str]:
        """SI unit of every signal that a recording of this system may hold."""
        units = {"t": "s"}
        for coordinate in self.moving:
            units.update(zip(coordinate.signals, coordinate.units, strict=True))
        units.update({item.name: item.unit for item in self.inputs})
        return {name: unit for name, unit in units.items() if name}

    def unit(self, parameter: Parameter) -> str:
        """Unit of a law's parameter on this system: {F} and {L} become its contact's units of force and slip."""
        name = contact_of(parameter.name)
        contact = self.at(name) if name else self
        return parameter.unit.format(F=contact.force_unit, L=contact.slip_unit)
