"""A mechanism: a system, a friction law and effects, as the equations that everything else is derived from."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from numbers import Real
from types import SimpleNamespace
from typing import Any

import sympy as sp

from ..errors import UserError, nearest
from ..show import Shown, Table, readable_unit
from .base import CONTACT, SESSION, TIME, TRIAL, Contact, FrictionLaw, Parameter
from .effect import Effect, State
from .effects import chosen
from .system import Coordinate, System

FRICTION = sp.Symbol("F_f", real=True)


@dataclass(frozen=True, repr=False)
class Mechanism(Shown):
    """System, friction law and effects together.

    The implicit equations of motion are R(q, v, a, z, z', u, c; p) = 0 with one row for each free coordinate,
    E + J F_f(v_slip, F_N, z, z'), and for a law with memory the row z' - rate(v_slip, F_N, z). ``u`` holds position,
    velocity and acceleration of every driven coordinate, then the inputs; ``c`` the clocks that effects read.

    Effects, given by name or as objects, enter these equations with parameters of their own; at the neutral values of
    those the equations are the ones without effects.
    """

    system: System
    law: FrictionLaw
    effects: tuple[Effect, ...] = ()

    def __post_init__(self):
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

    @cached_property
    def p(self) -> SimpleNamespace:
        """Symbols of the parameters."""
        return SimpleNamespace(**{par.name: par.symbol for par in self.parameters})

    def tables(self) -> list[Table]:
        """Its parameters with their values, where they are known, and the signals that a recording may hold."""
        known = {par.name: par.value for par in self.parameters} | self.system.values
        rows = [(p.name, known[p.name], readable_unit(self.units[p.name]), p.text) for p in self.parameters]
        signals = ", ".join(f"{name} ({readable_unit(unit)})" for name, unit in self.system.signal_units.items())
        title = f"{self.name}: {self.system.title} with {self.law.name} friction"
        return [Table(("parameter", "value", "unit", ""), tuple(rows), title, (f"signals: {signals}",))]

    def to_dict(self) -> dict[str, Any]:
        """System, law and effects by name, and the values of the system's parameters."""
        return {"system": self.system.name, "parameters": dict(self.system.values), "friction": self.law.name,
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
                unit = "" if par.unit == "1" else f" {par.unit}"
                raise UserError("impossible value", where=f"{where}.{name}", received=value,
                                allowed=f"a number from {par.low:g} to {par.high:g}{unit}")  # fmt: skip

    @property
    def free(self) -> tuple[Coordinate, ...]:
        """Coordinates that a simulation integrates; none where the motion is imposed."""
        return () if self.system.massless else self.system.free

    @property
    def driven(self) -> tuple[Coordinate, ...]:
        """Coordinates whose motion a simulation is given."""
        return tuple(c for c in self.system.moving if c not in self.free)

    @property
    def memory(self) -> bool:
        """Whether there is a bristle state, of the law or of an effect."""
        return self.law.memory or any(effect.memory for effect in self.effects)

    @property
    def states(self) -> tuple[State, ...]:
        """Further states, of effects."""
        return tuple(state for effect in self.effects for state in effect.states)

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
    def _replaced(self, expr: sp.Expr) -> sp.Expr:
        """The expression with the symbols that effects replace."""
        for effect in self.effects:
            expr = sp.sympify(expr).xreplace(effect.replace(self.system, self.law, self.p))
        return expr

    def _in_motion(self, expr: sp.Expr) -> sp.Expr:
        """An expression of the contact in terms of the motion."""
        if not self.effects:
            return sp.sympify(expr).subs(self.contact)
        return self._replaced(expr).xreplace(self.contact)

    @cached_property
    def contact(self) -> dict[sp.Symbol, sp.Expr]:
        """Slip velocity and normal force in terms of the motion; with effects, slip position and acceleration too."""
        system = self.system
        if not self.effects:
            return {CONTACT.v: system.v_slip, CONTACT.N: system.N}
        seen = {CONTACT.v: system.v_slip, CONTACT.N: system.N, CONTACT.a: system.a_slip}
        if system.slip_position is not None:
            seen[CONTACT.s] = system.slip_position
        return {symbol: self._replaced(expr) for symbol, expr in seen.items()}

    @cached_property
    def _seen(self) -> Contact:
        """The contact as the law sees it: with the load and the bristle's deflection that effects leave."""
        N, z = CONTACT.N, CONTACT.z
        for effect in self.effects:
            N, z = effect.load(N, CONTACT, self.p), effect.deflection(z, self.p)
        zdot = CONTACT.zdot if z == CONTACT.z else sp.diff(z, CONTACT.z) * CONTACT.zdot
        return replace(CONTACT, N=N, z=z, zdot=zdot)

    @cached_property
    def friction(self) -> sp.Expr:
        """Friction force of law and effects in terms of the motion, z and z'; with the inertia of an imposed motion."""
        force = sp.sympify(self.law.force(self._seen, self.law.symbols))
        force = self._in_motion(sum((e.force(self._seen, self.p, self.law) for e in self.effects), start=force))
        return force + self._replaced(self.system.carried)

    @cached_property
    def bristle_rate(self) -> sp.Expr:
        """z' in terms of the motion and z; 0 where there is no bristle."""
        if self.law.memory:
            return self._in_motion(self.law.bristle_rate(self._seen, self.law.symbols))
        for effect in self.effects:
            if effect.memory:
                return self._in_motion(effect.bristle_rate(self._seen, self.p, self.law))
        return sp.Integer(0)

    @cached_property
    def residuals(self) -> tuple[sp.Expr, ...]:
        """The rows R: free coordinates, states of effects, the bristle state last."""
        system = self.system
        rows = [self._replaced(system.residual(c)) + system.jacobian[c.name] * self.friction for c in self.free]
        rates = [rate for effect in self.effects for rate in effect.state_rates(self._seen, self.p)]
        rows += [state.rate - self._in_motion(rate) for state, rate in zip(self.states, rates, strict=True)]
        if self.memory:
            rows.append(CONTACT.zdot - self.bristle_rate)
        return tuple(rows)

    # what is measured ----------------------------------------------------------------------------------------
    @property
    def predictions(self) -> dict[str, sp.Symbol]:
        """Signal -> symbol of the truth that a simulation predicts; F_f where the motion is imposed."""
        if self.system.massless:
            return {item.name: FRICTION for item in self.system.inputs}
        return {name: symbol for c in self.free for name, symbol in zip(c.signals, c.symbols, strict=True)}

    @cached_property
    def outputs(self) -> dict[str, sp.Expr]:
        """Signal -> what its sensor shows, in terms of the truth (``predictions``) and parameters; see ``delays``."""
        result: dict[str, sp.Expr] = dict(self.predictions)
        for effect in self.effects:
            result = {name: effect.sensor(self.system, name, expr, self.p) for name, expr in result.items()}
        return result

    @property
    def delays(self) -> dict[str, dict[str, float]]:
        """Signal -> {parameter: sign}: by this sum, in s, a prediction is measured late, or an input acts late."""
        result: dict[str, dict[str, float]] = {}
        for effect in self.effects:
            for name, terms in effect.delays(self.system, self.law).items():
                result[name] = result.get(name, {}) | terms
        return result

    @cached_property
    def clocks(self) -> tuple[sp.Symbol, ...]:
        """What enters the equations of the time of the trial, the time of the session and the trial's number."""
        found = set().union(*(sp.sympify(expr).free_symbols for expr in (*self.residuals, self.friction)))
        return tuple(symbol for symbol in (TIME, SESSION, TRIAL) if symbol in found)
