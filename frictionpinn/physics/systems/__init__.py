"""The systems. A new system is one file, one YAML in conf/system and one line here."""

from ..system import System
from .cartpole import CartPole
from .damper import Damper
from .double_pendulum import DoublePendulum
from .drive import Drive
from .joint import Joint
from .pendulum import Pendulum
from .pob import PendulumOnBox
from .pob_hinge import PendulumOnBoxWithHinge
from .sdob import SpringDamperOnBox
from .two_mass import TwoMassDrive

SYSTEMS: dict[str, type[System]] = {}
SYSTEMS |= {kind.name: kind for kind in (PendulumOnBox, SpringDamperOnBox, Drive, Pendulum, Joint, Damper)}
SYSTEMS |= {kind.name: kind for kind in (PendulumOnBoxWithHinge, CartPole, DoublePendulum, TwoMassDrive)}

__all__ = [
    "SYSTEMS",
    "CartPole",
    "Damper",
    "DoublePendulum",
    "Drive",
    "Joint",
    "Pendulum",
    "PendulumOnBox",
    "PendulumOnBoxWithHinge",
    "SpringDamperOnBox",
    "TwoMassDrive",
]
