"""What the smoothed signals say before any simulation: slip, forces, the sliding regression, natural windows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import sympy as sp
from scipy.optimize import least_squares
from scipy.signal import find_peaks

from ..numerics.paths import InputPath
from ..numerics.smoothing import Coordinate, Smoothed, SmoothingSpline
from ..physics.mechanism import Mechanism
from .trial import TrialModel

SLIDING = 0.15  # of the largest slip velocity: faster samples count as sliding
CLEAR = 4.0  # and of the velocity's noise, in standard deviations
SPACINGS = (3, 6, 12, 24, 48)  # samples per knot tried for the free coordinates, which friction makes jump
SHORTEST = 24  # samples in a window between two peaks of the slip velocity


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
        peaks, _ = find_peaks(np.where(self.fast, speed, 0.0), distance=SHORTEST)
        return [0, *(int(k) for k in peaks if SHORTEST <= k <= last - SHORTEST), last]

    def windows(self, mu_c: float | None = None) -> list[TrialModel]:
        """The trial cut at these peaks, inputs known, starting in steady sliding or at rest.

        With ``mu_c`` a bristle that starts in sliding carries that friction force. It forgets it within the first
        sample, which is left to the window before, and derivatives of a steady start are not needed.
        """
        model, path = self.model, self.model.path(self.model.local)
        free = model.simulator.mechanism.free
        result = []
        edges, normal = self.edges, self._normal() if mu_c else np.zeros(0)
        for k, (i, j) in enumerate(pairwise(edges)):
            start, moving = {}, bool(self.fast[i])
            for c in free:
                start[c.signals[0]] = float(self.signals[c.signals[0]][i])
                start[c.signals[1]] = float(self.signals[c.signals[1]][i]) if moving else 0.0
            if not k and not moving:  # a trial may begin while it slides slowly
                start |= {c.signals[1]: model.start[c.signals[1]] for c in free}
                moving = any(start[c.signals[1]] != 0 for c in free)
            states = tuple(start) if moving else tuple(c.signals[0] for c in free)
            part = slice(i, j + 1)
            y = model.y[:, part].copy()
            if self.fast[i] and mu_c and "sigma_0" in model.simulator.parameter_names:
                start["z"] = mu_c * float(normal[i] * np.sign(self.v_slip[i]))
                y[:, 0] = np.nan
            base = InputPath(path.names, model.t[part], path.coefficients[i:j], path.session)
            result.append(
                replace(
                    model, trial=f"{model.trial}[{k}]", t=model.t[part], y=y, base=base, inputs=(), states=states,
                    start=start, directions=None,
                )
            )  # fmt: skip
        return result

    def _normal(self) -> np.ndarray:
        mechanism = self.model.simulator.mechanism
        normal = _function(mechanism, mechanism.system.N)(self.signals, _defaults(mechanism))
        return np.broadcast_to(normal, self.v_slip.shape)


def smoothed(mechanism: Mechanism, models: Sequence[TrialModel], sigmas: Mapping[str, float]) -> list[Motion]:
    """Smooth the free coordinates by splines (knots by Bayesian information criterion), the inputs as fitted."""
    signals = [dict(model.path(model.local).signals) for model in models]
    for own, model in zip(signals, models, strict=True):  # the force of an imposed motion is measured, not an input
        forces = model.outputs if mechanism.system.massless else ()
        own.update({name: np.nan_to_num(model.y[list(model.outputs).index(name)]) for name in forces})
    for c in mechanism.free:
        known = [sigmas.get(name) for name in c.signals]
        data = [(m.t, _row(m, c.signals[0]), _row(m, c.signals[1]), _row(m, c.signals[2])) for m in models]
        for own, smooth in zip(signals, _smoothed(data, known), strict=True):
            own.update(zip(c.signals, smooth[:3], strict=True))
    v_slip = _function(mechanism, mechanism.system.v_slip)
    defaults = _defaults(mechanism)
    slips = [v_slip(own, defaults) for own in signals]
    largest = max(float(np.quantile(np.abs(v), 0.99)) for v in slips)
    noise = max([sigmas.get(c.signals[1], 0.0) for c in mechanism.free if c.signals[1] in sigmas], default=0.0)
    threshold = max(SLIDING * largest, min(CLEAR * noise, 0.5 * largest))
    return [
        Motion(m, own, v, np.abs(v) > threshold) for m, own, v in zip(models, signals, slips, strict=True)
    ]  # fmt: skip


def sliding_regression(
    mechanism: Mechanism, motions: Sequence[Motion], values: Mapping[str, float], free: Sequence[str]
) -> dict[str, float]:
    """Least squares on the sliding samples: (E + J (mu_c F_N sign(v) + sigma_2 v + forces of effects)) / inertia = 0.

    Args:
        values: parameters of the system that are known, and start values of those that are not.
        free: parameters to find among mu_c, sigma_2, those of the system and strengths whose force is known there.

    Returns:
        name -> value of those.
    """
    system = mechanism.system
    extra = _forces_of_effects(mechanism, free)
    names = [n for n in free if n in ("mu_c", "sigma_2") or n in {par.name for par in system.parameters}]
    if not names or not any(motion.fast.any() for motion in motions):
        return {}
    rows = mechanism.free or tuple(c for c in system.moving if c.name not in system.driven)
    used = [c for c in rows if system.jacobian[c.name] != 0]
    mu, viscous = sp.Symbol("mu_c", real=True), sp.Symbol("sigma_2", real=True)
    force = mu * system.N * sp.sign(system.v_slip) + viscous * system.v_slip
    force += sum((sp.Symbol(name, real=True) * slope for name, slope in extra.items()), start=sp.Integer(0))
    balances = {c: system.residual(c) + system.jacobian[c.name] * force for c in used}
    inertia = {c: sp.diff(row, c.symbols[2]) for c, row in balances.items()}  # else no masses would balance best
    functions = [_function(mechanism, row / (inertia[c] if inertia[c] != 0 else 1)) for c, row in balances.items()]
    stacked = {key: np.concatenate([m.signals[key][m.fast] for m in motions]) for key in motions[0].signals}
    nothing = {"mu_c": 0.0, "sigma_2": 0.0} | dict.fromkeys(extra, 0.0)
    scale = max(float(np.std(functions[0](stacked, {**values, **nothing}))), 1e-12)
    known = {"mu_c": 0.0, "sigma_2": 0.0} | dict(values) | dict.fromkeys(extra, 0.0)
    guess = {name: _guess(name, stacked, functions[0], known) for name in names}
    unit = {name: scale / (_rms(functions[0], stacked, known, name) or 1.0) for name in extra}

    def residual(logs: np.ndarray) -> np.ndarray:
        p = known | dict(zip(names, np.exp(logs[: len(names)]), strict=True))
        p |= {name: unit[name] * x for name, x in zip(extra, logs[len(names) :], strict=True)}
        return np.concatenate([f(stacked, p) for f in functions]) / scale

    start = np.append(np.log([max(guess[name], 1e-9) for name in names]), np.zeros(len(extra)))
    found = least_squares(residual, start, loss="soft_l1", f_scale=0.3, max_nfev=60, bounds=(start - 12, start + 8))
    return dict(zip(names, np.exp(found.x[: len(names)]).tolist(), strict=True)) | {
        name: unit[name] * x for name, x in zip(extra, found.x[len(names) :].tolist(), strict=True)
    }


def effective_mass(mechanism: Mechanism, motions: Sequence[Motion], values: Mapping[str, float]) -> float | None:
    """Mass that the contact feels, (dE/da) / J^2, averaged over the trials; None where no inertia takes part."""
    for c in mechanism.free:
        jacobian = mechanism.system.jacobian[c.name]
        if jacobian != 0:
            f = _function(mechanism, sp.diff(mechanism.system.residual(c), c.symbols[2]) / jacobian**2)
            return float(np.mean([np.mean(f(m.signals, values)) for m in motions]))
    return None


def _forces_of_effects(mechanism: Mechanism, free: Sequence[str]) -> dict[str, sp.Expr]:
    """Free strengths of effects -> the force of one unit in terms of the motion alone (no memory, no shape to find)."""
    neutral = {par.symbol: par.neutral for par in mechanism.parameters if par.neutral is not None}
    unknown = {par.symbol for par in mechanism.parameters if par.name in free}
    allowed = {s for c in mechanism.system.moving for s in c.symbols} | {par.symbol for par in mechanism.parameters}
    result = {}
    for par in mechanism.parameters:
        if par.neutral is not None and par.name in free:
            slope = sp.diff(mechanism.friction, par.symbol).xreplace(neutral)
            if slope != 0 and slope.free_symbols <= allowed - unknown:
                result[par.name] = slope
    return result


def _rms(function, stacked: dict[str, np.ndarray], known: Mapping[str, float], name: str) -> float:
    """Root mean square of what a unit of a parameter changes."""
    return float(np.sqrt(np.mean((function(stacked, {**known, name: 1.0}) - function(stacked, known)) ** 2)))


def _guess(name: str, stacked: dict[str, np.ndarray], function, known: Mapping[str, float]) -> float:
    if name not in ("mu_c", "sigma_2"):
        return float(known.get(name, 1.0))
    base = function(stacked, {**known, "mu_c": 0.0, "sigma_2": 0.0})
    slope = function(stacked, {**known, "mu_c": 0.0, "sigma_2": 0.0, name: 1.0}) - base
    value = -float(slope @ base) / max(float(slope @ slope), 1e-300)
    return abs(value) * (1.0 if name == "mu_c" else 0.1)


def _row(model: TrialModel, name: str) -> np.ndarray | None:
    names = list(model.outputs)
    return model.y[names.index(name)] if name in names else None


def _smoothed(data: Sequence[Coordinate], sigmas: Sequence[float | None]) -> list[Smoothed]:
    """Every trial through the spline of least Bayesian information criterion over all of them."""
    best: list[Smoothed] | None = None
    least = np.inf
    for spacing in SPACINGS:
        if spacing > min(len(trial[0]) for trial in data) // 3:
            continue
        smoother = SmoothingSpline(spacing=spacing).fit(data, sigmas)
        fits = [smoother(*trial) for trial in data]
        value, samples = 0.0, 0
        for k in range(3):
            rows = [(t[k + 1] - fit[k]) ** 2 for t, fit in zip(data, fits, strict=True) if t[k + 1] is not None]
            if rows:
                joined = np.concatenate(rows)
                value += np.sum(~np.isnan(joined)) * np.log(np.nanmean(joined) + 1e-300)
                samples += len(joined)
        value += sum(len(trial[0]) // spacing + 5 for trial in data) * np.log(samples)
        if value < least:
            best, least = fits, value
    if best is None:
        smoother = SmoothingSpline(spacing=2).fit(data, sigmas)
        best = [smoother(*trial) for trial in data]
    return best


def _defaults(mechanism: Mechanism) -> dict[str, float]:
    values = {par.name: par.value for par in mechanism.parameters} | mechanism.system.values
    return {name: 1.0 if value is None else value for name, value in values.items()}


def _function(mechanism: Mechanism, expr: sp.Expr):
    """Numerical function (signals, parameters) -> samples of an expression of the motion and the parameters."""
    symbols = {s: n for c in mechanism.system.moving for s, n in zip(c.symbols, c.signals, strict=True)}
    symbols |= {item.symbol: item.name for item in mechanism.system.inputs}
    wanted = [s for s in symbols if s in expr.free_symbols]
    parameters = sorted((s for s in expr.free_symbols if s not in symbols), key=str)
    compiled = sp.lambdify([*wanted, *parameters], expr, modules="numpy", cse=True)

    def function(signals: Mapping[str, np.ndarray], p: Mapping[str, float]) -> np.ndarray:
        n = len(next(iter(signals.values())))
        columns = [signals.get(symbols[s], np.zeros(n)) for s in wanted]
        return np.broadcast_to(np.asarray(compiled(*columns, *(p[str(s)] for s in parameters)), float), (n,))

    return function
