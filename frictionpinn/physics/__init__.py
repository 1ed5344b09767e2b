"""Physics as equations: friction laws and systems, written once in sympy; everything else is derived from them."""

from .base import CONTACT, Contact, FrictionLaw, Parameter
from .effect import Effect
from .effects import EFFECTS
from .friction import LAWS
from .system import Coordinate, FrictionalContact, Input, System
from .systems import SYSTEMS

__all__ = [
    "CONTACT",
    "EFFECTS",
    "LAWS",
    "SYSTEMS",
    "Contact",
    "Coordinate",
    "Effect",
    "FrictionLaw",
    "FrictionalContact",
    "Input",
    "Parameter",
    "System",
]
