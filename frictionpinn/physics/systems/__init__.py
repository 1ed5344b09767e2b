"""The systems. A new system is one file, one YAML in conf/system and one line here."""

from .damper import Damper
from .drive import Drive
from .joint import Joint
from .pendulum import Pendulum
from .pob import PendulumOnBox
from .sdob import SpringDamperOnBox

SYSTEMS = {system.name: system for system in (PendulumOnBox, SpringDamperOnBox, Drive, Pendulum, Joint, Damper)}

__all__ = ["SYSTEMS", "Damper", "Drive", "Joint", "Pendulum", "PendulumOnBox", "SpringDamperOnBox"]
