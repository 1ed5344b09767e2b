"""Torch and numpy functions generated from the symbolic physics."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache

import numpy as np
import sympy as sp
import torch

from ..physics import CONTACT, FrictionLaw, System

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


@lru_cache(maxsize=32)
def _contact_function(
    kind: Callable[..., System], equations: str, driven: tuple[str, ...]
) -> tuple[Callable, tuple[str, ...]]:
    system = kind(equations=equations, driven=driven)
    symbols = [symbol for c in system.moving for symbol in c.symbols] + [item.symbol for item in system.inputs]
    names = [name for c in system.moving for name in c.signals] + [item.name for item in system.inputs]
    expressions = [system.v_slip, system.N, system.a_slip, system.a_frictionless, system.friction_implied]
    arguments = [*symbols, *(par.symbol for par in system.parameters)]
    return numpy_function(arguments, expressions), tuple(names)


def contact_signals(system: System, signals: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Slip velocity, normal force, slip acceleration, frictionless acceleration, implied friction force.

    Args:
        system: gives the equations and the values of its parameters.
        signals: measured signals by name, each of shape (n,); an absent input counts as zero.

    Returns:
        name (see ``CONTACT_SIGNALS``) -> array of shape (n,), SI units.
    """
    function, names = _contact_function(type(system), system.equations, system.driven)  # type: ignore[arg-type]
    n = len(next(iter(signals.values())))
    columns = [np.asarray(signals[name], float) if name in signals else np.zeros(n) for name in names]
    values = function(*columns, *(system.values[par.name] for par in system.parameters))
    full = [np.broadcast_to(np.asarray(value, float), (n,)) for value in values]
    return dict(zip(CONTACT_SIGNALS, full, strict=True))


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
