"""A mechanism: one system with one friction law, as the equations that everything else is derived from."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import sympy as sp

from .base import CONTACT, FrictionLaw, Parameter
from .system import TIME, Coordinate, System


@dataclass(frozen=True)
class Mechanism:
    """System and friction law together.

    The implicit equations of motion are R(q, v, a, z, z', u, t; p) = 0 with one row for each free coordinate,
    E + J F_f(v_slip, F_N, z, z'), and for a law with memory the row z' - rate(v_slip, F_N, z). ``u`` holds position,
    velocity and acceleration of every driven coordinate, then the inputs.
    """

    system: System
    law: FrictionLaw

    @property
    def name(self) -> str:
        """``pob+lugre``."""
        return f"{self.system.name}+{self.law.name}"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Parameters of the system, then of the law."""
        return (*self.system.parameters, *self.law.parameters)

    @property
    def units(self) -> dict[str, str]:
        """SI unit of every parameter on this system."""
        return {par.name: self.system.unit(par) for par in self.parameters}

    @property
    def free(self) -> tuple[Coordinate, ...]:
        """Coordinates that a simulation integrates; none where the motion is imposed."""
        return () if self.system.massless else self.system.free

    @property
    def driven(self) -> tuple[Coordinate, ...]:
        """Coordinates whose motion a simulation is given."""
        return tuple(c for c in self.system.moving if c not in self.free)

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

    @cached_property
    def contact(self) -> dict[sp.Symbol, sp.Expr]:
        """Slip velocity and normal force in terms of the motion."""
        return {CONTACT.v: self.system.v_slip, CONTACT.N: self.system.N}

    @cached_property
    def friction(self) -> sp.Expr:
        """Friction force in terms of the motion, z and z'."""
        return sp.sympify(self.law.force(CONTACT, self.law.symbols)).subs(self.contact)

    @cached_property
    def bristle_rate(self) -> sp.Expr:
        """z' in terms of the motion and z; 0 for a law without memory."""
        if not self.law.memory:
            return sp.Integer(0)
        return sp.sympify(self.law.bristle_rate(CONTACT, self.law.symbols)).subs(self.contact)

    @cached_property
    def residuals(self) -> tuple[sp.Expr, ...]:
        """The rows R, free coordinates first, the bristle state last."""
        rows = [self.system.residual(c) + self.system.jacobian[c.name] * self.friction for c in self.free]
        if self.law.memory:
            rows.append(CONTACT.zdot - self.bristle_rate)
        return tuple(rows)

    @property
    def time(self) -> sp.Symbol:
        """The symbol of time."""
        return TIME
