"""Robots: an arm's recording checked, its joints' friction identified, and what each joint's model lacks named.

from frictionpinn.robots import Arm, Observer, Robot, hand_on, pd, simulate
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ..physics.robot import Robot
    from .arm import Arm
    from .handing_on import hand_on
    from .integration import Motion, pd, simulate
    from .online import Observer
    from .recording import read_robot

__all__ = ["Arm", "Motion", "Observer", "Robot", "hand_on", "pd", "read_robot", "simulate"]

# Name -> module, imported on first use: numba and pinocchio take a second.
_PLACES = {
    "Arm": ".arm",
    "Observer": ".online",
    "Robot": "..physics.robot",
    "hand_on": ".handing_on",
    "read_robot": ".recording",
    **dict.fromkeys(("Motion", "pd", "simulate"), ".integration"),
}


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module 'frictionpinn.robots' has no attribute '{name}'")
    return getattr(import_module(_PLACES[name], __name__), name)
