"""The effects. A new effect is one file and one line here.

Their order is that in which they act: what changes the load before what scales it, the mechanism before its sensors.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable

from ...errors import UserError, choose, nearest
from ..base import FrictionLaw
from ..contacts import LocatedEffect
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
from .friction import UndeclaredFriction
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
        UndeclaredFriction,
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
    """Every effect that can act on this system with this law, beside the effects named ``others``.

    With several contacts, those that act at one are there for each of them: ``asymmetry@hinge``.
    """
    effects = [effect for kind in EFFECTS.values() for effect in _everywhere(kind(), system)]
    return tuple(e for e in effects if e.applies(system, law, tuple(others)))


def effects_for(system: System, law: FrictionLaw, names: Collection[str] | None = None) -> tuple[Effect, ...]:
    """Every effect that can act on a system with a law, or the named ones among them, as objects.

    Of several contacts a name is of the effect at one, ``asymmetry@hinge``, or at each, ``asymmetry``.

    Raises:
        UserError: a name of no effect, at no contact of the system, or of an effect that cannot act there.
    """
    for name in names or ():
        _made(name, system)
    every = applicable(system, law, tuple(effect.name for effect in applicable(system, law)))
    wanted = {e.name for e in every} if names is None else set(names)
    for name in sorted(wanted.difference(*({e.name, e.name.partition("@")[0]} for e in every))):
        raise _cannot_act(name, system, law, every)
    return tuple(e for e in every if {e.name, e.name.partition("@")[0]} & wanted)


def chosen(effects: Iterable[str | Effect], system: System, law: FrictionLaw) -> tuple[Effect, ...]:
    """Effects, by name or made already, in the order in which they act.

    Raises:
        UserError: an unknown or repeated effect, one that cannot act on this system with this law, or one that acts at
            a contact and does not say at which of several.
    """
    made = [e if isinstance(e, Effect) else _made(e, system) for e in effects]
    names = tuple(e.name for e in made)
    for effect in made:
        if names.count(effect.name) > 1:
            raise UserError("effect given twice", where="effects", received=effect.name, fix="name it once")
        places = [e.name for e in _everywhere(effect, system)]
        if effect.name not in places:
            raise UserError("effect that does not say at which contact", where="effects", received=effect.name,
                            allowed=", ".join(places), fix="name its contact")  # fmt: skip
        if not effect.applies(system, law, names):
            raise _cannot_act(effect.name, system, law, applicable(system, law, names))
    place = {name: i for i, name in enumerate(EFFECTS)}
    return tuple(sorted(made, key=lambda e: place.get(e.name.partition("@")[0], len(place))))


def _cannot_act(name: str, system: System, law: FrictionLaw, allowed: Iterable[Effect]) -> UserError:
    return UserError(
        f"effect cannot act on system {system.name} with friction {law.name}",
        where="effects",
        received=name,
        allowed=", ".join(e.name for e in allowed),
        fix="leave it out",
    )


def _everywhere(effect: Effect, system: System) -> list[Effect]:
    """The effect, at every contact where the system has several and it acts at one."""
    if len(system.contacts) == 1 or effect.whole or isinstance(effect, LocatedEffect):
        return [effect]
    return [LocatedEffect(effect, contact.name) for contact in system.contacts]


def _made(name: str, system: System) -> Effect:
    """The effect of a name, ``asymmetry`` or ``asymmetry@hinge``."""
    kind, at, contact = name.partition("@")
    effect = choose(kind, EFFECTS, "effects")()
    if not at:
        return effect
    names = [e.contact for e in _everywhere(effect, system) if isinstance(e, LocatedEffect)]
    if contact not in names:
        received = f"{name} on system {system.name}"
        raise UserError("effect at no such contact", where="effects", received=received,
                        allowed=", ".join(f"{kind}@{c}" for c in names) or kind,
                        fix=nearest(contact, names))  # fmt: skip
    return LocatedEffect(effect, contact)
