"""The friction laws. A new law is one file, one YAML in conf/friction and one line here."""

from .coulomb import Coulomb
from .coulomb_viscous import CoulombViscous
from .dahl import Dahl
from .lugre import LuGre
from .lugre_tied import TiedLuGre
from .none import NoFriction
from .stribeck import Stribeck

LAWS = {law.name: law for law in (Coulomb, CoulombViscous, Stribeck, Dahl, LuGre, TiedLuGre)}
CONTACT_LAWS = LAWS | {NoFriction.name: NoFriction}  # what a contact among several may have


__all__ = ["CONTACT_LAWS", "LAWS", "Coulomb", "CoulombViscous", "Dahl", "LuGre", "NoFriction", "Stribeck", "TiedLuGre"]
