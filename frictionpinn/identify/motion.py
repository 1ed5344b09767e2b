"""What the smoothed signals say before any simulation: slip, friction in sliding, where the parameters start."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import sympy as sp
from scipy.integrate import cumulative_trapezoid
from scipy.optimize import least_squares
from scipy.signal import find_peaks

from ..data.findings import SLIDING
from ..numerics.motion_function import motion_function
from ..numerics.smoothing import Coordinate
from ..numerics.spline_basis import smooth_together
from ..physics.mechanism import Mechanism
from ..physics.scan import DECADES, data_scales
from ..physics.sizes import Sizes
from .trial import TrialModel

CLEAR = 4.0  # and of the velocity's noise, in standard deviations
SHORTEST_WINDOW = 24  # samples in a window between two peaks of the slip velocity
NUDGE = 0.3  # of its size: where a strength starts whose effect has a shape to find as well
WEAKEST = 0.01  # of the larger of dry and viscous friction: where the smaller one starts at least


@dataclass(frozen=True)
class Motion:
    """Smoothed signals of one trial, and what follows from them.

    Attributes:
        model: the trial.
        signals: name -> samples, shape (n,), SI units: free and driven coordinates and inputs.
        v_slip: slip velocity, shape (n,).
        fast: samples that slide for certain, shape (n,), bool.
    """

    model: TrialModel
    signals: dict[str, np.ndarray]
    v_slip: np.ndarray
    fast: np.ndarray

    @property
    def edges(self) -> list[int]:
        """Samples between which a window holds one stretch of low speed: peaks of the slip velocity, and the ends."""
        speed, last = np.abs(self.v_slip), len(self.v_slip) - 1
        peaks, _ = find_peaks(np.where(self.fast, speed, 0.0), distance=SHORTEST_WINDOW)
        return [0, *(int(k) for k in peaks if SHORTEST_WINDOW <= k <= last - SHORTEST_WINDOW), last]

    @property
    def normal(self) -> np.ndarray:
        """Normal force, shape (n,), as far as the motion tells it."""
        return self._samples(self.model.simulator.mechanism.system.N)

    @property
    def position(self) -> np.ndarray:
        """Slip position, shape (n,); the integral of the slip velocity where no expression gives it."""
        position = self.model.simulator.mechanism.system.slip_position
        if position is None:
            return cumulative_trapezoid(self.v_slip, self.model.t, initial=0.0)
        return self._samples(position)

    def _samples(self, expr: sp.Expr) -> np.ndarray:
        mechanism = self.model.simulator.mechanism
        return motion_function(mechanism.system, expr)(self.signals, _typical(mechanism))


def smoothed(mechanism: Mechanism, models: Sequence[TrialModel], sigmas: Mapping[str, float]) -> list[Motion]:
    """The trials with free coordinates smoothed by splines, the inputs as fitted.

    ``sigmas`` are noise standard deviations by signal, SI units.
    """
    signals = [dict(model.path(model.local).signals) for model in models]
    measured = [dict(zip(model.outputs, model.y, strict=True)) for model in models]
    if mechanism.system.massless:  # the force of an imposed motion is measured, not an input
        for own, rows in zip(signals, measured, strict=True):
            own.update({name: np.nan_to_num(y) for name, y in rows.items()})
    for c in mechanism.free:
        data: list[Coordinate] = [
            (model.t, rows.get(c.signals[0]), rows.get(c.signals[1]), rows.get(c.signals[2]))
            for model, rows in zip(models, measured, strict=True)
        ]
        for own, smooth in zip(signals, smooth_together(data, [sigmas.get(name) for name in c.signals]), strict=True):
            own.update(zip(c.signals, smooth[:3], strict=True))
    v_slip, typical = motion_function(mechanism.system, mechanism.system.v_slip), _typical(mechanism)
    slips = [v_slip(own, typical) for own in signals]
    largest = max(float(np.quantile(np.abs(v), 0.99)) for v in slips)
    noise = max([sigmas[c.signals[1]] for c in mechanism.free if c.signals[1] in sigmas], default=0.0)
    threshold = max(SLIDING * largest, min(CLEAR * noise, 0.5 * largest))
    return [Motion(m, own, v, np.abs(v) > threshold) for m, own, v in zip(models, signals, slips, strict=True)]


@dataclass(frozen=True)
class Scales:
    """Where the parameters start.

    Attributes:
        start: name -> start value of the free parameters, SI units.
        mass: that the contact feels; None where no inertia takes part.
        sizes: how large parameters are on this data.
        alone: name -> what mu_c or sigma_2 would be if it made all the friction.
    """

    start: dict[str, float]
    mass: float | None
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
        known = _typical(mechanism) | dict(fixed)
        found = _sliding_regression(mechanism, motions, known, names)
        known |= found
        mass = _effective_mass(mechanism, motions, known)
        slips = [motion.v_slip for motion in motions]
        velocity = float(np.sqrt(np.mean(np.concatenate(slips) ** 2))) or 1.0
        rates = np.concatenate([np.gradient(motion.v_slip, motion.model.t) for motion in motions])
        acceleration = float(np.sqrt(np.mean(rates**2))) or 1.0
        load = max(float(np.mean([np.mean(np.abs(motion.normal)) for motion in motions])), 1e-12)
        shares = {name: unit for name, unit in (("mu_c", load), ("sigma_2", velocity)) if name in found}
        largest = max((found[name] * unit for name, unit in shares.items()), default=0.0)
        alone = {name: largest / unit for name, unit in shares.items()}
        found |= {name: max(found[name], WEAKEST * value) for name, value in alone.items()}
        mu_c = found.get("mu_c", known.get("mu_c", 1.0))
        force = mu_c * load
        stiffness = fixed.get("sigma_0", force / (1e-2 * velocity**2 / acceleration))
        damping = np.sqrt(stiffness * mass) if mass else 1e-2 * stiffness * velocity / acceleration
        rough = {
            "mu_c": mu_c, "mu_s": 1.5 * mu_c, "v_s": 0.02 * velocity, "sigma_0": stiffness, "sigma_1": damping,
            "sigma_2": 0.1 * force / velocity,
        }  # fmt: skip
        times, places = [motion.model.t for motion in motions], [motion.position for motion in motions]
        scales = data_scales(times, places, slips, [np.ones(1) * load])
        sizes = Sizes(scales, velocity, max(force, largest), mechanism.system.slip_unit == "rad")
        declared = {par.name for par in (*mechanism.system.parameters, *mechanism.law.parameters)}
        for effect in mechanism.effects:
            own = effect.parameters_on(mechanism.system, mechanism.law)
            shaped = any(par.hidden and par.name in names for par in own)
            for par in own:
                if par.name in declared or par.name not in names:
                    continue
                if par.scan is not None and par.hidden:
                    rough[par.name] = sizes.middle(par.scan)
                elif par.neutral is None:
                    rough[par.name] = float(par.value or 1.0)
                else:
                    rough[par.name] = par.neutral + (NUDGE * sizes.of(par) if shaped and not par.hidden else 0.0)
        return cls({name: float(found.get(name, rough.get(name, known[name]))) for name in names}, mass, sizes, alone)


def default_bounds(
    mechanism: Mechanism, scales: Scales, given: Mapping[str, Sequence[float] | None]
) -> dict[str, Sequence[float] | None]:
    """Bounds around the start where none are given: a decade for friction coefficients and masses, else two.

    Strengths of effects keep their physical limits; what is scanned keeps to its scan.
    """
    wide, table = ("sigma_0", "sigma_1", "sigma_2", "v_s"), {par.name: par for par in mechanism.parameters}
    result = dict(given)
    for name, value in scales.start.items():
        par = table[name]
        if given.get(name) is not None:
            continue
        if par.hidden and par.scan is not None:
            result[name] = scales.sizes.ends(par.scan)
        elif par.low >= 0 and par.neutral is None:
            factor, least = 10**DECADES if name in wide else 10.0, max(par.low, 1e-12)
            low = min(max(abs(value) / (100.0 if name == "mu_c" else factor), least), 0.5 * par.high)
            low = par.low if par.absent else low
            high = max(abs(value) * factor, 10 * low, 10 * scales.alone.get(name, 0.0))
            result[name] = (low, min(high, par.high))
    return result


def _sliding_regression(
    mechanism: Mechanism, motions: Sequence[Motion], values: Mapping[str, float], free: Sequence[str]
) -> dict[str, float]:
    """Least squares on the sliding samples: (E + J (mu_c F_N sign(v) + sigma_2 v + forces of effects)) / inertia = 0.

    Returns mu_c, sigma_2, parameters of the system and strengths of effects, as far as they are free; the strengths
    whose force follows from the motion alone. ``values`` are all parameters, start values of the free ones.
    """
    system = mechanism.system
    own = {par.name: par.neutral is not None for par in system.parameters}  # forces may be zero or negative
    names = [n for n in free if n in ("mu_c", "sigma_2") or own.get(n) is False]
    if not names or not any(motion.fast.any() for motion in motions):
        return {}
    neutral = {par.symbol: par.neutral for par in mechanism.parameters if par.neutral is not None}
    told = {s for c in system.moving for s in c.symbols}
    told |= {par.symbol for par in mechanism.parameters if par.name not in free}
    # Strength -> force of one unit that the system's equation does not hold already.
    extra: dict[str, sp.Expr] = {n: sp.Integer(0) for n in free if own.get(n)}
    for par in mechanism.parameters:
        if par.neutral is not None and par.name in free and par.name not in own:
            slope = sp.diff(mechanism.friction, par.symbol).xreplace(neutral)
            if slope != 0 and slope.free_symbols <= told:
                extra[par.name] = slope
    mu, viscous = sp.Symbol("mu_c", real=True), sp.Symbol("sigma_2", real=True)
    force = mu * system.N * sp.sign(system.v_slip) + viscous * system.v_slip
    force += sum((sp.Symbol(name, real=True) * slope for name, slope in extra.items()), start=sp.Integer(0))
    functions = []
    for c in mechanism.free or tuple(c for c in system.moving if c.name not in system.driven):
        if system.jacobian[c.name] != 0:
            balance = system.residual(c) + system.jacobian[c.name] * force
            inertia = sp.diff(balance, c.symbols[2])  # else no masses would balance best
            functions.append(motion_function(system, balance / (inertia if inertia != 0 else 1)))
    stacked = {key: np.concatenate([m.signals[key][m.fast] for m in motions]) for key in motions[0].signals}
    known = {"mu_c": 0.0, "sigma_2": 0.0} | dict(values) | dict.fromkeys(extra, 0.0)
    base = functions[0](stacked, known | {"mu_c": 0.0, "sigma_2": 0.0})
    scale = max(float(np.std(base)), 1e-12)
    guess = {name: float(known.get(name, 1.0)) for name in names}
    for name, share in (("mu_c", 1.0), ("sigma_2", 0.1)):
        if name in names:
            slope = functions[0](stacked, known | {"mu_c": 0.0, "sigma_2": 0.0, name: 1.0}) - base
            guess[name] = share * abs(float(slope @ base) / max(float(slope @ slope), 1e-300))
    whole = functions[0](stacked, known)
    changes = {name: functions[0](stacked, known | {name: 1.0}) - whole for name in extra}
    unit = {name: scale / (float(np.sqrt(np.mean(change**2))) or 1.0) for name, change in changes.items()}

    def parameters(x: np.ndarray) -> dict[str, float]:
        found = dict(zip(names, np.exp(x[: len(names)]).tolist(), strict=True))
        return found | {name: unit[name] * value for name, value in zip(extra, x[len(names) :].tolist(), strict=True)}

    def residual(x: np.ndarray) -> np.ndarray:
        p = known | parameters(x)
        return np.concatenate([function(stacked, p) for function in functions]) / scale

    start = np.append(np.log([max(guess[name], 1e-9) for name in names]), np.zeros(len(extra)))
    bounds = start - 12, start + 8
    return parameters(least_squares(residual, start, loss="soft_l1", f_scale=0.3, max_nfev=60, bounds=bounds).x)


def _effective_mass(mechanism: Mechanism, motions: Sequence[Motion], values: Mapping[str, float]) -> float | None:
    """Mass that the contact feels, (dE/da) / J^2, averaged over the trials; None where no inertia takes part."""
    for c in mechanism.free:
        jacobian = mechanism.system.jacobian[c.name]
        if jacobian != 0:
            f = motion_function(mechanism.system, sp.diff(mechanism.system.residual(c), c.symbols[2]) / jacobian**2)
            return float(np.mean([np.mean(f(m.signals, values)) for m in motions]))
    return None


def _typical(mechanism: Mechanism) -> dict[str, float]:
    """Values of all parameters, 1 where one has none."""
    values = {par.name: par.value for par in mechanism.parameters} | mechanism.system.values
    return {name: 1.0 if value is None else float(value) for name, value in values.items()}
