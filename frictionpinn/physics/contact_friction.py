"""Friction at one contact of a mechanism: its law and the effects there, in terms of the motion."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from types import SimpleNamespace
from typing import TYPE_CHECKING

import sympy as sp

from .base import CONTACT, Contact, FrictionLaw
from .contacts import LocatedEffect, bristle_symbols, own_names
from .effect import Effect, State
from .system import System

if TYPE_CHECKING:
    from .mechanism import Mechanism


@dataclass(frozen=True)
class ContactFriction:
    """What acts at a contact of a mechanism.

    Attributes:
        mechanism: that it belongs to.
        name: of the contact; empty where the system has no other.
    """

    mechanism: Mechanism
    name: str

    @cached_property
    def system(self) -> System:
        """The system as this contact sees it."""
        return self.mechanism.system.at(self.name)

    @property
    def law(self) -> FrictionLaw:
        """The friction law here."""
        return self.mechanism.law.at(self.name)

    @property
    def effects(self) -> tuple[Effect, ...]:
        """Effects here, and those on the mechanism as a whole."""
        return tuple(e for e in self.mechanism.effects if not self.name or e.whole or self._is_here(e))

    def _is_here(self, effect: Effect) -> bool:
        return isinstance(effect, LocatedEffect) and effect.contact == self.name

    @property
    def memory(self) -> bool:
        """Whether there is a bristle state, of the law or of an effect."""
        return self.law.memory or any(effect.memory for effect in self.effects)

    @property
    def states(self) -> tuple[State, ...]:
        """Further states, of effects."""
        return tuple(state for effect in self.effects for state in effect.states)

    @property
    def z(self) -> sp.Symbol:
        """Symbol of the bristle state."""
        return bristle_symbols(self.name)[0]

    @property
    def zdot(self) -> sp.Symbol:
        """Symbol of its rate."""
        return bristle_symbols(self.name)[1]

    @cached_property
    def p(self) -> SimpleNamespace:
        """Symbols of the parameters, those of this contact by their plain names."""
        return own_names(self.mechanism.p, self.name)

    # the equations -------------------------------------------------------------------------------------------
    def _replaced(self, expr: sp.Expr) -> sp.Expr:
        return self.mechanism._replaced(expr, self.effects)

    def in_motion(self, expr: sp.Expr) -> sp.Expr:
        """An expression of the contact (``CONTACT``) in terms of the motion and the contact's own states."""
        seen = self._replaced(expr).xreplace(self.motion) if self.effects else sp.sympify(expr).subs(self.motion)
        return seen.xreplace(self._own_symbols) if self.name else seen

    @cached_property
    def _own_symbols(self) -> dict[sp.Symbol, sp.Symbol]:
        located = [effect.own_symbols() for effect in self.effects if isinstance(effect, LocatedEffect)]
        states = {old: new for pairs in located for old, new in pairs.items()}
        return {CONTACT.z: self.z, CONTACT.zdot: self.zdot} | states

    @cached_property
    def motion(self) -> dict[sp.Symbol, sp.Expr]:
        """Slip velocity and normal force in terms of the motion; with effects, slip position and acceleration too."""
        system = self.system
        if not self.effects:
            return {CONTACT.v: system.v_slip, CONTACT.N: system.N}
        seen = {CONTACT.v: system.v_slip, CONTACT.N: system.N, CONTACT.a: system.a_slip}
        if system.slip_position is not None:
            seen[CONTACT.s] = system.slip_position
        return {symbol: self._replaced(expr) for symbol, expr in seen.items()}

    @cached_property
    def seen(self) -> Contact:
        """The contact as the law sees it: with the load and the bristle's deflection that effects leave."""
        N, z = CONTACT.N, CONTACT.z
        for effect in self.effects:
            N, z = effect.load(N, CONTACT, self.mechanism.p), effect.deflection(z, self.mechanism.p)
        zdot = CONTACT.zdot if z == CONTACT.z else sp.diff(z, CONTACT.z) * CONTACT.zdot
        return replace(CONTACT, N=N, z=z, zdot=zdot)

    @cached_property
    def friction(self) -> sp.Expr:
        """Friction force of law and effects in terms of the motion, z and z'."""
        m = self.mechanism
        force = sp.sympify(self.law.force(self.seen, self.p))
        return self.in_motion(sum((e.force(self.seen, m.p, m.law) for e in self.effects), start=force))

    @cached_property
    def bristle_rate(self) -> sp.Expr:
        """z' in terms of the motion and z; 0 where there is no bristle."""
        if self.law.memory:
            return self.in_motion(self._worn(self.law.bristle_rate(self.seen, self.p)))
        for effect in self.effects:
            if effect.memory:
                return self.in_motion(self._worn(effect.bristle_rate(self.seen, self.mechanism.p, self.mechanism.law)))
        return sp.Integer(0)

    def _worn(self, rate: sp.Expr) -> sp.Expr:
        """A bristle's rate with the slip speed that effects leave in the place of |v|."""
        speed = sp.Abs(CONTACT.v)
        for effect in self.effects:
            speed = effect.slip_speed(speed, CONTACT, self.mechanism.p)
        return rate.xreplace({sp.Abs(CONTACT.v): speed})

    @property
    def state_rows(self) -> list[sp.Expr]:
        """The rows of R of the effects' states."""
        rates = [rate for effect in self.effects for rate in effect.state_rates(self.seen, self.mechanism.p)]
        return [state.rate - self.in_motion(rate) for state, rate in zip(self.states, rates, strict=True)]
