"""Options whose keys the user names, a contact, a joint or a column, as typed and as Hydra reads them."""

from __future__ import annotations

import re
from collections.abc import Sequence

from ..errors import nearest
from ..physics import LAWS, FrictionLaw
from ..physics.contacts import ContactLaws
from ..physics.friction import CONTACT_LAWS

KEYS = ("name", "start", "bounds", "fixed", "tie_sigma1", "contacts")  # of conf/friction
_LAW = re.compile(r"friction\.(\w+)=(.*)", re.DOTALL)
_NAMED = re.compile(
    r"(?:robot\.locked|data\.(?:columns|units))\.\w+=.*", re.DOTALL
)  # tables with names of the user's own
_TABLE = re.compile(r"friction\.(?:start|bounds|fixed)=\{.*", re.DOTALL)
_VALUE = re.compile(r"friction\.(?:start|bounds|fixed)\.\w+\.\w+=.*", re.DOTALL)


def contact_options(arguments: Sequence[str]) -> list[str]:
    """The arguments with ``friction.hinge=coulomb`` as ``+friction.contacts.hinge=coulomb``, so that the law of one
    contact reads like that of all; ``friction.fixed.hinge.mu_c=0.1``, ``friction.fixed={hinge: {mu_c: 0.1}}`` and
    ``robot.locked.finger=0.0`` become new keys in the same way."""
    return [_as_key(text) for text in arguments]


def options_of(law: FrictionLaw) -> list[str]:
    """The options that give this law, or one for each of several contacts."""
    if not isinstance(law, ContactLaws):
        return [f"friction={law.name}"]
    kinds = {contact: own.name for contact, own in law.laws.items()}
    known = [kind for kind in kinds.values() if kind in LAWS]
    first = next((kind for kind in known if LAWS[kind].memory), next(iter(known), "lugre"))
    own = [f"+friction.contacts.{contact}={kind}" for contact, kind in kinds.items() if kind != first]
    return [f"friction={first}", *own]


def _as_key(text: str) -> str:
    if _VALUE.fullmatch(text):
        return f"+{text}"
    if _NAMED.fullmatch(text) or _TABLE.fullmatch(text):
        return f"++{text}"
    found = _LAW.fullmatch(text)
    if found is None or found[1] in KEYS:
        return text
    mistyped = nearest(found[1], KEYS) and not {*found[2].split(",")} <= CONTACT_LAWS.keys()
    return text if mistyped else f"+friction.contacts.{found[1]}={found[2]}"
