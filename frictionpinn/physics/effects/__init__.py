"""The effects. A new effect is one file and one line here.

Their order is that in which they act: what changes the load before what scales it, the mechanism before its sensors.
"""

from __future__ import annotations

from collections.abc import Iterable

from ...errors import UserError, choose
from ..base import FrictionLaw
from ..effect import Effect
from ..system import System
from .adhesion import Adhesion
from .asymmetric_viscous import AsymmetricViscous
from .asymmetry import Asymmetry
from .backlash import Backlash
from .com_offset import CentreOfMassOffset
from .constant_force import ConstantForce
from .delay import Delay
from .drag import Drag
from .drift import Drift
from .dwell import Dwell
from .gain_error import GainError
from .inertia import Inertia
from .load_exponent import LoadExponent
from .low_speed import LowSpeed
from .payload import Payload
from .position_friction import PositionFriction
from .presliding import Presliding
from .ripple import Ripple
from .sensor_bias import SensorBias
from .sensor_delay import SensorDelay
from .sensor_scale import SensorScale
from .spring_force import SpringForce
from .stribeck import StribeckEffect
from .stribeck_shape import StribeckShape
from .trial_level import TrialLevel
from .vibration import Vibration
from .viscous import Viscous

EFFECTS: dict[str, type[Effect]] = {
    kind.name: kind
    for kind in (
        Adhesion,
        LoadExponent,
        Asymmetry,
        StribeckEffect,
        StribeckShape,
        LowSpeed,
        PositionFriction,
        Ripple,
        Drift,
        TrialLevel,
        Dwell,
        Presliding,
        Backlash,
        ConstantForce,
        SpringForce,
        Drag,
        Viscous,
        AsymmetricViscous,
        Inertia,
        Vibration,
        Payload,
        CentreOfMassOffset,
        GainError,
        Delay,
        SensorScale,
        SensorBias,
        SensorDelay,
    )
}

__all__ = ["EFFECTS", "Effect", "applicable", "chosen"]


def applicable(system: System, law: FrictionLaw, others: Iterable[str] = ()) -> tuple[Effect, ...]:
    """Every effect that can act on this system with this law, beside the effects named ``others``."""
    effects = (kind() for kind in EFFECTS.values())
    return tuple(e for e in effects if e.applies(system, law, tuple(others)))


def chosen(effects: Iterable[str | Effect], system: System, law: FrictionLaw) -> tuple[Effect, ...]:
    """Effects, by name or made already, in the order in which they act.

    Raises:
        UserError: an unknown or repeated effect, or one that cannot act on this system with this law.
    """
    made = [e if isinstance(e, Effect) else choose(e, EFFECTS, "effects")() for e in effects]
    names = tuple(e.name for e in made)
    for effect in made:
        if names.count(effect.name) > 1:
            raise UserError("effect given twice", where="effects", received=effect.name, fix="name it once")
        if not effect.applies(system, law, names):
            raise UserError(
                f"effect cannot act on system {system.name} with friction {law.name}",
                where="effects",
                received=effect.name,
                allowed=", ".join(e.name for e in applicable(system, law, names)),
                fix="leave it out",
            )
    place = {name: i for i, name in enumerate(EFFECTS)}
    return tuple(sorted(made, key=lambda e: place.get(e.name, len(place))))
