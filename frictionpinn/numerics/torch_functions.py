"""Torch and numpy functions generated from the symbolic physics."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache

import numpy as np
import sympy as sp
import torch

from ..physics import CONTACT, FrictionLaw, System
from ..physics.base import at_contact
from ..physics.force_balance import balance, forces_implied

_TORCH = [
    {
        "Abs": torch.abs,
        "sign": torch.sign,
        "sqrt": torch.sqrt,
        "exp": torch.exp,
        "tanh": torch.tanh,
        "sin": torch.sin,
        "cos": torch.cos,
        "log": torch.log,
    },
    "math",
]


def torch_function(arguments: Sequence[sp.Symbol], expression: sp.Expr | Sequence[sp.Expr]) -> Callable:
    """Return a torch function of the arguments (tensors or floats, broadcast) for one expression or several."""
    return sp.lambdify(list(arguments), expression, modules=_TORCH, cse=True)


def numpy_function(arguments: Sequence[sp.Symbol], expression: sp.Expr | Sequence[sp.Expr]) -> Callable:
    """Return a numpy function of the arguments (arrays or floats, broadcast)."""
    return sp.lambdify(list(arguments), expression, modules="numpy", cse=True)


CONTACT_SIGNALS = ("v_slip", "normal_force", "a_slip", "a_frictionless", "friction_force")


@lru_cache(maxsize=96)
def _along_motion(
    of: Callable[..., Sequence[sp.Expr]],
    kind: Callable[..., System],
    equations: str,
    driven: tuple[str, ...],
    contacts: tuple[str, ...],
) -> tuple[Callable, tuple[str, ...]]:
    system = kind(equations=equations, driven=driven)
    symbols = [symbol for c in system.moving for symbol in c.symbols] + [item.symbol for item in system.inputs]
    names = [name for c in system.moving for name in c.signals] + [item.name for item in system.inputs]
    arguments = [*symbols, *(par.symbol for par in system.parameters)]
    return numpy_function(arguments, list(of(system, contacts))), tuple(names)


def _evaluated(
    of: Callable[..., Sequence[sp.Expr]], system: System, signals: dict[str, np.ndarray], contacts: tuple[str, ...]
) -> list[np.ndarray]:
    """Expressions ``of(system, contacts)`` along a motion, each of shape (n,); an absent signal counts as zero."""
    made = type(system), system.equations, system.driven
    function, names = _along_motion(of, *made, contacts)  # type: ignore[arg-type]
    n = len(next(iter(signals.values())))
    columns = [np.asarray(signals[name], float) if name in signals else np.zeros(n) for name in names]
    values = function(*columns, *(system.values[par.name] for par in system.parameters))
    return [np.broadcast_to(np.asarray(value, float), (n,)) for value in values]


def _of_contacts(system: System, contacts: tuple[str, ...]) -> list[sp.Expr]:
    views = [system.at(name) for name in contacts]
    own = [e for at in views for e in (at.v_slip, at.N, at.a_slip, at.a_frictionless)]
    return own + list(forces_implied(system, contacts).values())


def _of_balance(system: System, contacts: tuple[str, ...]) -> list[sp.Expr]:
    return list(balance(system, contacts)[0])


def _of_feedback(system: System, contacts: tuple[str, ...]) -> list[sp.Expr]:
    return list(system.feedback)


def contact_signals(
    system: System, signals: dict[str, np.ndarray], contacts: Sequence[str] | None = None
) -> dict[str, np.ndarray]:
    """Slip velocity, normal force, slip acceleration, frictionless acceleration, implied friction force.

    Args:
        system: gives the equations and the values of its parameters.
        signals: measured signals by name, each of shape (n,); an absent input counts as zero.
        contacts: names of the contacts with friction; None: all.

    Returns:
        name (see ``CONTACT_SIGNALS``; ``hinge.v_slip`` with several contacts) -> array of shape (n,), SI units.

    Raises:
        UserError: the force balance does not tell the friction forces of these contacts apart.
    """
    own = tuple(contact.name for contact in system.contacts) if contacts is None else tuple(contacts)
    kinds, prefix = CONTACT_SIGNALS[:-1], len(system.contacts) > 1
    keys = [at_contact(contact if prefix else "", kind) for contact in own for kind in kinds]
    keys += [at_contact(contact if prefix else "", CONTACT_SIGNALS[-1]) for contact in own]
    return dict(zip(keys, _evaluated(_of_contacts, system, signals, own), strict=True))


def balance_slopes(system: System, signals: dict[str, np.ndarray], contacts: Sequence[str]) -> np.ndarray:
    """J along a motion: what a unit of each friction force adds to each equation of motion that holds one.

    Args:
        system, signals: as above.
        contacts: names of the contacts with friction.

    Returns:
        shape (n, equations, contacts).
    """
    columns = _evaluated(_of_balance, system, signals, tuple(contacts))
    return np.stack(columns, axis=1).reshape(len(columns[0]), -1, len(contacts))


def motion_feedback(system: System, signals: dict[str, np.ndarray]) -> np.ndarray:
    """:attr:`..physics.System.feedback` of a system's only contact along a motion, shape (n, 2), 1/s^2 and 1/s.

    Args:
        system, signals: as above.
    """
    return np.stack(_evaluated(_of_feedback, system, signals, ("",)), axis=1)


def capacity_rate(law: FrictionLaw) -> tuple[sp.Expr, tuple[sp.Symbol, sp.Symbol]]:
    """d/dt g(v, N) and the symbols of v' and N'."""
    rates = sp.symbols("v_slip_rate N_rate", real=True)
    g = law.capacity(CONTACT, law.symbols)
    return sp.diff(g, CONTACT.v) * rates[0] + sp.diff(g, CONTACT.N) * rates[1], rates


class LawFunctions:
    """Torch functions of a friction law: ``force(v, N, z, zdot, *p)``; of one with memory ``rate(v, N, z, *p)``,
    ``capacity(v, N, *p)`` and its rate ``capacity_rate(v, N, v_rate, N_rate, *p)``.

    ``p`` are the law's parameters in the order of ``law.parameters``; tensors broadcast.
    """

    def __init__(self, law: FrictionLaw):
        c, p = CONTACT, [par.symbol for par in law.parameters]
        self.names = [par.name for par in law.parameters]
        self.force = torch_function([c.v, c.N, c.z, c.zdot, *p], law.force(c, law.symbols))
        if law.memory:
            self.capacity = torch_function([c.v, c.N, *p], law.capacity(c, law.symbols))
            rate, symbols = capacity_rate(law)
            self.capacity_rate = torch_function([c.v, c.N, *symbols, *p], rate)
            self.rate = torch_function([c.v, c.N, c.z, *p], law.bristle_rate(c, law.symbols))
