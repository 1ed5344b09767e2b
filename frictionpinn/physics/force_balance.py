"""What the equations of motion say of the friction forces at several contacts, instant by instant."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import TYPE_CHECKING

import sympy as sp

from ..errors import UserError

if TYPE_CHECKING:
    from .system import System

simplified = lru_cache(maxsize=1024)(sp.simplify)  # systems of one kind derive the same equations again and again


def balance(system: System, contacts: Sequence[str]) -> tuple[sp.Matrix, sp.Matrix]:
    """J, shape (equations, contacts), and E, shape (equations, 1), of the rows E_i + sum_k J_ik F_k = 0.

    Args:
        system: with all its contacts.
        contacts: names of those that have friction. Rows are the free coordinates whose equation holds such a force.
    """
    views = [system.at(name) for name in contacts]
    rows = [([view.jacobian[c.name] for view in views], system.residual(c)) for c in system.free]
    held = [(slopes, residual) for slopes, residual in rows if any(slope != 0 for slope in slopes)]
    J = sp.Matrix(len(held), len(views), [slope for slopes, _ in held for slope in slopes])
    return J, sp.Matrix(len(held), 1, [residual for _, residual in held])


def untold(system: System, contacts: Sequence[str]) -> list[str]:
    """The contacts whose friction forces the balance does not tell apart: those in the null space of J."""
    J, _ = balance(system, contacts)
    null = J.nullspace() if J.rows else [sp.ones(len(contacts), 1)]
    return [name for k, name in enumerate(contacts) if any(vector[k] != 0 for vector in null)]


def check_told(system: System, contacts: Sequence[str]) -> None:
    """Raise :class:`UserError` where the balance does not tell the forces apart, at no instant of any motion."""
    lost = untold(system, contacts)
    if lost:
        raise UserError(
            "the equations of motion do not tell the friction forces apart",
            where="system",
            received=f"{system.name}: {' and '.join(lost)}, {len(system.free)} free of "
            f"{len(system.moving)} coordinates",
            allowed="as many free coordinates as contacts with friction, each of them moved by another",
            fix=f"say friction.{lost[-1]}=none if it has none, system.driven=[] if the inputs were recorded, or "
            "simulate instead: identify.py methods=[maximum_likelihood], diagnose.py",
        )


def forces_implied(system: System, contacts: Sequence[str]) -> dict[str, sp.Expr]:
    """The friction force of each contact that the motion implies: the least-squares solution of the balance.

    Args:
        system: with all its contacts.
        contacts: names of those that have friction; the others have none.

    Raises:
        UserError: see :func:`check_told`.
    """
    check_told(system, contacts)
    J, E = balance(system, contacts)
    J.simplify()
    implied = -(J.T * J).inv() * J.T * E
    return {name: simplified(force) for name, force in zip(contacts, implied, strict=True)}
