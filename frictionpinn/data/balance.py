"""Whether forces and motion balance: inertia as declared, signs that fit, friction that brakes.

Where the contact slides for certain, the equation of motion E + J F_f = 0 is a regression: what drives it is a times
the declared inertia plus dry, viscous and constant friction, with a = 1. All of it is seen through one window, so wide
that accelerations stand clear of noise. Where positions alone were measured that is wide, and nothing slides for so
long: then forces are worked out from velocities, which need a shorter window, and averaged over the wide one, whatever
the contact does within; a rest in it errs by less than dry friction, far below what is looked for.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import sympy as sp
from scipy.ndimage import minimum_filter1d

from ..numerics.motion_function import motion_function
from ..numerics.placing import SLIDING
from ..physics import LAWS, System
from ..physics.base import MU_C, SIGMA_2
from ..physics.mechanism import Mechanism
from ..show import readable_unit
from .filters import Motion, Sampled, bump, noises, smooth_motion
from .findings import NO_SLIP, Finding, listed, named_factor
from .thresholds import ANOTHER, CLEAR, EXPLAINED, HALF, INERTIAL, OFF, SURE, USUAL, WELL_KNOWN


@dataclass(frozen=True)
class Balance:
    """What the regression says.

    Attributes:
        inertia: times the declared one; None where there is none. ``error`` its standard error.
        brakes: power of dry and viscous friction over its size, 1: it brakes throughout; ``sure``: of mu_c and sigma_2,
            the largest standard errors by which one is told.
        share: of the driving force's variance that the regression explains.
        forces: parameters of the system that were fitted with it (gravity on a joint's arm), SI units.
        moves: share of that variance which is inertia's, of a system without it that which goes with acceleration.
        elastic: share of it that goes with the position alone.
        looks: independent windows that it rests on.
        told: coefficients of the regression, shape (n,).
    """

    inertia: float | None
    error: float
    brakes: float
    sure: float
    share: float
    moves: float
    elastic: float
    forces: dict[str, float]
    looks: float
    told: np.ndarray

    @property
    def fits(self) -> bool:
        """Whether forces and motion go together as declared."""
        return not self.heavier and not self.drives

    @property
    def heavier(self) -> bool:
        """Whether the inertia is another than declared."""
        if self.inertia is None or abs(self.inertia - 1) < SURE * self.error:
            return False
        return not 1 / ANOTHER < self.inertia < ANOTHER

    @property
    def drives(self) -> bool:
        """Whether friction would drive the motion."""
        return self.brakes < 0 and self.sure > SURE


Rows = Callable[..., Balance | None]


def balance_findings(
    system: System, trials: Sequence[Sampled], sigmas: dict[str, float], inertia_free: bool = False
) -> list[Finding]:
    """What forces and motion say of masses, signs and units.

    Args:
        inertia_free: masses are estimated with the friction: another than declared is no fault.
    """
    rows = _rows(system)
    if rows is None:
        return []
    for wide in (False, True):
        motions = smooth_motion(system, trials, sigmas, wide)
        if motions and (pushed := _pushed(system, trials, motions)):
            return [pushed]
        found = rows(motions) if motions else None
        if found is None:
            continue
        told = _judged(system, sigmas, motions, rows, found, inertia_free)
        if told and not told[0].grave and (name := _unlike(system, trials, rows, wide)):
            told = [replace(told[0], what=f"{told[0].what}; trial '{name}' is unlike the others, which it explains")]
        if told or found.share > EXPLAINED:
            return told
    return []


def explained_by(system: System, trial: Sampled, others: Sequence[Sampled]) -> bool:
    """Whether inertia and friction as the others show them explain most of what drives a trial, or it slides
    nowhere: at rest, friction is whatever holds it."""
    rows = _rows(system)
    for wide in (False, True):
        theirs, own = (smooth_motion(system, trials, noises(trials), wide) for trials in (others, [trial]))
        found = rows(theirs) if rows is not None and theirs else None
        if rows is not None and found is not None:
            here = rows(own, found.told) if own else None
            return here is None or here.share > HALF
    return False


def _unlike(system: System, trials: Sequence[Sampled], rows: Rows, wide: bool) -> str:
    """The only trial without which the equation of motion explains the others; else empty."""
    names = []
    for trial in trials:
        others = [t for t in trials if t is not trial]
        motions = smooth_motion(system, others, noises(others), wide) if others else []
        found = rows(motions) if motions else None
        names += [trial.name] if found is not None and found.fits and found.share > EXPLAINED else []
    return names[0] if len(names) == 1 else ""


def _judged(
    system: System, sigmas: dict[str, float], motions: Sequence[Motion], rows: Rows, found: Balance, inertia_free: bool
) -> list[Finding]:
    """What a regression of these motions says."""
    if gravity := _missing_forces(system, motions, found):
        return [] if inertia_free else [gravity]
    if found.inertia is None and found.moves > INERTIAL:
        what = f"{100 * found.moves:.0f} % of the measured force goes with the acceleration: it moves a mass that "
        return [Finding(f"{what}system={system.name} has not (inertia)", "take system=drive or joint", grave=True)]
    loose = found.fits and not (found.share < HALF and found.moves > HALF)
    if loose and found.share > EXPLAINED:
        return []
    if inertia_free and not found.drives and (found.inertia is None or found.inertia > 0):
        return []
    better = []
    for name, change in _alternatives(system, sigmas):
        other = rows([change(motion) for motion in motions])
        if other is not None and other.fits and other.share > EXPLAINED:
            gain = 0.5 * found.looks * math.log(max(1 - found.share, 1e-12) / max(1 - other.share, 1e-12))
            better += [(other.share, name)] if not loose or gain > SURE**2 / 2 else []
    if loose and not better:
        return []
    ranked = [name for _, name in sorted(better, reverse=True)[:3]]
    fix = f"they fit with {' or with '.join(ranked)}" if ranked else ""
    if found.heavier and found.inertia is not None and found.share >= HALF:
        masses = ", ".join(f"{n} = {v:g}" for n, v in system.values.items() if _inertial(system, n))
        if found.inertia > 0:
            what = f"force and motion fit {found.inertia:.3g} times the declared inertia ({masses}), a factor of " \
                   f"{named_factor(found.inertia)}"  # fmt: skip
            advice = f"set system.parameters to what moves, or check the units of {listed(_involved(system, sigmas))}"
            return [Finding(what, "; ".join(filter(None, [advice, fix])), grave=True)]
        if not ranked and found.inertia < -ANOTHER and found.elastic > HALF:
            what = f"{NO_SLIP}: the force goes with the position as in a spring, no friction can be told"
            return [Finding(what, "record a motion that breaks loose", grave=True)]
        what = f"force and motion have opposite signs: they would need {found.inertia:.3g} times the declared inertia"
        return [
            Finding(what, fix or "turn the force or the motion: data.gains={...: -1}, or check system=", grave=True)
        ]
    if found.drives:
        what = "friction would drive the motion: force and velocity have signs that do not go together"
        return [Finding(what, fix or "turn one of them: data.gains={...: -1}", grave=True)]
    what = (
        f"the equation of motion of system={system.name} explains {100 * max(found.share, 0):.0f} % of what drives it"
    )
    advice = fix or "another system, a column that is something else, or friction that is neither dry nor viscous"
    return [Finding(what, advice, grave=bool(ranked))]


def _pushed(system: System, trials: Sequence[Sampled], motions: Sequence[Motion]) -> Finding | None:
    """A motion that speeds up though nothing drives it, or one force that never changes: beside that, friction brakes.

    The equation of motion times the slip velocity is the power of friction; what rests or coasts has none that drives.
    """
    acting = [c for c in system.moving if system.jacobian[c.name] != 0 and c.name not in system.driven]
    if len(system.contacts) > 1 or not acting:
        return None
    c = acting[0]
    residual = sp.sympify(system.residual(c))
    names = [item.name for item in system.inputs if item.symbol in residual.free_symbols]
    said = {name: told for name in names if (told := [t.signals[name] for t in trials if name in t.signals])}
    ends = {name: (min(map(np.min, told)), max(map(np.max, told))) for name, told in said.items()}
    lacking = [name for name in names if name not in said]
    if not names or any(low != high for low, high in ends.values()):
        return None
    inertia = sp.diff(residual, c.symbols[2]) * c.symbols[2]
    power_of = motion_function(system, residual * system.v_slip / system.jacobian[c.name])
    drive, own = (motion_function(system, sp.sympify(e)) for e in (residual - inertia, inertia))
    values = {name: value for name, value in system.values.items() if value is not None}
    if lacking and any(np.any(drive(m, values)) for m in motions):
        return None  # something drives it: what is not recorded need not be what is wrong
    noise, a = (np.concatenate([m[n] for m in motions]) for n in (f"_noise_{c.name}", c.signals[2]))
    power = np.concatenate([power_of(m, values) for m in motions])
    if any(np.any(own(m, values)) for m in motions):
        power = power[a**2 > SURE**2 * noise]  # where the acceleration is no noise
    if not len(power) or float(power.sum()) < -HALF * float(np.abs(power).sum()):
        return None
    if lacking:
        fix = f"name the column, data.columns={{..., {lacking[0]}: ...}}, or record it"
        return Finding(
            f"the motion speeds up without {listed(lacking)}, not recorded: friction alone brakes", fix, True
        )
    what = " and ".join(f"{name} is {low + 0.0:g}" for name, (low, _) in ends.items())
    return Finding(f"{what} in every row, which does not drive this motion: friction alone brakes",
                   f"check the column and the sensor of {listed(list(ends))}", grave=True)  # fmt: skip


def _missing_forces(system: System, motions: Sequence[Motion], found: Balance) -> Finding | None:
    """Forces of the system that were left at zero and without which nothing fits: gravity on a joint's arm."""
    names = tuple(par.name for par in system.parameters if par.neutral is not None and system.values[par.name] == 0)
    rows = _rows(system, names) if names else None
    other = rows(motions) if rows is not None else None
    if other is None or other.drives or 1 - other.share > HALF * (1 - found.share):
        return None
    now: dict[str, float] = {
        n: v for n, v in system.values.items() if v is not None and (n in names or _inertial(system, n))
    }
    times = 1.0 if other.inertia is None or 1 / OFF < other.inertia < OFF else other.inertia
    told = ", ".join(f"{n} = {other.forces.get(n, times * v):.3g} in place of {v:g}" for n, v in now.items()
                     if n in names or times != 1.0)  # fmt: skip
    advice = "set them in system.parameters, or let them be estimated (diagnose.free; in Python free)"
    return Finding(f"force and motion fit with {told}", advice, grave=True)


def _rows(system: System, forces: tuple[str, ...] = ()) -> Rows | None:
    """The regression of the first coordinate on which friction acts, as a function of motions and, where they are told
    already, of its coefficients.

    ``forces`` are parameters to fit with it, linear in the equation. None with several contacts: one equation does not
    tell what each of them does.
    """
    if len(system.contacts) > 1:
        return None
    acting = [c for c in system.moving if system.jacobian[c.name] != 0 and c.name not in system.driven]
    if not acting:
        return None
    c = acting[0]
    residual, J = system.residual(c), sp.sympify(system.jacobian[c.name])
    slope = sp.diff(residual, c.symbols[2])
    inertia = slope * c.symbols[2]
    place = system.slip_position if system.slip_position is not None else sp.Integer(0)
    mechanism = Mechanism(system, LAWS["coulomb_viscous"]())
    dry, viscous = (-J * sp.diff(mechanism.friction, par.symbol) for par in (MU_C, SIGMA_2))
    equations = (residual - inertia, inertia, J, dry, system.v_slip, slope, place, system.a_slip, viscous)
    parts = [motion_function(system, sp.sympify(e)) for e in equations]
    extra = [motion_function(system, sp.diff(residual, sp.Symbol(name, real=True))) for name in forces]
    values = {par.name: float(par.value or 0.0) for par in mechanism.parameters} | dict(system.values)

    def regress(motions: Sequence[Motion], told: np.ndarray | None = None) -> Balance | None:
        columns: list[list[np.ndarray]] = [[] for _ in range(10 + len(extra))]
        speeds = [parts[4](m, values) for m in motions]
        largest = float(np.quantile(np.abs(np.concatenate(speeds)), USUAL))
        for motion, v in zip(motions, speeds, strict=True):
            size = int(motion["_width"][0])
            sliding = minimum_filter1d(np.abs(v), size) > SLIDING * largest
            drive, own, j, dry, _, mass, x, a, viscous = (f(motion, values) for f in parts)
            noise = mass**2 * motion.get(f"_noise_{c.name}", np.zeros(len(v)))
            known = [drive, own, j, dry, viscous, v, motion["_independent"], noise, x, a,
                     *(f(motion, values) for f in extra)]  # fmt: skip
            if (count := int(motion["_average"][0])) > 1:
                known = [np.convolve(y, bump(count, 0), mode="valid") for y in known]
                sliding = np.ones(len(known[0]), bool)
            for column, y in zip(columns, known, strict=True):
                column.append(y[sliding])
        drive, own, j, dry, viscous, v, weight, noise, x, a, *further = (np.concatenate(column) for column in columns)
        if not len(own):
            return None
        independent, clear = float(weight.sum()), float(np.mean(noise)) < (1 - CLEAR) * float(np.mean(own**2))
        if told is None and (independent < WELL_KNOWN or not np.var(drive) > 0 or (np.any(own) and not clear)):
            return None  # noise in the acceleration would take inertia away
        A = np.stack([-own if np.any(own) else -j * a, dry, viscous, -j, *(-column for column in further)], axis=1)
        size = np.sqrt(np.mean(A**2, axis=0))
        unit = A / np.where(size > 0, size, 1.0)
        coefficients = np.linalg.lstsq(unit, drive, rcond=None)[0] if told is None else told * size
        left = drive - unit @ coefficients
        spread = np.linalg.pinv(unit.T @ unit / len(drive)) * float(np.mean(left**2)) / independent
        errors = np.sqrt(np.maximum(np.diag(spread), 1e-300))
        scaled = coefficients / np.where(size > 0, size, 1.0)
        force = -(scaled[1] * dry + scaled[2] * viscous) * np.sign(j)
        power = float(np.mean(force * v)) / max(float(np.mean(np.abs(force * v))), 1e-300)
        sure = float(np.max(np.abs(coefficients[1:3] / errors[1:3])))
        whole = float(np.var(drive)) + (0.0 if np.any(drive) else 1.0)
        share = 1 - float(np.var(left)) / whole
        has = bool(np.any(own))
        heavy = scaled[0] > SURE * errors[0] / (size[0] or 1.0)  # a damper's force that falls with position is a spring
        moves = float(np.var(own)) if has else float(np.var(scaled[0] * a)) * heavy
        line = np.polyval(np.polyfit(x, drive, 1), x) if np.ptp(x) > 0 else np.full(len(x), drive.mean())
        elastic = 0.0 if residual.has(*place.free_symbols) else 1 - float(np.var(drive - line)) / whole
        inertia, error = (float(scaled[0]), float(errors[0] / size[0])) if has else (None, 0.0)
        own_forces = dict(zip(forces, scaled[4:].tolist(), strict=True))
        return Balance(inertia, error, power, sure, share, moves / whole, elastic, own_forces, independent, scaled)

    return regress


def _alternatives(system: System, sigmas: Mapping[str, float]) -> list[tuple[str, Callable[[Motion], Motion]]]:
    """Changes of the recording that its author may have meant: signs, units, the zero of an angle."""

    def times(names: Sequence[str], factor: float, own: str = "") -> Callable[[Motion], Motion]:
        powers = dict.fromkeys(names, factor) | {f"_noise_{own}": factor**2}
        return lambda motion: motion | {n: motion[n] * power for n, power in powers.items() if n in motion}

    def turned(name: str) -> Callable[[Motion], Motion]:
        return lambda motion: motion | {name: motion[name] + math.pi}

    result: list[tuple[str, Callable[[Motion], Motion]]] = []
    for c in system.moving:
        shown = [name for name in c.signals if name in sigmas]
        if not shown:
            continue
        result.append((f"the sign of {listed(shown)} turned", times(c.signals, -1.0, c.name)))
        if c.units[0] == "rad":
            result.append((f"{listed(shown)} in degrees", times(c.signals, math.pi / 180, c.name)))
            if c.signals[0] in shown:
                result.append((f"{c.signals[0]} counted from the other end (pi added)", turned(c.signals[0])))
        else:
            result.append((f"{listed(shown)} in mm", times(c.signals, 1e-3, c.name)))
    for item in system.inputs:
        if item.name in sigmas:
            result.append((f"the sign of {item.name} turned", times([item.name], -1.0)))
            result += [(f"{item.name} in m{readable_unit(item.unit)}", times([item.name], 1e-3)),
                       (f"{item.name} in k{readable_unit(item.unit)}", times([item.name], 1e3))]  # fmt: skip
    return result


def _inertial(system: System, name: str) -> bool:
    return any(par.name == name and "kg" in par.unit for par in system.parameters)


def _involved(system: System, sigmas: Mapping[str, float]) -> list[str]:
    return [name for name in system.signal_units if name in sigmas]
