"""A force that depends on one variable in any smooth way: what is left when every named effect has had its say."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import sympy as sp

from ..physics.base import CONTACT, FrictionLaw
from ..physics.effect import Effect, hidden, strength
from ..physics.system import System

BUMPS = 8  # of one variable: shapes that vary within an eighth of its range


def variables(system: System) -> dict[str, sp.Expr]:
    """Variables on which a force along the slip may depend, by the word for it: of the contact, then measured ones."""
    found: dict[str, sp.Expr] = {"time": CONTACT.t}
    if system.slip_position is not None:
        found["position"] = CONTACT.s
    found |= {"velocity": CONTACT.v, "acceleration": CONTACT.a}
    if system.N.free_symbols - {par.symbol for par in system.parameters}:
        found["normal_force"] = CONTACT.N
    slipping = {c.name for c in system.moving if system.jacobian[c.name] != 0}
    for c in system.moving:
        if c.name not in slipping:
            found |= dict(zip(c.signals, c.symbols, strict=True))
    if not system.massless:
        found |= {item.name: item.symbol for item in system.inputs if item.symbol in system.acting}
    return found


class Remainder(Effect):
    """F = F_law + sum_k c_k b_k(x), and the law sees N (1 + sum_k d_k b_k(x)), b_k bumps evenly spaced over the range
    of the variable x; each sum is a group of its own.

    Units: c in the system's unit of force, d dimensionless.
    Neutral: all c, d = 0.
    """

    signed = True

    def __init__(self, variable: str, symbol: sp.Expr):
        super().__init__()
        self.variable, self.symbol, self.name = variable, symbol, f"remainder_{variable}"

    @property
    def place(self) -> tuple[str, str]:
        """Names of the hidden parameters: where the range begins, and the distance between bumps."""
        return f"{self.variable}_from", f"{self.variable}_step"

    def make_parameters(self, system: System, law: FrictionLaw):
        made = [strength(f"force_{self.variable}_{k}", "{F}", "", group="force") for k in range(BUMPS)]
        made += [strength(f"friction_{self.variable}_{k}", "1", "", group="friction") for k in range(BUMPS)]
        first, step = self.place
        return (*made, hidden(first, "", "", 0.0, low=-np.inf), hidden(step, "", "", 1.0))

    def groups(self, system: System, law: FrictionLaw) -> dict[str, tuple[str, ...]]:
        return {key: tuple(f"{key}_{self.variable}_{k}" for k in range(BUMPS)) for key in ("force", "friction")}

    def bumps(self, p) -> list[sp.Expr]:
        """b_k(x) = exp(-(x - x_k)^2 / step^2) at the parameters' symbols."""
        first, step = (getattr(p, name) for name in self.place)
        away = (self.symbol - first) / step
        return [sp.exp(-((away - k) ** 2)) for k in range(BUMPS)]

    def force(self, c, p, law):
        return sum(getattr(p, f"force_{self.variable}_{k}") * b for k, b in enumerate(self.bumps(p)))

    def load(self, N, c, p):
        return N * (1 + sum(getattr(p, f"friction_{self.variable}_{k}") * b for k, b in enumerate(self.bumps(p))))


def remainders(system: System) -> tuple[Remainder, ...]:
    """One for every variable."""
    return tuple(Remainder(name, symbol) for name, symbol in variables(system).items())


def places(remainder: Remainder, samples: np.ndarray) -> Mapping[str, float]:
    """Hidden parameters that spread the bumps over the range of the variable's samples."""
    low, high = np.quantile(samples, [0.002, 0.998])
    first, step = remainder.place
    return {first: float(low), step: float(max(high - low, 1e-9) / (BUMPS - 1))}
