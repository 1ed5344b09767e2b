"""What may be missing: effects with a name, and forces that depend on one variable in any smooth way.

Also where a fitted model was during the recording, which tells what hidden parameters to try, and the values of an
effect that no mechanism can have.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from ..numerics.along import fastest_period, moving_mass, samples
from ..numerics.simulate import Simulation
from ..physics.base import CONTACT, FrictionLaw, contact_of
from ..physics.effect import Effect
from ..physics.scan import data_scales
from ..physics.system import System
from .bench import Bench

# Where the data do not tell several effects apart, the one that occurs more often stands first.
USUAL = ("friction", "constant_force", "asymmetry", "viscous", "payload", "inertia", "stribeck", "presliding",
         "spring_force", "delay")  # fmt: skip
LIMIT = 0.99  # of the way to a limit is at it: searches may stop just short
Scales = Mapping[str, tuple[float, float]]  # see data_scales


@dataclass(frozen=True)
class Candidate:
    """Strengths that are tested together.

    Attributes:
        effect: name of the effect.
        group: of its strengths.
        strengths: parameters that are neutral as declared.
        hidden: parameters that shape the effect and are estimated with it.
        grid: values of those to try, SI units; one empty table where there are none.
    """

    effect: str
    group: str
    strengths: tuple[str, ...]
    hidden: tuple[str, ...] = ()
    grid: tuple[Mapping[str, float], ...] = field(default=({},), repr=False)

    @property
    def name(self) -> str:
        """Effect, and its group where there are several."""
        return self.effect if self.group == self.effect else f"{self.effect} ({self.group})"

    @property
    def usual(self) -> int:
        """Rank among effects that the data do not tell apart: faults of sensors last."""
        kind = self.effect.partition("@")[0]
        return USUAL.index(kind) if kind in USUAL else len(USUAL) + kind.startswith("sensor_")


def candidates(
    effects: Sequence[Effect], system: System, law: FrictionLaw, covered: Mapping[str, Scales]
) -> tuple[Candidate, ...]:
    """All groups of strengths of the effects.

    Args:
        covered: what the data cover at each contact, see :func:`scales`.
    """
    result = []
    for effect in effects:
        table = {par.name: par for par in effect.parameters_on(system, law)}
        for group, strengths in effect.groups(system, law).items():
            shapes = [par for par in table.values() if par.hidden and par.scan and par.group in ("", group)]
            own = covered[contact_of(next(iter(table)))]
            axes = [[(par.name, float(v)) for v in par.scan.values(own)] for par in shapes if par.scan]
            grid = tuple(dict(point) for point in itertools.product(*axes))
            free = tuple(par.name for par in shapes if par.scan and par.scan.count > 1)
            result.append(Candidate(effect.name, group, strengths, free, grid))
    return tuple(result)


def scales(system: System, runs: Sequence[Simulation]) -> dict[str, Scales]:
    """What hidden parameters are tried relative to, by contact; that of the first, too, for what is at none.

    See :func:`frictionpinn.physics.scan.data_scales`.
    """

    def of(view: System) -> Scales:
        own = [run.at(view.contacts[0].name) for run in runs]
        position = [samples(view, run, CONTACT.s) for run in own]
        return data_scales([run.t for run in own], position, [run.v_slip for run in own], [run.N for run in own])

    found = {contact.name: of(system.at(contact.name)) for contact in system.contacts}
    return {"": next(iter(found.values()))} | found


def impossible(
    bench: Bench,
    candidate: Candidate,
    values: Mapping[str, float],
    ci95: Mapping[str, tuple[float, float]] | None = None,
) -> str:
    """Why an effect cannot be what is missing, by what a refit made of it; empty where it can.

    * the 95 % interval holds zero (of several strengths all do), has no width (numerically degenerate), or is unknown;
    * a share or a mass at the lower limit where nothing is left: a mass, a sensor's scale, friction of one direction;
    * an inertia that makes the moving mass negative;
    * a delay longer than a period of the fastest motion: another cycle would do as well;
    * a wavelength above the stroke: no period was seen.

    Args:
        values: all parameters of the refit, SI units.
        ci95: 95 % intervals of the strengths; None: not known yet.
    """
    table = {par.name: par for par in bench.tested.parameters}
    for name in (*candidate.strengths, *candidate.hidden):
        value, low = values[name], table[name].low
        if not np.isfinite(value):
            return f"{name} is no number"
        if np.isfinite(low) and low < 0 and value <= LIMIT * low:
            return f"{name} at its limit, {low:.3g} {table[name].unit}, where nothing is left of what it changes"
        if name.endswith("wavelength") and value > (stroke := bench.sizes.at(name).scales["stroke"][1]):
            return f"{name} of {value:.3g} above the stroke of {stroke:.3g}: no period was seen"
    effect = next(e for e in bench.tested.effects if e.name == candidate.effect)
    delays = {name for signs in effect.delays(bench.tested.system, bench.tested.law).values() for name in signs}
    late = max((n for n in candidate.strengths if n in delays), key=lambda n: abs(values[n]), default=None)
    if late and abs(values[late]) > (period := fastest_period(bench.runs)):
        return f"{late} of {values[late]:.3g} s, longer than a period of the fastest motion, {period:.3g} s"
    kind, _, contact = candidate.effect.partition("@")
    own, system = values[candidate.strengths[0]], bench.mechanism.system
    if kind == "inertia" and own < 0 and own <= -moving_mass(system.at(contact), bench.runs):
        return f"inertia of {own:.3g} makes the moving mass negative"
    intervals = [] if ci95 is None else [ci95[name] for name in candidate.strengths]
    if not np.isfinite(intervals).all():
        return "these data do not tell how large it is"
    if any(low == high for low, high in intervals):
        return "its 95 % interval has no width: numerically degenerate"
    if intervals and all(low <= 0 <= high for low, high in intervals):
        return f"its 95 % interval holds zero ({'; '.join(f'{low:.3g} to {high:.3g}' for low, high in intervals)})"
    return ""
