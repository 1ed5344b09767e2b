"""A mechanism: a system, friction laws and effects, as the equations that everything else is derived from."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from numbers import Real
from types import SimpleNamespace
from typing import Any

import sympy as sp

from ..errors import UserError, nearest
from ..show import Shown, Table, readable_unit
from .base import MU_C, MU_S, SESSION, TIME, TRIAL, Contact, FrictionLaw, Parameter
from .contact_friction import ContactFriction
from .contacts import laws_of
from .effect import Effect, State
from .effects import chosen
from .system import Coordinate, System

REQUIRED = sp.Symbol("F_required", real=True)  # the value of Mechanism.required at a sample


@dataclass(frozen=True, repr=False)
class Mechanism(Shown):
    """System, friction law and effects together.

    The implicit equations of motion are R(q, v, a, z, z', u, c; p) = 0 with one row for each free coordinate,
    E + sum_k J_k F_k(v_k, N_k, z_k, z_k') over the contacts k, and for each of them whose law has memory the row
    z_k' - rate(v_k, N_k, z_k). ``u`` holds position, velocity and acceleration of every driven coordinate, then the
    inputs; ``c`` the clocks that effects read.

    Effects, given by name or as objects, enter these equations with parameters of their own; at the neutral values of
    those the equations are the ones without effects.

    On a system with several contacts the law is one for all, or a table with one for each contact (``law`` is then a
    :class:`.contacts.ContactLaws`), parameters carry the contact's name (``hinge.mu_c``), and an effect that acts at a
    contact says at which (``asymmetry@hinge``).
    """

    system: System
    law: FrictionLaw
    effects: tuple[Effect, ...] = ()

    def __post_init__(self):
        object.__setattr__(self, "law", laws_of(self.system, self.law))
        object.__setattr__(self, "effects", chosen(self.effects, self.system, self.law))

    @property
    def name(self) -> str:
        """``pob+lugre``, ``drive+coulomb+drag+delay``."""
        return "+".join([self.system.name, self.law.name, *(e.name for e in self.effects)])

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Parameters of the system, then of the law, then of the effects."""
        own = [par for effect in self.effects for par in effect.parameters_on(self.system, self.law)]
        return tuple({par.name: par for par in (*self.system.parameters, *self.law.parameters, *own)}.values())

    @property
    def units(self) -> dict[str, str]:
        """SI unit of every parameter on this system."""
        return {par.name: self.system.unit(par) for par in self.parameters}

    @property
    def read_in(self) -> dict[str, str]:
        """Units in which people read the parameters: SI, a friction coefficient in that of the force where a preload
        of 1 stands for a normal force that nobody knows."""
        units = self.units
        for par in (MU_C, MU_S):
            for name in (n for n in units if n.rpartition(".")[2] == par.name):
                contact = self.system.at(name.rpartition(".")[0]) if "." in name else self.system
                if self.system.values.get(str(contact.N)) == 1.0:
                    units[name] = f"{readable_unit(contact.force_unit)} at a preload of 1"
        return units

    @cached_property
    def p(self) -> SimpleNamespace:
        """Symbols of the parameters."""
        return SimpleNamespace(**{par.name: par.symbol for par in self.parameters})

    def tables(self) -> list[Table]:
        """Its parameters with their values, where they are known, and the signals that a recording may hold."""
        known = {par.name: par.value for par in self.parameters} | self.system.values
        units = {name: readable_unit(unit) for name, unit in self.read_in.items()}
        rows = [(p.name, known[p.name], units[p.name], p.text) for p in self.parameters]
        signals = ", ".join(f"{name} ({readable_unit(unit)})" for name, unit in self.system.signal_units.items())
        title = f"{self.name}: {self.system.title} with {self.law.name} friction"
        return [Table(("parameter", "value", "unit", ""), tuple(rows), title, (f"signals: {signals}",))]

    def to_dict(self) -> dict[str, Any]:
        """System, law and effects by name, and the values of the system's parameters."""
        laws = {contact.name: contact.law.name for contact in self.contacts}
        friction = self.law.name if len(laws) == 1 else laws
        return {"system": self.system.name, "parameters": dict(self.system.values), "friction": friction,
                "effects": [effect.name for effect in self.effects]}  # fmt: skip

    def check_names(self, names: Iterable[str], where: str) -> None:
        """Raise :class:`UserError`, which tells ``where``, for a name that is no parameter of the mechanism."""
        table = [par.name for par in self.parameters]
        for name in names:
            if name not in table:
                fix = nearest(name, table) or "use one of these"
                raise UserError("unknown parameter", where=f"{where}.{name}", allowed=", ".join(table), fix=fix)

    def check_values(self, values: Mapping[str, object], where: str) -> None:
        """Raise :class:`UserError`, which tells ``where``, for an unknown name or a value out of its physical range."""
        self.check_names(values, where)
        table = {par.name: par for par in self.parameters}
        for name, value in values.items():
            par, number = table[name], isinstance(value, Real) and not isinstance(value, bool)
            if not number or not math.isfinite(value) or not par.low <= value <= par.high:  # type: ignore[arg-type, operator]
                unit = "" if par.unit == "1" else f" {readable_unit(par.unit)}"
                raise UserError("impossible value", where=f"{where}.{name}", received=value if number else repr(value),
                                allowed=f"a number from {par.low:g} to {par.high:g}{unit}")  # fmt: skip

    @property
    def free(self) -> tuple[Coordinate, ...]:
        """Coordinates that a simulation integrates; none where the motion is imposed."""
        return () if self.system.massless else self.system.free

    @property
    def driven(self) -> tuple[Coordinate, ...]:
        """Coordinates whose motion a simulation is given."""
        return tuple(c for c in self.system.moving if c not in self.free)

    @cached_property
    def contacts(self) -> tuple[ContactFriction, ...]:
        """Friction at each contact."""
        return tuple(ContactFriction(self, contact.name) for contact in self.system.contacts)

    @property
    def only(self) -> ContactFriction:
        """Friction at the only contact.

        Raises:
            UserError: there are several.
        """
        if len(self.contacts) > 1:
            names = ", ".join(contact.name for contact in self.contacts)
            raise UserError(f"system {self.system.name} has several contacts", where="system", received=names,
                            allowed="a system with one contact here", fix="choose such a system")  # fmt: skip
        return self.contacts[0]

    @cached_property
    def bristles(self) -> tuple[ContactFriction, ...]:
        """The contacts with a bristle state, of the law or of an effect."""
        return tuple(contact for contact in self.contacts if contact.memory)

    @property
    def memory(self) -> bool:
        """Whether there is a bristle state."""
        return bool(self.bristles)

    @cached_property
    def _neutral(self) -> dict[str, dict[str, float]]:
        """Effect -> {strength: value at which it does nothing}."""
        tables = {e.name: e.parameters_on(self.system, self.law) for e in self.effects}
        return {name: {par.name: par.neutral for par in own if par.neutral is not None} for name, own in tables.items()}

    def acts(self, effect: Effect, values: Mapping[str, float], free: Collection[str] = ()) -> bool:
        """Whether these values of parameters, SI units, switch an effect on, or one of its strengths is ``free``."""
        return any(name in free or values.get(name, off) != off for name, off in self._neutral[effect.name].items())

    def jumps(self, values: Mapping[str, float], free: Collection[str] = ()) -> bool:
        """Whether friction jumps where a body stops: there is no bristle, or only of effects that do not act."""
        if any(contact.law.memory for contact in self.contacts):
            return False
        return not any(e.memory and self.acts(e, values, free) for e in self.effects)

    @cached_property
    def states(self) -> tuple[State, ...]:
        """Further states, of effects, contact by contact."""
        return tuple(state for contact in self.contacts for state in contact.states)

    @property
    def inputs(self) -> tuple[sp.Symbol, ...]:
        """Symbols of ``u``: q, v, a of each driven coordinate, then the inputs."""
        motion = [symbol for c in self.driven for symbol in c.symbols]
        return (*motion, *(item.symbol for item in self.system.inputs))

    @property
    def input_signals(self) -> tuple[str, ...]:
        """Names of the signals that fill ``u``, in the same order."""
        motion = [name for c in self.driven for name in c.signals]
        return (*motion, *(item.name for item in self.system.inputs))

    # the equations -------------------------------------------------------------------------------------------
    def _replaced(self, expr: sp.Expr, effects: Iterable[Effect] | None = None) -> sp.Expr:
        """The expression with the symbols that effects replace, by default all of them."""
        for effect in self.effects if effects is None else effects:
            expr = sp.sympify(expr).xreplace(effect.replace(self.system, self.law, self.p))
        return expr

    @cached_property
    def residuals(self) -> tuple[sp.Expr, ...]:
        """The rows R: free coordinates, states of effects, the bristle states last."""
        whole = [e for e in self.effects if len(self.contacts) == 1 or e.whole]
        rows = []
        for c in self.free:
            row = self._replaced(self.system.residual(c), whole)
            for contact in self.contacts:
                row = row + contact.system.jacobian[c.name] * contact.friction
            rows.append(row)
        rows += [row for contact in self.contacts for row in contact.state_rows]
        rows += [contact.zdot - contact.bristle_rate for contact in self.bristles]
        return tuple(rows)

    @cached_property
    def required(self) -> sp.Expr:
        """Force that an imposed motion requires: friction and what its inertia and other forces take."""
        return self.only.friction + self._replaced(self.system.carried)

    # the only contact, see ContactFriction -------------------------------------------------------------------
    @property
    def contact(self) -> dict[sp.Symbol, sp.Expr]:
        """Slip velocity and normal force in terms of the motion."""
        return self.only.motion

    @property
    def friction(self) -> sp.Expr:
        """Friction force in terms of the motion, z and z'."""
        return self.only.friction

    @property
    def bristle_rate(self) -> sp.Expr:
        """z' in terms of the motion and z."""
        return self.only.bristle_rate

    @property
    def _seen(self) -> Contact:
        return self.only.seen

    def _in_motion(self, expr: sp.Expr) -> sp.Expr:
        return self.only.in_motion(expr)

    # what is measured ----------------------------------------------------------------------------------------
    @property
    def predictions(self) -> dict[str, sp.Symbol]:
        """Signal -> symbol of the truth that a simulation predicts; the required force of an imposed motion."""
        if self.system.massless:
            return {self.system.inputs[0].name: REQUIRED}
        return {name: symbol for c in self.free for name, symbol in zip(c.signals, c.symbols, strict=True)}

    @cached_property
    def outputs(self) -> dict[str, sp.Expr]:
        """Signal -> what its sensor shows, in terms of the truth (``predictions``) and parameters; see ``delays``."""
        result: dict[str, sp.Expr] = dict(self.predictions)
        for effect in self.effects:
            result = {name: effect.sensor(self.system, name, expr, self.p) for name, expr in result.items()}
        return result

    @cached_property
    def motion_sensors(self) -> dict[str, tuple[sp.Expr, sp.Expr]]:
        """Signal of a driven coordinate -> factor and offset of its sensor, shown = factor * true + offset; those that
        effects change, from the truth that they put in the equations in its place."""
        result: dict[str, tuple[sp.Expr, sp.Expr]] = {}
        for name, symbol in (pair for c in self.driven for pair in zip(c.signals, c.symbols, strict=True)):
            truth = self._replaced(symbol)
            slope, rest = sp.diff(truth, symbol), truth.subs(symbol, 0)
            if truth != symbol and slope.free_symbols | rest.free_symbols <= {par.symbol for par in self.parameters}:
                result[name] = (1 / slope, -rest / slope)
        return result

    @property
    def delays(self) -> dict[str, dict[str, float]]:
        """Signal -> {parameter: sign}: by this sum, in s, a prediction is measured late, or an input acts late."""
        result: dict[str, dict[str, float]] = {}
        for effect in self.effects:
            for name, terms in effect.delays(self.system, self.law).items():
                result[name] = result.get(name, {}) | terms
        return result

    @property
    def delays_of_inputs(self) -> dict[str, dict[str, float]]:
        """The same delays on the clock of the sensors: what makes all predictions late lets all inputs act late.

        Not where the motion is imposed: the predicted force is smoother than the measured motion that would be shifted.
        """
        result = self.delays
        if self.system.massless:
            return result
        late = dict(set.intersection(*(set(result.get(name, {}).items()) for name in self.predictions)))
        for name in self.predictions if late else ():
            result[name] = {parameter: sign for parameter, sign in result[name].items() if parameter not in late}
        for name in self.input_signals if late else ():
            result[name] = late | result.get(name, {})
        return {name: terms for name, terms in result.items() if terms}

    @cached_property
    def clocks(self) -> tuple[sp.Symbol, ...]:
        """What enters the equations of the time of the trial, the time of the session and the trial's number."""
        forces = [self.required] if self.system.massless else [contact.friction for contact in self.contacts]
        found = set().union(*(sp.sympify(expr).free_symbols for expr in (*self.residuals, *forces)))
        return tuple(symbol for symbol in (TIME, SESSION, TRIAL) if symbol in found)
