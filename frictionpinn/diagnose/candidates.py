"""What may be missing: the strengths of every effect that can act, with the hidden parameters to try for each."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from ..physics.base import FrictionLaw
from ..physics.effect import Effect
from ..physics.effects import EFFECTS, applicable
from ..physics.system import System

# Where the data do not tell several effects apart, the one that occurs more often stands first.
USUAL = (
    "constant_force",
    "asymmetry",
    "viscous",
    "payload",
    "inertia",
    "stribeck",
    "presliding",
    "spring_force",
    "delay",
)


@dataclass(frozen=True)
class Candidate:
    """Strengths that are tested together.

    Attributes:
        effect: name of the effect.
        group: of its strengths.
        strengths: parameters that are neutral as declared.
        hidden: parameters that shape the effect and are estimated with it.
        grid: values of those to try, SI units; one empty table where there are none.
        bends: see :class:`frictionpinn.physics.effect.Effect`.
    """

    effect: str
    group: str
    strengths: tuple[str, ...]
    hidden: tuple[str, ...] = ()
    grid: tuple[Mapping[str, float], ...] = field(default=({},))
    bends: bool = False

    @property
    def name(self) -> str:
        """Effect, and its group where there are several."""
        return self.effect if self.group == self.effect else f"{self.effect} ({self.group})"

    @property
    def usual(self) -> int:
        """Rank among effects that the data do not tell apart."""
        rest = len(USUAL) + self.effect.startswith("sensor_")
        return USUAL.index(self.effect) if self.effect in USUAL else rest


def effects_for(system: System, law: FrictionLaw, names: Iterable[str] | None = None) -> tuple[Effect, ...]:
    """Every effect that can act on a system with a law, or the named ones among them, as objects."""
    first = {effect.name for effect in applicable(system, law)}
    every = {effect.name for effect in applicable(system, law, tuple(first))}
    wanted = every if names is None else every & set(names)
    return tuple(EFFECTS[name]() for name in EFFECTS if name in wanted)


def candidates(
    effects: Sequence[Effect], system: System, law: FrictionLaw, scales: Mapping[str, tuple[float, float]]
) -> tuple[Candidate, ...]:
    """All groups of strengths of the effects.

    Args:
        scales: what the data cover, see :func:`frictionpinn.physics.scan.data_scales`.
    """
    result = []
    for effect in effects:
        table = {par.name: par for par in effect.parameters_on(system, law)}
        for group, strengths in effect.groups(system, law).items():
            hidden = [par for par in table.values() if par.hidden and par.scan and par.group in ("", group)]
            axes = [[(par.name, float(v)) for v in par.scan.values(scales)] for par in hidden if par.scan]
            grid = tuple(dict(point) for point in itertools.product(*axes))
            free = tuple(par.name for par in hidden if par.scan and par.scan.count > 1)
            result.append(Candidate(effect.name, group, strengths, free, grid, effect.bends))
    return tuple(result)
