"""Fit what a network is at rest by simulating the training trials with it, against their noisy motion."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares

from ..data.contact import ContactTrial
from ..errors import UserError
from ..numerics.codegen import pointer
from ..numerics.stick_slip import bristle_rollout, static_rollout
from ..numerics.torch_functions import contact_signals
from ..physics import LAWS, System
from ..physics.mechanism import Mechanism
from .base import FrictionModel
from .in_motion import LAW, InMotion, gain, law_values

STEPS = 16  # of the simulation, per sample
SKIP = 8  # samples after a start, whose velocity is known to the noise
SLIDES = 15.0  # times the velocity's noise; slower samples may rest
SHIFT = 0.25  # of a black box, in units of the root mean square velocity
RIDGE = 2e-5  # penalty of its weights over their mean curvature
_SPAN, _EVALUATIONS = 4.0, 100  # natural logarithms to either side of a start; of the least squares
_SCALES = {"slow": 0.05, "fast": 0.05}  # of a step, in natural logarithms
_GRID = (4001, 40)
_FAR = 50.0  # a residual that diverged


@dataclass(frozen=True)
class _Trial:
    """Of one trial: A and N at the steps, force and velocity as measured (their noise kept), the start."""

    A: np.ndarray
    N: np.ndarray
    force: np.ndarray
    slip: np.ndarray
    start: tuple[float, float]


def fit_in_motion(
    model: FrictionModel, system: System, trials: Sequence[ContactTrial], mobility: float
) -> tuple[InMotion, dict[str, Any]]:
    """The model's friction in motion, from the training trials alone.

    The last layer of a black box is first solved again, for the samples that surely slide. Then least squares fits
    the few values of :class:`InMotion`: each trial is simulated from its first sample, and slip velocity and friction
    force (of the force balance, with the acceleration as measured) are compared with the measured, over their noise.

    Args:
        model: trained, of the variants that see slip velocity and normal force alone, and no past.
        system: gives the force balance.
        trials: training trials.
        mobility: slip acceleration per unit of friction force.

    Returns:
        the friction, and what a result holds of it: values, mean square of the residuals, seconds, simulations.

    Raises:
        UserError: another variant, neither velocity nor acceleration measured, or no trial that slides.
    """
    _check(model, mobility)
    begin = time.perf_counter()
    rolled = [_rolled(system, trial) for trial in trials]
    friction = InMotion(model, {}) if model.sees_rates else _per_load(model, trials)
    table, grid = _tabulate(friction, rolled)
    interval = float(np.median(np.diff(trials[0].t)))
    speed = model.scales["velocity"]
    problem = _Problem(table, grid, rolled, _noise(rolled, trials), interval / STEPS, mobility, speed)
    fits = [problem.fit(values, fitted) for values, fitted in _starts(model, friction, mobility)]
    values, cost, _ = min(fits, key=lambda fit: fit[1])
    told = {"values": values, "mean_square": cost, "simulations": sum(fit[2] for fit in fits)}
    return InMotion(model, values, friction.weights), told | {"seconds": round(time.perf_counter() - begin, 3)}


def _check(model: FrictionModel, mobility: float) -> None:
    if set(model.features.inputs) != {"v_slip", "normal_force"} or model.features.length > 1:
        raise UserError(
            "only a network without a past is fitted in motion",
            where="rollout",
            received=f"true with inputs {', '.join(model.features.inputs)}, {model.features.length} samples",
            allowed="inputs v_slip and normal_force, one sample",
            fix="choose model=bb1 or model=pe1, or leave rollout=false",
        )
    if not mobility:
        raise UserError(
            "friction does not move this contact by a constant mobility",
            where="rollout",
            received="true",
            allowed="a system whose slip acceleration falls in proportion to the friction force",
            fix="leave rollout=false",
        )


def _rolled(system: System, trial: ContactTrial) -> _Trial:
    raw = dict(trial.smoothed)
    for c in Mechanism(system, LAWS["coulomb"]()).free:
        raw |= {name: trial.measured[name] for name in c.signals[1:] if name in trial.measured}
    seen = contact_signals(system, raw)
    fine = np.interp(np.arange((len(trial) - 1) * STEPS + 1) / STEPS, np.arange(len(trial)), trial.t)
    A, N = (CubicSpline(trial.t, trial.offline[name])(fine) for name in ("a_frictionless", "normal_force"))
    start = (float(trial.offline["v_slip"][0]), float(trial.offline["friction_force"][0]))
    return _Trial(A, np.abs(N), seen["friction_force"], seen["v_slip"], start)


def _noise(rolled: Sequence[_Trial], trials: Sequence[ContactTrial]) -> tuple[float, float]:
    """Standard deviations of the measured force and slip velocity about the smoothed ones; infinite where derived."""
    found = []
    for name, key in (("force", "friction_force"), ("slip", "v_slip")):
        off = np.concatenate([getattr(a, name) - b.offline[key] for a, b in zip(rolled, trials, strict=True)])
        found.append(float(np.sqrt(np.nanmean(off**2))) or np.inf)
    if not np.isfinite(found).any():
        raise UserError(
            "nothing to compare a simulation with",
            where="rollout",
            received="positions alone",
            allowed="a recording with velocity or acceleration, not smoothed beforehand",
            fix="leave rollout=false",
        )
    return found[0], found[1]


def _per_load(model: FrictionModel, trials: Sequence[ContactTrial]) -> InMotion:
    """A black box whose last layer gives the force per load of the samples that surely slide, by ridge regression.

    Friction in proportion to the load is not penalised, so it holds for pairs of velocity and load that the training
    trials do not have: left to itself the network errs there (another swing, the same speeds: 0.6 N^2).
    """
    v, N, force = (
        np.concatenate([trial.offline[name] for trial in trials])
        for name in ("v_slip", "normal_force", "friction_force")
    )
    shift = SHIFT * model.scales["velocity"]
    values = {"shift": shift, "coulomb": 0.0, "slow": 1.0, "fast": 1.0}
    found = InMotion(model, values)
    slides = np.abs(v) > SLIDES * model.scales["velocity_noise"]
    v, N, force = v[slides], np.abs(N[slides]), force[slides]
    if not len(v):
        raise UserError(
            "no training sample surely slides",
            where="rollout",
            received=f"slip velocities below {SLIDES:g} times their noise",
            allowed="training trials in which the contact slides",
            fix="add such a trial, or leave rollout=false",
        )
    with torch.no_grad():
        hidden = found.model.network.hidden(found.inputs(v + shift * np.sign(v), N)).numpy()
    design = N[:, None] * np.column_stack([hidden, np.sign(v)])
    penalty = np.full(design.shape[1], RIDGE * np.sum(design[:, :-1] ** 2) / hidden.shape[1])
    penalty[-1] = 0.0
    solved = np.linalg.solve(design.T @ design + np.diag(penalty), design.T @ force)
    return InMotion(model, values | {"coulomb": solved[-1]}, torch.from_numpy(solved[:-1]))


def _starts(model: FrictionModel, friction: InMotion, mobility: float) -> list[tuple[dict[str, float], list[str]]]:
    """Values where least squares begins, and which of them it fits.

    A parameter estimator begins at several stiffnesses, since a ringing of another frequency is a minimum of its own.
    """
    speed = model.scales["velocity"]
    if not friction.memory:
        return [(friction.values | {"creep": 0.03 * speed}, ["creep", "slow", "fast"])]
    known, starts = model.physical(), []
    for factor in (0.2, 0.5, 1.0):
        stiffness = factor * known["sigma_0"]
        values = {"shift": 0.05 * speed, "gain": 1.0, "sigma_0": stiffness, "sigma_1": np.sqrt(stiffness / mobility)}
        values |= {"sigma_2": known.get("sigma_2", 0.0), "peak": 0.3, "peak_velocity": 0.01 * speed}
        starts.append((values, [name for name, value in values.items() if value > 0]))
    return starts


def _tabulate(friction: InMotion, rolled: Sequence[_Trial]) -> tuple[np.ndarray, np.ndarray]:
    """The network's force over slip velocity and normal force, wider than the trials go."""
    reach = 1.5 * max(float(np.abs(trial.slip).max()) for trial in rolled)
    low, high = (f(np.concatenate([trial.N for trial in rolled])) for f in (np.min, np.max))
    v, N = np.linspace(-reach, reach, _GRID[0]), np.linspace(0.8 * low, 1.1 * high, _GRID[1])
    slip, load = (column.ravel() for column in np.meshgrid(v, N, indexing="ij"))
    table = np.ascontiguousarray(friction.sliding(slip, load).reshape(_GRID))
    return table, np.array([v[0], v[1] - v[0], N[0], N[1] - N[0]])


@dataclass(frozen=True)
class _Problem:
    """The trials simulated with given values, over what was measured.

    Attributes:
        table, grid: see :func:`_tabulate`.
        noise: of force and slip velocity.
        h: step, s.
        speed: root mean square velocity of the training trials.
    """

    table: np.ndarray
    grid: np.ndarray
    rolled: Sequence[_Trial]
    noise: tuple[float, float]
    h: float
    mobility: float
    speed: float

    def fit(self, start: dict[str, float], fitted: list[str]) -> tuple[dict[str, float], float, int]:
        """Least squares over the logarithms of the fitted values: values, mean square residual, simulations."""
        first = np.array([start[name] for name in fitted])

        def values(x: np.ndarray) -> dict[str, float]:
            return start | dict(zip(fitted, (first * np.exp(x)).tolist(), strict=True))

        found = least_squares(
            lambda x: self.residuals(values(x)), np.zeros(len(fitted)), diff_step=1e-4, max_nfev=_EVALUATIONS,
            x_scale=[_SCALES.get(name, 0.3) for name in fitted], bounds=(-_SPAN, _SPAN),
        )  # fmt: skip
        simulations = (found.nfev + len(fitted) * found.njev) * len(self.rolled)
        return values(found.x), 2 * float(found.cost) / len(found.fun), simulations

    def residuals(self, values: Mapping[str, float]) -> np.ndarray:
        """Force and slip velocity of every trial, each over its noise."""
        found = []
        if "creep" in values:
            v = self.grid[0] + self.grid[1] * np.arange(len(self.table))
            table = gain(values, v / self.speed)[:, None] * self.table
        for trial in self.rolled:
            v0, force0 = trial.start
            known = (self.table, self.grid, trial.A, trial.N, self.h, self.mobility, v0)
            if "creep" in values:
                force, slip = static_rollout(table, *known[1:], values["shift"], values["creep"], STEPS)
            else:
                law = (pointer(LAW.kernels.rate), pointer(LAW.kernels.force))
                p = law_values(values)
                force, slip = bristle_rollout(*law, *known, force0, values["shift"], values["gain"], p, STEPS)
            for simulated, measured, noise in zip((force, slip), (trial.force, trial.slip), self.noise, strict=True):
                found.append(np.clip(np.nan_to_num((simulated - measured)[SKIP:] / noise), -_FAR, _FAR))
        return np.concatenate(found)
