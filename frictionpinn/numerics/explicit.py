"""Equations of motion solved for the accelerations, the friction force given: for networks, and by any integrator."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache

import sympy as sp

from ..errors import UserError
from ..physics import LAWS, System
from ..physics.mechanism import Mechanism
from .torch_functions import numpy_function, torch_function

FORCE = sp.Symbol("friction_force", real=True)


@dataclass(frozen=True)
class ExplicitMotion:
    """Expressions of q (free coordinates), v (their rates), u (driven coordinates, inputs) and the parameters p.

    Attributes:
        known: symbols of q, v, u and p, in that order.
        contact: slip velocity, normal force and frictionless slip acceleration.
        accelerations: of the free coordinates, from E + J F = 0; they hold the symbol ``FORCE`` too.
        slip_acceleration: with these accelerations; holds ``FORCE`` too.
    """

    known: tuple[sp.Symbol, ...]
    contact: tuple[sp.Expr, ...]
    accelerations: tuple[sp.Expr, ...]
    slip_acceleration: sp.Expr

    @cached_property
    def numpy(self) -> tuple[Callable, Callable]:
        """(q, v, u, p) -> contact, and (F, q, v, u, p) -> [accelerations, slip acceleration], on numpy arrays."""
        moving = [*self.accelerations, self.slip_acceleration]
        return numpy_function(self.known, list(self.contact)), numpy_function([FORCE, *self.known], moving)

    @cached_property
    def torch(self) -> tuple[Callable, Callable]:
        """(q, v, u, p) -> contact, and (F, q, v, u, p) -> accelerations, on tensors."""
        contact = torch_function(self.known, list(self.contact))
        if not self.accelerations:
            return contact, lambda *_: []
        return contact, torch_function([FORCE, *self.known], list(self.accelerations))


def explicit_motion(system: System) -> ExplicitMotion:
    """Solve a system's equations of motion for the accelerations of its free coordinates.

    Raises:
        UserError: the normal force depends on the accelerations that the friction decides.
    """
    return _solve(type(system), system.equations, system.driven)  # type: ignore[arg-type]


@lru_cache(maxsize=32)
def _solve(kind: type[System], equations: str, driven: tuple[str, ...]) -> ExplicitMotion:
    system = kind(equations=equations, driven=driven)
    mechanism = Mechanism(system, LAWS["coulomb"]())
    unknown = [c.symbols[2] for c in mechanism.free]
    if system.N.free_symbols & set(unknown):
        raise UserError(
            "normal force depends on accelerations that the friction decides",
            where=f"system {system.name}, driven",
            received=", ".join(driven) or "none",
            allowed="a system whose normal force the state and the inputs give",
            fix="prescribe the coordinate that loads the contact",
        )
    state = [c.symbols[k] for k in (0, 1) for c in mechanism.free]
    known = (*state, *mechanism.inputs, *(par.symbol for par in system.parameters))
    contact = (system.v_slip, system.N, system.a_frictionless)
    if not unknown:
        return ExplicitMotion(known, contact, (), system.a_slip)
    rows = [system.residual(c) + system.jacobian[c.name] * FORCE for c in mechanism.free]
    solution = sp.solve(rows, unknown, dict=True)[0]
    accelerations = tuple(solution[symbol] for symbol in unknown)
    return ExplicitMotion(known, contact, accelerations, system.a_slip.subs(solution))
