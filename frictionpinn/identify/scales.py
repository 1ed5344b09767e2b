"""Where the parameters start: what the smoothed motion says of friction in sliding, orders of magnitude elsewhere."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import sympy as sp
from scipy.optimize import least_squares

from ..numerics.motion import Motion, typical
from ..numerics.motion_function import motion_function, sliding_friction
from ..numerics.whiteness import correlation_time
from ..physics.base import at_contact, plain_name
from ..physics.beforehand import EXCESS, STRIBECK
from ..physics.mechanism import Mechanism
from ..physics.scan import DECADES, data_scales
from ..physics.sizes import Sizes, SizesByContact
from ..physics.system import System

NUDGE = 0.3  # of its size: where a strength starts whose effect has a shape to find as well
WEAKEST = 0.01  # of the larger of dry and viscous friction: where the smaller one starts at least


@dataclass(frozen=True)
class Scales:
    """Where the parameters start.

    Attributes:
        start: name -> start value of the free parameters, SI units.
        masses: contact -> mass that it feels; None where no inertia takes part.
        sizes: how large parameters are on this data.
        alone: name -> what mu_c or sigma_2 would be if it made all the friction, and mu_s beside such a mu_c.
    """

    start: dict[str, float]
    masses: dict[str, float | None]
    sizes: Sizes
    alone: dict[str, float]

    @classmethod
    def of(
        cls, mechanism: Mechanism, motions: Sequence[Motion], fixed: Mapping[str, float], names: Sequence[str]
    ) -> Scales:
        """Start values of the free parameters ``names``: regression where that tells, orders of magnitude elsewhere.

        An effect's hidden parameters start in the middle of their scan, its strengths at their neutral value, or
        beside that if a hidden one is free: it would not show.
        """
        known = typical(mechanism) | dict(fixed)
        found, errors = _sliding_regression(mechanism, motions, known, names)
        # What is told to be less than its own error may be as much, and of a start far too small no slope tells.
        found |= {name: max(found[name], error) for name, error in errors.items()}
        known |= found
        rough, alone = dict[str, float](), dict[str, float]()
        masses, sizes = dict[str, float | None](), dict[str, Sizes]()
        for contact in mechanism.contacts:
            at = [motion.at(contact.name) for motion in motions]
            mu, viscous, bristle = (at_contact(contact.name, name) for name in ("mu_c", "sigma_2", "sigma_0"))
            mass = masses[contact.name] = _effective_mass(mechanism, contact.system, motions, known)
            slips = [motion.v_slip for motion in at]
            velocity = float(np.sqrt(np.mean(np.concatenate(slips) ** 2))) or 1.0
            rates = np.concatenate([np.gradient(motion.v_slip, motion.t) for motion in at])
            acceleration = float(np.sqrt(np.mean(rates**2))) or 1.0
            load = max(float(np.mean([np.mean(np.abs(motion.normal)) for motion in at])), 1e-12)
            shares = {name: unit for name, unit in ((mu, load), (viscous, velocity)) if name in found}
            largest = max((found[name] * unit for name, unit in shares.items()), default=0.0)
            alone |= {name: largest / unit for name, unit in shares.items()}
            found |= {name: max(found[name], WEAKEST * alone[name]) for name in shares}
            if mu in shares:
                alone[at_contact(contact.name, "mu_s")] = (1 + EXCESS) * alone[mu]
            mu_c = found.get(mu, known.get(mu, 1.0))
            force = max(mu_c * load, largest)  # what slides looks viscous to noisy data; bristles may carry all of it
            if not contact.law.parameters and mass:  # no friction: what its motion needs
                force = mass * acceleration
            stiffness = fixed.get(bristle, force / (1e-2 * velocity**2 / acceleration))
            damping = np.sqrt(stiffness * mass) if mass else 1e-2 * stiffness * velocity / acceleration
            own = {
                "mu_c": mu_c, "mu_s": (1 + EXCESS) * mu_c, "v_s": STRIBECK * velocity, "sigma_0": stiffness,
                "sigma_1": damping, "sigma_2": 0.1 * force / velocity,
            }  # fmt: skip
            rough |= {at_contact(contact.name, name): value for name, value in own.items()}
            times, places = [motion.t for motion in at], [motion.position for motion in at]
            scales = data_scales(times, places, slips, [np.ones(1) * load])
            turns = contact.system.slip_unit == "rad"
            sizes[contact.name] = Sizes(scales, velocity, force, turns)
        first, *others = sizes.values()
        whole = SizesByContact(**vars(first), contacts=sizes) if others else first
        declared = {par.name for par in (*mechanism.system.parameters, *mechanism.law.parameters)}
        for effect in mechanism.effects:
            pars = effect.parameters_on(mechanism.system, mechanism.law)
            shaped = any(par.hidden and par.name in names for par in pars)
            for par in pars:
                if par.name in declared or par.name not in names:
                    continue
                if par.scan is not None and par.hidden:
                    rough[par.name] = whole.at(par.name).middle(par.scan)
                elif par.neutral is None:
                    rough[par.name] = float(par.value or 1.0)
                else:
                    rough[par.name] = par.neutral + (NUDGE * whole.of(par) if shaped and not par.hidden else 0.0)
        return cls({name: float(found.get(name, rough.get(name, known[name]))) for name in names}, masses, whole, alone)


def default_bounds(
    mechanism: Mechanism, scales: Scales, given: Mapping[str, Sequence[float] | None]
) -> dict[str, Sequence[float] | None]:
    """Bounds around the start where none are given: a decade for friction coefficients and masses, else two.

    Strengths of effects keep their physical limits; what is scanned keeps to its scan. A bristle may bend as far as the
    whole stroke: a contact that hardly slips shows nothing but its stiffness.
    """
    wide, table = ("sigma_0", "sigma_1", "sigma_2", "v_s"), {par.name: par for par in mechanism.parameters}
    result = dict(given)
    for name, value in scales.start.items():
        par = table[name]
        if given.get(name) is not None:
            continue
        own = plain_name(name)
        if par.hidden and par.scan is not None and par.scan.count > 1:
            result[name] = scales.sizes.at(name).ends(par.scan)
        elif par.low >= 0 and par.neutral is None:
            factor, least = 10**DECADES if own in wide else 10.0, max(par.low, 1e-12)
            low = min(max(abs(value) / (100.0 if own == "mu_c" else factor), least), 0.5 * par.high)
            if own == "sigma_0" and (stroke := scales.sizes.at(name).scales["stroke"][1]) > 0:
                low = max(min(low, scales.sizes.at(name).force / stroke), least)
            low = par.low if par.absent else low
            high = max(abs(value) * factor, 10 * low, 10 * scales.alone.get(name, 0.0))
            result[name] = (low, min(high, par.high))
    return result


def _sliding_regression(
    mechanism: Mechanism, motions: Sequence[Motion], values: Mapping[str, float], free: Sequence[str]
) -> tuple[dict[str, float], dict[str, float]]:
    """Least squares on the sliding samples: (E + sum_k J_k (mu_c F_N sign(v) + sigma_2 v + forces of effects)_k)
    / inertia = 0.

    Returns mu_c, sigma_2, parameters of the system and strengths of effects, as far as they are free; the strengths
    whose force follows from the motion alone; and the standard errors of mu_c and sigma_2. ``values`` are all
    parameters, start values of the free ones.
    """
    system = mechanism.system
    own = {par.name: par.neutral is not None for par in system.parameters}  # forces may be zero or negative
    shares = {"mu_c": 1.0, "sigma_2": 0.1}  # of the friction: what each is guessed to make
    guessed = {n: shares[plain_name(n)] for n in free if plain_name(n) in shares}
    names = [n for n in free if n in guessed or own.get(n) is False]
    if not names or not any(motion.fast.any() for motion in motions):
        return {}, {}
    neutral = {par.symbol: par.neutral for par in mechanism.parameters if par.neutral is not None}
    told = {s for c in system.moving for s in c.symbols}
    told |= {par.symbol for par in mechanism.parameters if par.name not in free}
    # Strength -> force of one unit that the system's equation does not hold already.
    extra: dict[str, sp.Expr] = {n: sp.Integer(0) for n in free if own.get(n)}
    forces: dict[str, sp.Expr] = {}
    zero: dict[str, float] = {}
    for contact in mechanism.contacts:
        pair = tuple(at_contact(contact.name, name) for name in shares)
        zero |= dict.fromkeys(pair, 0.0)
        force = sliding_friction(contact.system, *sp.symbols(pair, real=True))
        for par in mechanism.parameters:
            if par.neutral is not None and par.name in free and par.name not in (*own, *guessed):
                slope = sp.diff(contact.friction, par.symbol).xreplace(neutral)
                if slope != 0 and slope.free_symbols <= told:
                    extra[par.name] = slope
                    force += par.symbol * slope
        forces[contact.name] = force
    functions = []
    for c in system.free:
        along = {contact.name: contact.system.jacobian[c.name] for contact in mechanism.contacts}
        if any(J != 0 for J in along.values()):
            balance = system.residual(c) + sum(J * forces[name] for name, J in along.items())
            inertia = sp.diff(system.residual(c), c.symbols[2])  # else no masses would balance best
            functions.append(motion_function(system, balance / (inertia if inertia != 0 else 1)))
    stacked = {key: np.concatenate([m.signals[key][m.fast] for m in motions]) for key in motions[0].signals}
    known = zero | dict(values) | dict.fromkeys(extra, 0.0)
    bases = [function(stacked, known | zero) for function in functions]
    scales = [max(float(np.std(base)), 1e-12) for base in bases]
    guess = {name: float(known.get(name, 1.0)) for name in names}

    def felt(name: str, base: Sequence[np.ndarray], p: Mapping[str, float]) -> tuple[int, np.ndarray]:
        """The equation that a parameter changes most, and by what a unit of it does."""
        changes = [f(stacked, {**p, name: 1.0}) - b for f, b in zip(functions, base, strict=True)]
        most = int(np.argmax([np.abs(change).max() / scale for change, scale in zip(changes, scales, strict=True)]))
        return most, changes[most]

    for name, share in guessed.items():
        k, slope = felt(name, bases, known | zero)
        guess[name] = share * abs(float(slope @ bases[k]) / max(float(slope @ slope), 1e-300))
    whole, unit = [function(stacked, known) for function in functions], {}
    for name in extra:
        k, change = felt(name, whole, known)
        unit[name] = scales[k] / (float(np.sqrt(np.mean(change**2))) or 1.0)

    def parameters(x: np.ndarray) -> dict[str, float]:
        found = dict(zip(names, np.exp(x[: len(names)]).tolist(), strict=True))
        return found | {name: unit[name] * value for name, value in zip(extra, x[len(names) :].tolist(), strict=True)}

    def residual(x: np.ndarray) -> np.ndarray:
        p = known | parameters(x)
        return np.concatenate([f(stacked, p) / scale for f, scale in zip(functions, scales, strict=True)])

    start = np.append(np.log([max(guess[name], 1e-9) for name in names]), np.zeros(len(extra)))
    bounds = start - 12, start + 8
    best = parameters(least_squares(residual, start, loss="soft_l1", f_scale=0.3, max_nfev=60, bounds=bounds).x)
    cuts = np.cumsum([motion.fast.sum() for motion in motions])[:-1]
    return best, {name: _error(functions, stacked, known | best, name, cuts) for name in guessed}


def _error(functions: Sequence[Callable], stacked: Mapping, p: Mapping, name: str, cuts: np.ndarray) -> float:
    """Standard error of a coefficient of friction beside known others, residuals as large and as long correlated as
    they are: a stiff coupling turns noise of positions into forces. A trial begins at each of the ``cuts``. 0 where no
    equation holds it: nothing is told."""
    information = 0.0
    for f in functions:
        left = f(stacked, p)
        slope = f(stacked, {**p, name: p[name] + 1.0}) - left
        level = float(np.mean(left**2)) * correlation_time(np.split(left, cuts))
        information += float(slope @ slope) / max(level, 1e-300)
    return 1 / np.sqrt(information) if information > 0 else 0.0


def _effective_mass(
    mechanism: Mechanism, at: System, motions: Sequence[Motion], values: Mapping[str, float]
) -> float | None:
    """Mass that a contact feels, (dE/da) / J^2, averaged over the trials; None where no inertia takes part."""
    for c in mechanism.free:
        jacobian = at.jacobian[c.name]
        if jacobian != 0:
            f = motion_function(at, sp.diff(at.residual(c), c.symbols[2]) / jacobian**2)
            return float(np.mean([np.mean(f(m.signals, values)) for m in motions]))
    return None
