"""What a mechanism may hold beyond its declared equations: a term that a neutral value switches off."""

from __future__ import annotations

import inspect
import math
from dataclasses import dataclass
from types import SimpleNamespace

import sympy as sp

from .base import Contact, FrictionLaw, Parameter, sign_smooth
from .scan import Scan
from .system import System


@dataclass(frozen=True)
class State:
    """A state that an effect adds to the mechanism: name and unit ({L}: unit of slip); it starts where it rests."""

    name: str
    unit: str

    @property
    def symbol(self) -> sp.Symbol:
        """Its symbol."""
        return sp.Symbol(self.name, real=True)

    @property
    def rate(self) -> sp.Symbol:
        """Symbol of its time derivative."""
        return sp.Symbol(f"{self.name}_dot", real=True)


class Effect:
    """Base class of all effects. Subclasses set ``name`` and ``parameters`` and override the hooks that they need.

    A parameter with a ``neutral`` value is a strength: at neutral strengths every hook gives back what it got, and the
    derivative of the mechanism's equations with respect to a strength is finite there and not zero throughout. A
    ``hidden`` parameter shapes the effect. Hooks receive ``c``, the contact as the friction law sees it, and ``p``, a
    namespace with the symbols of all parameters of the mechanism; they return sympy expressions. Forces count as
    friction does: positive resists slip in the positive direction.

    Attributes:
        signed: uses :func:`direction`, the regularised sign of the slip velocity.
        memory: brings a bristle state to a law without one, see :meth:`bristle_rate`.
        states: further states, see :meth:`state_rates`.
        whole: acts on the mechanism as a whole (masses, inputs, sensors), others at a contact: with several, at the one
            that is named, ``asymmetry@hinge``.
    """

    name: str = ""
    parameters: tuple[Parameter, ...] = ()
    signed: bool = False
    memory: bool = False
    states: tuple[State, ...] = ()
    whole: bool = False

    def applies(self, system: System, law: FrictionLaw, others: tuple[str, ...] = ()) -> bool:
        """Whether it can act on this system with this law, ``others`` being the names of effects beside it."""
        return True

    def make_parameters(self, system: System, law: FrictionLaw) -> tuple[Parameter, ...]:
        """Its parameters on this system and law, where they depend on them; by default the class's."""
        return self.parameters

    def parameters_on(self, system: System, law: FrictionLaw) -> tuple[Parameter, ...]:
        """Its parameters on this system and law, with what its sign needs."""
        made = self.make_parameters(system, law)
        return (*made, V_SIGN) if self.signed and not _has(law, "v_t") else made

    @classmethod
    def said(cls) -> dict[str, str]:
        """Its docstring by section: equation, units, neutral, occurs, experiment."""
        sections, current = {"equation": ""}, "equation"
        for line in (inspect.getdoc(cls) or "").splitlines():
            head, colon, rest = line.partition(":")
            if colon and head in ("Units", "Neutral", "Occurs", "Experiment"):
                current, line = head.lower(), rest
            sections[current] = f"{sections.get(current, '')} {line}".strip()
        return sections

    def groups(self, system: System, law: FrictionLaw) -> dict[str, tuple[str, ...]]:
        """Strengths that are tested together, by the name of their group (the effect's own where it has only one)."""
        result: dict[str, tuple[str, ...]] = {}
        for par in self.parameters_on(system, law):
            if not par.hidden:
                key = par.group or self.name
                result[key] = (*result.get(key, ()), par.name)
        return result

    # hooks ---------------------------------------------------------------------------------------------------
    def replace(self, system: System, law: FrictionLaw, p: SimpleNamespace) -> dict[sp.Symbol, sp.Expr]:
        """Parameters of system and law, driven motions and inputs -> what stands in their place in all equations."""
        return {}

    def load(self, N: sp.Expr, c: Contact, p: SimpleNamespace) -> sp.Expr:
        """The normal force that the friction law sees instead of N."""
        return N

    def force(self, c: Contact, p: SimpleNamespace, law: FrictionLaw) -> sp.Expr:
        """Force added to the friction force; ``c.N`` is the normal force that the law sees."""
        return sp.Integer(0)

    def deflection(self, z: sp.Expr, p: SimpleNamespace) -> sp.Expr:
        """The bristle's deflection that makes a force, out of the whole travel z."""
        return z

    def slip_speed(self, speed: sp.Expr, c: Contact, p: SimpleNamespace) -> sp.Expr:
        """The slip speed at which a bristle wears off, instead of |v|."""
        return speed

    def bristle_rate(self, c: Contact, p: SimpleNamespace, law: FrictionLaw) -> sp.Expr:
        """z' of the bristle that it brings (``memory``)."""
        raise NotImplementedError

    def state_rates(self, c: Contact, p: SimpleNamespace) -> tuple[sp.Expr, ...]:
        """Rates of its ``states``."""
        return ()

    def sensor(self, system: System, signal: str, y: sp.Expr, p: SimpleNamespace) -> sp.Expr:
        """What the sensor of a predicted signal shows where the truth is y."""
        return y

    def delays(self, system: System, law: FrictionLaw) -> dict[str, dict[str, float]]:
        """Signal -> {parameter: sign}: by this sum, in s, a prediction is measured late, or an input acts late."""
        return {}

    def equivalents(self, system: System, law: FrictionLaw) -> dict[tuple[str, str], float]:
        """Pairs of strengths, of this and of any effect, that act the same way by definition: the second's value over
        the first's."""
        return {}


def strength(name: str, unit: str, text: str, low: float = -math.inf, high: float = math.inf, **more) -> Parameter:
    """A parameter that switches its effect off at 0."""
    return Parameter(name, unit, text, 0.0, low, high, neutral=0.0, **more)


def hidden(
    name: str, unit: str, text: str, value: float, scan: Scan | None = None, low: float = 1e-12, group: str = ""
) -> Parameter:
    """A parameter that shapes an effect, or only one group of its strengths."""
    return Parameter(name, unit, text, value, low, hidden=True, scan=scan, group=group)


V_SIGN = hidden("v_sign", "{L}/s", "transition velocity of the regularised sign in the effects", 1e-4)


def direction(c: Contact, p: SimpleNamespace) -> sp.Expr:
    """Sign of the slip velocity, regularised as in the law (v_t), or over v_sign where the law has none."""
    return sign_smooth(c.v, p.v_t if hasattr(p, "v_t") else p.v_sign)


def _has(law: FrictionLaw, name: str) -> bool:
    return any(par.name == name for par in law.parameters)


def load_varies(system: System) -> bool:
    """Whether the normal force depends on the motion."""
    return bool(system.N.free_symbols - {par.symbol for par in system.parameters})


def predicted(system: System) -> dict[str, str]:
    """Measured signals that a simulation predicts, with units: of free coordinates; the force of a massless system."""
    if system.massless:
        return {item.name: item.unit for item in system.inputs}
    return {name: unit for c in system.free for name, unit in zip(c.signals, c.units, strict=True)}


def given(system: System) -> dict[str, tuple[str, sp.Symbol]]:
    """Measured motion of driven coordinates that acts: signal -> unit and symbol."""
    driven = system.moving if system.massless else [c for c in system.moving if c not in system.free]
    triples = [triple for c in driven for triple in zip(c.signals, c.units, c.symbols, strict=True)]
    return {name: (unit, symbol) for name, unit, symbol in triples if symbol in system.acting}


def sensed(system: System) -> dict[str, tuple[str, ...]]:
    """What may be wrong together: every signal that is predicted or given, then all of a coordinate (one encoder)."""
    signals = (*predicted(system), *given(system))
    groups: dict[str, tuple[str, ...]] = {name: (name,) for name in signals}
    for c in system.moving:
        shared = tuple(name for name in c.signals if name in signals)
        if len(shared) > 1:
            groups["_".join(shared)] = shared
    return groups


def applied(system: System) -> dict[str, sp.Symbol]:
    """Measured inputs that act as forces: signal -> symbol."""
    return {item.name: item.symbol for item in system.inputs if item.symbol in system.acting and not system.massless}
