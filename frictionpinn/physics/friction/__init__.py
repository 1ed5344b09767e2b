"""The friction laws. A new law is one file, one YAML in conf/friction and one line here."""

from collections import ChainMap

from ..base import FrictionLaw
from .coulomb import Coulomb
from .coulomb_viscous import CoulombViscous
from .dahl import Dahl
from .lugre import LuGre
from .lugre_tied import TiedLuGre
from .none import NoFriction
from .stribeck import Stribeck

LAWS: dict[str, type[FrictionLaw]] = {
    law.name: law for law in (Coulomb, CoulombViscous, Stribeck, Dahl, LuGre, TiedLuGre)
}
# What a contact among several may have: these, and those that extensions add to them.
CONTACT_LAWS = ChainMap[str, type[FrictionLaw]]({NoFriction.name: NoFriction}, LAWS)


__all__ = ["CONTACT_LAWS", "LAWS", "Coulomb", "CoulombViscous", "Dahl", "LuGre", "NoFriction", "Stribeck", "TiedLuGre"]
