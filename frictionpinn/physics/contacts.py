"""Several contacts of one system: a law for each, effects at one of them, and parameters that carry its name.

A system with one contact has none of this: its laws, effects and parameters keep their plain names.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import sympy as sp

from ..errors import UserError, choose, nearest
from .base import CONTACT, FrictionLaw, at_contact, contact_of, plain_name
from .effect import Effect
from .friction import CONTACT_LAWS, LAWS
from .system import System


def _named(item, contact: str):
    """A parameter or a state that carries the contact's name: ``hinge.mu_c``."""
    return replace(item, name=at_contact(contact, item.name))


def own_names(p: SimpleNamespace, contact: str) -> SimpleNamespace:
    """The parameters as a law or an effect at a contact sees them: ``p.mu_c`` is the symbol of ``hinge.mu_c``."""
    if not contact:
        return p
    own = {plain_name(name): symbol for name, symbol in vars(p).items() if contact_of(name) == contact}
    return SimpleNamespace(**(vars(p) | own))


class ContactLaws(FrictionLaw):
    """A friction law for every contact of a system; its parameters carry the contact's name, ``hinge.mu_c``.

    Args:
        laws: contact -> law, in the order of the system's contacts.
    """

    def __init__(self, laws: Mapping[str, FrictionLaw]):
        self.laws = dict(laws)
        kinds = [law.name for law in self.laws.values()]
        several = [f"{kind}@{contact}" for contact, kind in zip(self.laws, kinds, strict=True)]
        self.name = kinds[0] if len(set(kinds)) == 1 else "+".join(several)
        self.parameters = tuple(_named(par, contact) for contact, law in self.laws.items() for par in law.parameters)
        self.memory = any(law.memory for law in self.laws.values())

    def at(self, contact):
        return self.laws[contact]

    def called(self, name: str) -> list[str]:
        """The parameters of all contacts that have this plain name."""
        return [par.name for par in self.parameters if plain_name(par.name) == name]

    def constraints(self, p):
        return tuple(e for contact, law in self.laws.items() for e in law.constraints(own_names(p, contact)))


def law_named(
    given: FrictionLaw | str | Mapping[str, FrictionLaw | str], where: str
) -> FrictionLaw | dict[str, FrictionLaw]:
    """A friction law by name, or one for each contact, ``none`` included; a law that is made already is kept.

    Raises:
        UserError: an unknown law, or what is none; ``where`` it was given.
    """
    if isinstance(given, Mapping):
        return {name: _law(item, CONTACT_LAWS, f"{where}.{name}") for name, item in given.items()}
    return _law(given, LAWS, where)


def _law(given: object, known: Mapping[str, Any], where: str) -> FrictionLaw:
    law = choose(given, known, where)() if isinstance(given, str) else given
    if not isinstance(law, FrictionLaw):
        allowed = f"{', '.join(known)}, or an object"
        raise UserError("not a FrictionLaw", where=where, received=repr(law), allowed=allowed)
    return law


def laws_of(system: System, law: FrictionLaw | Mapping[str, FrictionLaw]) -> FrictionLaw:
    """The law of a system's only contact, or a :class:`ContactLaws`: one law for all contacts, or one for each by name.

    Raises:
        UserError: a contact that the system has not, or one without a law.
    """
    names = [contact.name for contact in system.contacts]
    if isinstance(law, FrictionLaw):
        return law if len(names) == 1 or isinstance(law, ContactLaws) else ContactLaws(dict.fromkeys(names, law))
    for name in law:
        if name not in names or len(names) == 1:
            allowed = ", ".join(names) if len(names) > 1 else "none: it has one contact, without a name"
            fix = nearest(name, names) or "use one of these" if len(names) > 1 else "give the law alone, friction=lugre"
            raise UserError(f"unknown contact of system {system.name}", where=f"friction.{name}",
                            received=law[name].name, allowed=allowed, fix=fix)  # fmt: skip
    for name in names:
        if name not in law:
            fix = f"say friction.{name}=none if it has none"
            raise UserError(
                "contact without a friction law", where=f"friction.{name}", allowed=", ".join(CONTACT_LAWS), fix=fix
            )
    return ContactLaws({name: law[name] for name in names})


def by_parameter(table: Mapping[str, Any], law: FrictionLaw) -> dict[str, Any]:
    """A table of a law's parameters by their full names.

    With several contacts ``{"hinge": {"mu_c": 0.1}}`` and ``{"hinge.mu_c": 0.1}`` name that of one contact, and
    ``{"alpha": 2.0}`` those of all contacts that have it and are not named.
    """
    if not isinstance(law, ContactLaws):
        return dict(table)
    result: dict[str, Any] = {}
    for name, value in table.items():
        if name not in law.laws:
            result |= dict.fromkeys(law.called(name) or [name], value)
    for contact in law.laws:
        result |= {at_contact(contact, name): value for name, value in (table.get(contact) or {}).items()}
    return result | {name: value for name, value in table.items() if "." in name}


class LocatedEffect(Effect):
    """An effect at one of several contacts, ``asymmetry@hinge``; its parameters are ``hinge.asymmetry``.

    Args:
        effect: as it is written for a system with one contact.
        contact: name of the contact; empty where the system has no other.
    """

    def __init__(self, effect: Effect, contact: str):
        self.effect, self.contact = effect, contact
        self.name = self._here(effect.name)
        self.signed, self.memory = effect.signed, effect.memory
        self.parameters = tuple(_named(par, contact) for par in effect.parameters)
        self.states = tuple(_named(state, contact) for state in effect.states)

    def _here(self, name: str) -> str:
        return f"{name}@{self.contact}" if self.contact else name

    def said(self):  # type: ignore[override]
        return self.effect.said()

    def applies(self, system, law, others=()):
        here = tuple(name.partition("@")[0] for name in others if name.endswith(f"@{self.contact}"))
        applies = self.effect.applies(system.at(self.contact), law.at(self.contact), here)
        return applies and bool(self.groups(system, law))

    def make_parameters(self, system, law):
        return self.parameters_on(system, law)

    def parameters_on(self, system, law):
        own = self.effect.parameters_on(system.at(self.contact), law.at(self.contact))
        return tuple(_named(par, self.contact) for par in own)

    def groups(self, system, law):
        """Those that act: what changes the load does nothing where the law takes none."""
        at, law = system.at(self.contact), law.at(self.contact)
        acting = {symbol.name for symbol in self._terms(at, law).free_symbols}
        own = {key: names for key, names in self.effect.groups(at, law).items() if acting & {*names}}
        return {self._here(key) if key == self.effect.name else key: tuple(at_contact(self.contact, n) for n in names)
                for key, names in own.items()}  # fmt: skip

    def _terms(self, at: System, law: FrictionLaw) -> sp.Tuple:
        """Everything that law and effect say of this contact, in the effect's own names."""
        effect, own = self.effect, (*law.parameters, *self.effect.parameters_on(at, law))
        p = SimpleNamespace(**{par.name: par.symbol for par in own})
        c = replace(CONTACT, N=effect.load(CONTACT.N, CONTACT, p), z=effect.deflection(CONTACT.z, p))
        terms = [law.force(c, p), effect.force(c, p, law), *effect.state_rates(c, p)]
        terms += [law.bristle_rate(c, p)] if law.memory else [effect.bristle_rate(c, p, law)] if effect.memory else []
        return sp.Tuple(*terms).xreplace(effect.replace(at, law, p))

    def replace(self, system, law, p):
        return self.effect.replace(system.at(self.contact), law.at(self.contact), own_names(p, self.contact))

    def load(self, N, c, p):
        return self.effect.load(N, c, own_names(p, self.contact))

    def force(self, c, p, law):
        return self.effect.force(c, own_names(p, self.contact), law.at(self.contact))

    def deflection(self, z, p):
        return self.effect.deflection(z, own_names(p, self.contact))

    def bristle_rate(self, c, p, law):
        return self.effect.bristle_rate(c, own_names(p, self.contact), law.at(self.contact))

    def state_rates(self, c, p):
        return self.effect.state_rates(c, own_names(p, self.contact))

    def own_symbols(self) -> dict[sp.Symbol, sp.Symbol]:
        """Symbols of its states as it writes them -> as they are called here."""
        pairs = list(zip(self.effect.states, self.states, strict=True))
        return {old.symbol: new.symbol for old, new in pairs} | {old.rate: new.rate for old, new in pairs}


def bristle_symbols(contact: str) -> tuple[sp.Symbol, sp.Symbol]:
    """Symbols of the bristle state of a contact and of its rate: z and z', ``hinge.z`` and ``hinge.zdot``."""
    z, zdot = sp.symbols((at_contact(contact, "z"), at_contact(contact, "zdot")), real=True)
    return z, zdot
