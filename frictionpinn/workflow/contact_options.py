"""Options of a friction law for one of several contacts, as the command line has them and as Hydra reads them."""

from __future__ import annotations

import re
from collections.abc import Sequence

from ..errors import nearest
from ..physics.friction import CONTACT_LAWS

KEYS = ("name", "start", "bounds", "fixed", "tie_sigma1", "contacts")  # of conf/friction
_LAW = re.compile(r"friction\.(\w+)=(.*)", re.DOTALL)
_VALUE = re.compile(r"friction\.(?:start|bounds|fixed)\.\w+\.\w+=.*", re.DOTALL)


def contact_options(arguments: Sequence[str]) -> list[str]:
    """The arguments with ``friction.hinge=coulomb`` as ``+friction.contacts.hinge=coulomb``, so that the law of one
    contact reads like that of all; ``friction.fixed.hinge.mu_c=0.1`` becomes a new key in the same way."""
    return [_as_key(text) for text in arguments]


def _as_key(text: str) -> str:
    if _VALUE.fullmatch(text):
        return f"+{text}"
    found = _LAW.fullmatch(text)
    if found is None or found[1] in KEYS:
        return text
    mistyped = nearest(found[1], KEYS) and not {*found[2].split(",")} <= CONTACT_LAWS.keys()
    return text if mistyped else f"+friction.contacts.{found[1]}={found[2]}"
