"""Building blocks of the symbolic physics: parameters, contacts, friction laws, coordinates."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace

import sympy as sp

from ..errors import UserError
from .scan import Scan

TIME = sp.Symbol("t", real=True)
SESSION, TRIAL = sp.symbols("t_session trial", real=True)
_S_SLIP, _A_SLIP = sp.symbols("s_slip a_slip", real=True)


def at_contact(contact: str, name: str) -> str:
    """The name that a parameter, state or signal has at a contact, ``hinge.mu_c``; plain where there is only one."""
    return f"{contact}.{name}" if contact else name


def contact_of(name: str) -> str:
    """The contact in a name: ``hinge`` in ``hinge.mu_c``, nothing in ``mu_c``."""
    return name.rpartition(".")[0]


def place_of(contact: str, contacts: Sequence[str]) -> int:
    """Index of a contact among those of a system; :class:`UserError` where there is none of that name."""
    if contact not in contacts:
        raise UserError("unknown contact", where="contact", received=contact, allowed=", ".join(contacts))
    return contacts.index(contact)


def plain_name(name: str) -> str:
    """The name without its contact: ``mu_c`` in ``hinge.mu_c``."""
    return name.rpartition(".")[2]


def beside(name: str, other: str) -> str:
    """The name that another has at the same contact: ``hinge.v_s`` beside ``hinge.mu_s``."""
    return at_contact(contact_of(name), other)


@dataclass(frozen=True)
class Parameter:
    """A physical constant with its unit and its physical limits.

    Attributes:
        name: symbol and configuration key.
        unit: SI unit; in friction laws ``{F}`` and ``{L}`` stand for the system's units of force and of slip.
        value: value used where a configuration gives none (systems); laws carry None: data or configuration tell.
        low, high: physical limits (not a search range).
        neutral: the value that switches an effect off, for effects only.
        text: what it is, in the field's words.
        hidden: a place, length, time or speed inside an effect, which says nothing while the effect is neutral: it is
            scanned over ``scan``, and held where there is none.
        scan: values to try, relative to the data.
        group: parameters of an effect in the same group are tested together (the sine and cosine of one ripple); a
            hidden parameter in a group shapes that alone.
        absent: whether it may be 0, like the strength of an effect.
    """

    name: str
    unit: str
    text: str
    value: float | None = None
    low: float = 0.0
    high: float = math.inf
    neutral: float | None = None
    hidden: bool = False
    scan: Scan | None = None
    group: str = ""
    absent: bool = False

    @property
    def linear(self) -> bool:
        """Whether it may be 0 or negative: it is searched as it is, others by their logarithm."""
        return self.absent or self.low < 0 or self.low == self.neutral

    @property
    def symbol(self) -> sp.Symbol:
        """The real symbol that stands for it in every equation."""
        return sp.Symbol(self.name, real=True)


@dataclass(frozen=True)
class Contact:
    """What a friction law sees: slip velocity, normal force magnitude, bristle state and its rate.

    Effects also see the slip position ``s``, the slip acceleration ``a``, the time ``t`` of the trial, as recorded, the
    time ``session`` that runs on from trial to trial, 0 where the first begins, and the number ``trial``, from 1.
    """

    v: sp.Expr
    N: sp.Expr
    z: sp.Expr
    zdot: sp.Expr
    s: sp.Expr = _S_SLIP
    a: sp.Expr = _A_SLIP
    t: sp.Expr = TIME
    session: sp.Expr = SESSION
    trial: sp.Expr = TRIAL


CONTACT = Contact(*sp.symbols("v_slip N z zdot", real=True))


class FrictionLaw:
    """A friction law: force from slip velocity, normal force and, where it has memory, the bristle state.

    Subclasses set ``name``, ``parameters`` and override :meth:`force` and :meth:`capacity`; laws with memory override
    :meth:`bristle_rate` too. Every method returns a sympy expression in the symbols of
    ``c`` (:class:`Contact`) and ``p`` (a namespace of parameter symbols). The force opposes positive slip
    velocity: the equation of motion receives ``-force``.
    """

    name: str = ""
    parameters: tuple[Parameter, ...] = ()
    memory: bool = False

    def force(self, c: Contact, p: SimpleNamespace) -> sp.Expr:
        """Friction force, in the system's unit of force, as a function of v, N, z and z'."""
        raise NotImplementedError

    def capacity(self, c: Contact, p: SimpleNamespace) -> sp.Expr:
        """g(v, N): the magnitude of the dry friction (of the bristle force) in steady sliding."""
        raise NotImplementedError

    def bristle_rate(self, c: Contact, p: SimpleNamespace) -> sp.Expr:
        """z', in the system's unit of slip per second, as a function of v, N and z."""
        raise NotImplementedError

    def constraints(self, p: SimpleNamespace) -> tuple[sp.Expr, ...]:
        """Expressions of the parameters that must not be negative (mu_s - mu_c)."""
        return ()

    @property
    def order(self) -> list[tuple[str, str]]:
        """Names (upper, lower) of the pairs of parameters that :meth:`constraints` keep in order."""
        shares = [{s.name: expr.coeff(s) for s in expr.free_symbols} for expr in self.constraints(self.symbols)]
        pairs = [sorted(share, key=share.__getitem__) for share in shares if sorted(share.values()) == [-1, 1]]
        return [(upper, lower) for lower, upper in pairs]

    def check_order(self, values: Mapping[str, float], where: str) -> None:
        """Raise :class:`UserError` where values, SI units, are not in :attr:`order`."""
        for upper, lower in self.order:
            if float(values[upper]) < float(values[lower]):
                raise UserError(
                    "static below Coulomb friction",
                    where=f"{where}.{upper}",
                    received=values[upper],
                    allowed=f"at least {lower} = {values[lower]:g}",
                    fix=f"raise {upper} or lower {lower}",
                )

    def at(self, contact: str) -> FrictionLaw:
        """The law at a contact: this one, unless it holds one for each (see :mod:`.contacts`)."""
        return self

    @property
    def symbols(self) -> SimpleNamespace:
        """Namespace of the parameter symbols, ``p.mu_c``."""
        return SimpleNamespace(**{par.name: par.symbol for par in self.parameters})


def sign_smooth(v: sp.Expr, v_t: sp.Expr) -> sp.Expr:
    """Sign of the slip velocity, regularised over the transition velocity ``v_t``: tanh(x + x^3 / 3), x = v / v_t.

    The cubic takes the bend out of tanh(x) = x - x^3 / 3 + ...: as steep at rest, it is within 1e-3 of 1 from 1.8 v_t
    on (tanh from 3.8 v_t), so breakaway comes nearer to mu_s, and a loaded contact creeps less.
    """
    x = v / v_t
    return sp.tanh(x + x**3 / 3)


def stribeck_curve(c: Contact, p: SimpleNamespace) -> sp.Expr:
    """Stribeck curve N (mu_c + (mu_s - mu_c) exp(-|v/v_s|^alpha)).

    The tiny constant keeps the derivative in alpha finite at v = 0 (0^alpha log 0); it moves the exponent by 1e-12.
    """
    ratio = (c.v / p.v_s) ** 2 + sp.Float(1e-12)
    return c.N * (p.mu_c + (p.mu_s - p.mu_c) * sp.exp(-(ratio ** (p.alpha / 2))))


MU_C = Parameter("mu_c", "1", "Coulomb friction coefficient")
MU_S = Parameter("mu_s", "1", "static friction coefficient (breakaway)")
V_S = Parameter("v_s", "{L}/s", "Stribeck velocity", low=1e-6)
ALPHA = Parameter("alpha", "1", "Stribeck shape exponent", value=2.0, low=0.1, high=4.0)
# Contacts hold at rest and the model creeps: at 1e-4 m/s that shows in a clean recording, and at a Stribeck velocity of
# 1 mm/s breakaway falls short of mu_s by some per cent; at 1e-5 by 0.03 %.
V_T = Parameter("v_t", "{L}/s", "transition velocity of the regularised sign", value=1e-5, low=1e-9)
SIGMA_0 = Parameter("sigma_0", "{F}/{L}", "bristle stiffness", low=1e-9)
SIGMA_1 = Parameter("sigma_1", "{F}*s/{L}", "bristle damping")
SIGMA_2 = Parameter("sigma_2", "{F}*s/{L}", "viscous friction", absent=True)
