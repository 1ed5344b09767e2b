"""Forces that depend on one variable in any smooth way: what no effect with a name explains."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import sympy as sp

from .base import CONTACT, FrictionLaw, at_contact
from .contacts import LocatedEffect
from .effect import Effect, applied, hidden, load_varies, strength
from .system import System

BUMPS = 8  # shapes that vary within an eighth of the range of the variable


class Bumps(Effect):
    """F = F_law + sum_k c_k b_k(x), and the law sees N (1 + sum_k d_k b_k(x)): what no named effect explains.

    b_k(x) = exp(-(x - x_k)^2 / h^2) are bumps at distances h over the range of the variable x. The c are one group of
    strengths ("force"), the d another ("friction").

    Units: c in the system's unit of force, d dimensionless.
    Neutral: all c, d = 0.
    """

    def __init__(self, variable: str, symbol: sp.Expr):
        self.variable, self.symbol, self.name = variable, symbol, f"remainder_{variable}"
        self.place = f"{variable}_from", f"{variable}_step"  # hidden parameters: x_0 and h

    def make_parameters(self, system: System, law: FrictionLaw):
        made = [strength(f"force_{self.variable}_{k}", "{F}", "", group="force") for k in range(BUMPS)]
        made += [strength(f"friction_{self.variable}_{k}", "1", "", group="friction") for k in range(BUMPS)]
        first, step = self.place
        return (*made, hidden(first, "", "", 0.0, low=-np.inf), hidden(step, "", "", 1.0))

    def _sum(self, group: str, p) -> sp.Expr:
        first, step = (getattr(p, name) for name in self.place)
        away = (self.symbol - first) / step
        return sum(getattr(p, f"{group}_{self.variable}_{k}") * sp.exp(-((away - k) ** 2)) for k in range(BUMPS))

    def force(self, c, p, law):
        return self._sum("force", p)

    def load(self, N, c, p):
        return N * (1 + self._sum("friction", p))


class Remainder(LocatedEffect):
    """What no named effect explains at a contact, as a sum of :class:`Bumps` over one variable.

    Attributes:
        variable: that it depends on; with several contacts at which, ``velocity@hinge``.
        symbol: of it.
        place: names of the hidden parameters that place the bumps.
    """

    def __init__(self, variable: str, symbol: sp.Expr, contact: str = ""):
        plain = Bumps(variable, symbol)
        super().__init__(plain, contact)
        self.variable, self.symbol = self._here(variable), symbol
        self.place = tuple(at_contact(contact, name) for name in plain.place)

    def bumps(self, x: np.ndarray, places: Mapping[str, float]) -> np.ndarray:
        """b_k at samples x of the variable, shape (n,) -> (n, BUMPS)."""
        first, step = (places[name] for name in self.place)
        return np.exp(-((((x - first) / step)[:, None] - np.arange(BUMPS)) ** 2))


def remainders(system: System) -> tuple[Remainder, ...]:
    """One for each variable on which a force along the slip of a contact may depend: its own, then measured ones."""
    return tuple(Remainder(*item, c.name) for c in system.contacts for item in _variables(system.at(c.name)).items())


def _variables(system: System) -> dict[str, sp.Expr]:
    """What a force at a contact may depend on, by name."""
    found: dict[str, sp.Expr] = {"time": CONTACT.t}
    if system.slip_position is not None:
        found["position"] = CONTACT.s
    found |= {"velocity": CONTACT.v, "acceleration": CONTACT.a}
    if load_varies(system):
        found["normal_force"] = CONTACT.N
    for c in system.moving:
        if system.jacobian[c.name] == 0:  # a motion across the slip
            found |= dict(zip(c.signals, c.symbols, strict=True))
    return found | applied(system)


def places(remainder: Remainder, samples: np.ndarray) -> dict[str, float]:
    """Hidden parameters that spread the bumps over the range of the variable's samples, shape (n,)."""
    low, high = np.quantile(samples, [0.002, 0.998])  # single samples far out would stretch it
    first, step = remainder.place
    return {first: float(low), step: float(max(high - low, 1e-9) / (BUMPS - 1))}
