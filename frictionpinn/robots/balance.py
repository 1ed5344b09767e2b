"""The force balance of a robot, and its least squares.

    tau_i = (1 + gain_i) m_i + sum_j coupling_ij m_j,   m_i = Y_i beta + I_i a_i + F_i(v_i, load_i, z_i) + ...,
    load_i = Y_i beta,

at every instant, filtered. beta are the base parameters, which all joints share; F_i is the friction of joint i, a law
and effects as everywhere else, along the recorded motion; load_i, the torque that the gear transmits, moves with beta,
and so do its derivatives. Further terms act on the robot as a whole (:mod:`.whole`).

Gauss-Newton on all parameters together, each joint's rows in units of its own residual. Intervals come from fits
without one block of time each (delete-a-group jackknife: Kuensch, Ann. Statist. 17, 1989), since filters, the closed
loop and what the model leaves correlate residuals in time, and are not alike where a joint sticks and where it slides.

Public: :class:`Model` (the terms and their values), :func:`solve` and :class:`Solution`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.stats import t

from ..numerics.imposed import ImposedFriction
from ..numerics.score import inverse_root
from ..physics import FrictionLaw
from ..physics.base import Parameter, at_contact, contact_of, plain_name
from ..physics.effect import Effect
from ..physics.mechanism import Mechanism
from ..physics.robot import Base, Robot
from ..physics.robot_joint import RobotJoint
from .motion import Prepared
from .whole import Whole

STEPS, TRIES = 60, 12  # of Gauss-Newton at most, and dampings that each tries
SETTLED, SAME = 1e-7, 1e-3  # relative fall of the cost, and change of the residuals' sizes, that end the search
DAMPING, LEAST = 1e-3, 1e-12  # of Levenberg and Marquardt at first and at least, of a column's own square
BLOCKS = 40  # of time at most: as many tell a variance to a fifth
PERIODS = 4.0  # of the cutoff in a block at least: what passed it is forgotten within one
WIDTH = 1.5  # standard deviation of a logarithm's prior about the start: a factor of 20 either way in 95 %


@lru_cache(maxsize=512)
def friction_of(law: FrictionLaw, effects: tuple[Effect, ...], turns: bool) -> ImposedFriction:
    """Friction of a joint with these effects along a motion."""
    return ImposedFriction(Mechanism(RobotJoint(turns), law, effects))


@dataclass(frozen=True)
class Model:
    """What acts on a robot.

    Attributes:
        robot, base: its rigid bodies.
        laws: friction law of each joint.
        effects: of each joint, beside its law.
        whole: effects on the robot as a whole.
        values: parameter -> value, SI units: ``joint_2.mu_c``, ``inertia.<base parameter>``, ``armature.joint_2``.
        free: names that are estimated.
        priors: of those that have one, centre and standard deviation: of the logarithm where that is searched.
    """

    robot: Robot
    base: Base
    laws: tuple[FrictionLaw, ...]
    effects: tuple[tuple[Effect, ...], ...]
    whole: tuple[Whole, ...] = ()
    values: Mapping[str, float] = field(default_factory=dict)
    free: tuple[str, ...] = ()
    priors: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the joints."""
        return tuple(f"joint_{k + 1}" for k in range(len(self.robot.joints)))

    def friction(self, k: int) -> ImposedFriction:
        """Friction of a joint."""
        return friction_of(self.laws[k], self.effects[k], bool(self.robot.turns[k]))

    def parameters(self, k: int) -> dict[str, Parameter]:
        """Parameters of a joint's friction by their full names."""
        table = self.friction(k).mechanism.parameters
        return {at_contact(self.names[k], par.name): par for par in table}

    @cached_property
    def logarithmic(self) -> frozenset[str]:
        """Stiffnesses, speeds and lengths, never 0 and of unknown size: searched by their logarithm."""
        return frozenset(n for k in range(len(self.names)) for n, par in self.parameters(k).items() if par.low > 0)

    def held_near(self) -> Model:
        """The model with a weak prior about where they are now for free parameters of unknown size that have none."""
        priors = {n: (float(np.log(self.values[n])), WIDTH) for n in self.free if n in self.logarithmic}
        return replace(self, priors={**priors, **self.priors})

    def own_values(self, k: int, values: Mapping[str, float] | None = None) -> list[float]:
        """Values of a joint's friction, in its order."""
        values = self.values if values is None else values
        return [float(values[at_contact(self.names[k], name)]) for name in self.friction(k).names]

    @property
    def beta(self) -> np.ndarray:
        """Base parameters."""
        return np.array([self.values[f"inertia.{name}"] for name in self.base.names])

    def with_values(self, **values: float) -> Model:
        """A copy with other values."""
        return replace(self, values={**self.values, **values})

    def loads(self, trial: Prepared) -> np.ndarray:
        """Torques that the joints transmit, N m, shape (n, joints): of the bodies, payload and tilt included."""
        load = trial.Y @ self.beta
        for w in self.whole:
            load = load + w.load(self, trial)
        return load

    def motion(self, trial: Prepared, k: int, load: np.ndarray) -> dict[str, np.ndarray]:
        """What a joint's friction sees."""
        seen = {"t": trial.t, "session": trial.session, "q": trial.q[:, k], "v": trial.v[:, k], "a": trial.a[:, k]}
        seen["load"] = load[:, k]
        if trial.covariate is not None:
            seen["covariate"] = trial.covariate[:, k]
        return seen

    def torques(self, trial: Prepared) -> tuple[np.ndarray, np.ndarray]:
        """Torques m of bodies and friction together, and of friction alone, shape (n, joints)."""
        load = self.loads(trial)
        friction = np.stack(
            [self.friction(k).force(self.motion(trial, k, load), self.own_values(k)) for k in range(len(self.names))],
            axis=1,
        )
        armature = np.array([self.values[f"armature.{name}"] for name in self.names])
        return load + armature * trial.a + friction, friction

    def recorded(self, trial: Prepared) -> np.ndarray:
        """What the torques' channels show, filtered, shape (m, joints)."""
        shown = self.torques(trial)[0]
        for w in self.whole:
            shown = w.shown(self, trial, shown)
        return trial.filtered(shown)

    def columns(self, trial: Prepared, names: Sequence[str]) -> np.ndarray:
        """Derivatives of what is recorded in parameters, shape (m, joints, names)."""
        load, wanted = self.loads(trial), {name: c for c, name in enumerate(names)}
        result = np.zeros((len(trial.tau), len(self.names), len(names)))
        bodies = [(wanted[f"inertia.{n}"], j) for j, n in enumerate(self.base.names) if f"inertia.{n}" in wanted]
        at, of = (np.array(x, int) for x in zip(*bodies, strict=True)) if bodies else (np.zeros(0, int),) * 2
        slopes = np.zeros_like(load)  # d F / d load
        for k, joint in enumerate(self.names):
            f, motion, values = self.friction(k), self.motion(trial, k, load), self.own_values(k)
            own = [n for n in names if contact_of(n) == joint and plain_name(n) in f.names]
            made = [f.columns(motion, values, [plain_name(n) for n in own])]
            places = [wanted[n] for n in own]
            if (armature := f"armature.{joint}") in wanted:
                made.append(trial.a[:, k : k + 1])
                places.append(wanted[armature])
            if any("load" in e.name for e in self.effects[k]):
                size = 1e-4 * max(float(np.sqrt(np.mean(load[:, k] ** 2))), 1e-6)
                slopes[:, k] = f.by_signal(motion, values, "load", size)
                result[:, k, at] = trial.filtered(slopes[:, k, None] * trial.Y[:, k, of])
            result[:, k, places] = trial.filtered(np.concatenate(made, axis=1))
        result[:, :, at] += trial.Y_filtered[:, :, of]
        for w in self.whole:
            for name in w.parameters:
                if name in wanted:
                    result[:, :, wanted[name]] = trial.filtered(w.column(self, trial, name, 1 + slopes))
        # Of the channels' effects those mix torques of one instant, and so filtered ones alike.
        for w in self.whole:
            others = [c for name, c in wanted.items() if name not in w.parameters or not w.at_the_channel]
            result[:, :, others] = w.shown_change(self, trial, result[:, :, others])
        return result


def as_text(model: Model) -> dict[str, Any]:
    """A model as plain types: laws and effects of each joint by name, effects on the robot, all values."""
    return {
        "friction": {name: law.name for name, law in zip(model.names, model.laws, strict=True)},
        "effects": {name: [e.name for e in effects] for name, effects in zip(model.names, model.effects, strict=True)},
        "whole": [w.name for w in model.whole],
        "values": {name: float(value) for name, value in model.values.items()},
        "free": list(model.free),
    }


@dataclass(frozen=True)
class Solution:
    """A fitted model.

    Attributes:
        model: with its values.
        trials: that it was fitted to.
        residuals: model minus measurement of each trial, N m, shape (m, joints).
        sigmas: their root mean square of each joint, N m.
        columns: derivatives of each trial in the free parameters, as they were searched, in units of sigma.
        scale: d parameter / d searched, shape (free,): 1, or the value itself where its logarithm is searched.
        prior: precision of the prior by free parameter.
        converged: whether the search ended by itself.
    """

    model: Model
    trials: tuple[Prepared, ...]
    residuals: tuple[np.ndarray, ...]
    sigmas: np.ndarray
    columns: tuple[np.ndarray, ...]
    scale: np.ndarray
    prior: np.ndarray
    converged: bool

    @property
    def cost(self) -> float:
        """Negative log-likelihood up to a constant, residuals taken as white, sizes at their estimates."""
        return float(sum(len(r) for r in self.residuals) * np.log(self.sigmas).sum())

    @cached_property
    def precision(self) -> np.ndarray:
        """A: C'C and the prior, shape (free, free)."""
        return sum(np.einsum("mjc,mjd->cd", c, c, optimize=True) for c in self.columns) + np.diag(self.prior)

    @cached_property
    def blocks(self) -> list[slice]:
        """Blocks of time of all trials in a row, see :func:`blocks_of`."""
        return blocks_of(self.trials)

    @cached_property
    def covariance(self) -> np.ndarray:
        """Of the searched parameters, from fits without one block of time each, shape (free, free).

        Residuals are correlated in time, and large where a joint sticks: both are as they are within a block.
        """
        C, r = np.concatenate(self.columns), np.concatenate(self.residuals) / self.sigmas
        H, steps = inverse_root(self.precision), []
        C = (C.reshape(-1, C.shape[2]) @ H).reshape(*C.shape[:2], -1)
        for own in self.blocks:
            rows = C[own].reshape(-1, C.shape[2])
            left = inverse_root(np.eye(C.shape[2]) - rows.T @ rows)
            steps.append(left @ (left.T @ (rows.T @ r[own].ravel())))
        apart, count = np.array(steps) - np.mean(steps, axis=0), len(steps)
        middle = (count - 1) / count * apart.T @ apart + H.T @ np.diag(self.prior) @ H
        return H @ middle @ H.T

    @cached_property
    def errors(self) -> dict[str, float]:
        """Standard error of each free parameter, as it is searched (of a logarithm: relative)."""
        return dict(zip(self.model.free, np.sqrt(np.maximum(np.diag(self.covariance), 0)), strict=True))

    def without(self, names: Sequence[str]) -> Solution:
        """The fit with strengths at 0 and all else where it is, to first order: not a fit without them."""
        gone = np.array([n in names for n in self.model.free])
        move = -np.array([self.model.values[n] for n in self.model.free])[gone] / self.scale[gone]
        residuals = tuple(r + self.sigmas * (c[:, :, gone] @ move)
                          for r, c in zip(self.residuals, self.columns, strict=True))  # fmt: skip
        model = replace(self.model, values={**self.model.values, **dict.fromkeys(names, 0.0)},
                        free=tuple(n for n in self.model.free if n not in names))  # fmt: skip
        return replace(self, model=model, residuals=residuals, columns=tuple(c[:, :, ~gone] for c in self.columns),
                       scale=self.scale[~gone], prior=self.prior[~gone])  # fmt: skip

    def interval(self, name: str, level: float = 0.95) -> tuple[float, float]:
        """Interval of a parameter, SI units: of Student's distribution, as its error is told by few blocks."""
        value = self.model.values[name]
        if name not in self.errors:
            return value, value
        reach = float(t.ppf((1 + level) / 2, len(self.blocks) - 1)) * self.errors[name]
        if name in self.model.logarithmic:
            return value * float(np.exp(-min(reach, 50))), value * float(np.exp(min(reach, 50)))
        return value - reach, value + reach

    def told(self, name: str) -> bool:
        """Whether the recording tells a parameter: more than half of what its prior left open."""
        return bool(self.errors.get(name, np.inf) < 0.5 * self.model.priors.get(name, (0.0, np.inf))[1])


def blocks_of(trials: Sequence[Prepared]) -> list[slice]:
    """Blocks of time of the compared samples of all trials in a row, none of two trials."""
    times = [trial.compared for trial in trials]
    total, blocks, first = sum(float(t[-1] - t[0]) for t in times), [], 0
    length = max(PERIODS / min(trial.cutoff_hz for trial in trials), total / BLOCKS)
    for own in times:
        count = max(round(float(own[-1] - own[0]) / length), 2)
        edges = first + np.linspace(0, len(own), count + 1).round().astype(int)
        blocks += [slice(int(a), int(b)) for a, b in pairwise(edges)]
        first += len(own)
    return blocks


def solve(model: Model, trials: Sequence[Prepared], start_sigmas: np.ndarray | None = None) -> Solution:
    """Least squares of a model's free parameters on trials.

    The residual's size of each joint, which weighs its rows, is estimated along (iteratively reweighted).
    """
    trials, sigmas = tuple(trials), start_sigmas
    prior = np.array([model.priors[n][1] ** -2 if n in model.priors else 0.0 for n in model.free])
    residuals = [model.recorded(trial) - trial.tau for trial in trials]
    sigmas = _sizes(residuals) if sigmas is None else sigmas
    damping, converged = DAMPING, False
    for _ in range(STEPS):
        scale = _scale(model)
        columns = [model.columns(trial, model.free) * scale / sigmas[:, None] for trial in trials]
        A = sum(np.einsum("mjc,mjd->cd", c, c, optimize=True) for c in columns) + np.diag(prior)
        b = sum(np.einsum("mjc,mj->c", c, r / sigmas, optimize=True) for c, r in zip(columns, residuals, strict=True))
        b = b + prior * away(model)
        now, moved = _cost(model, residuals, sigmas), None
        for _ in range(TRIES):
            H = inverse_root(A + damping * np.diag(np.diag(A)))
            candidate = _moved(model, -H @ (H.T @ b))
            tried = [candidate.recorded(trial) - trial.tau for trial in trials]
            after = _cost(candidate, tried, sigmas)
            if after <= now:
                moved = candidate
                break
            damping *= 10
        if moved is None:  # no direction lowers it
            converged = True
            break
        damping = max(damping / 10, LEAST)
        model, residuals, before = moved, tried, sigmas
        sigmas = _sizes(residuals)
        if now - after < SETTLED * now and np.all(np.abs(sigmas / before - 1) < SAME):
            converged = True
            break
    scale = _scale(model)
    final = tuple(model.columns(trial, model.free) * scale / sigmas[:, None] for trial in trials)
    return Solution(model, trials, tuple(residuals), sigmas, final, scale, prior, converged)


def _scale(model: Model) -> np.ndarray:
    """d parameter / d searched, shape (free,)."""
    return np.array([model.values[n] if n in model.logarithmic else 1.0 for n in model.free])


def away(model: Model) -> np.ndarray:
    """Searched parameters less the centres of their priors, shape (free,)."""
    searched = [np.log(model.values[n]) if n in model.logarithmic else model.values[n] for n in model.free]
    return np.array(
        [x - model.priors[n][0] if n in model.priors else 0.0 for n, x in zip(model.free, searched, strict=True)]
    )


def _cost(model: Model, residuals: Sequence[np.ndarray], sigmas: np.ndarray) -> float:
    deviations = np.array([model.priors[n][1] if n in model.priors else np.inf for n in model.free])
    squares = sum(float(np.sum((r / sigmas) ** 2)) for r in residuals)
    return 0.5 * squares + 0.5 * float(np.sum((away(model) / deviations) ** 2))


def _sizes(residuals: Sequence[np.ndarray]) -> np.ndarray:
    return np.maximum(np.sqrt(np.mean(np.concatenate(residuals) ** 2, axis=0)), 1e-12)


def _moved(model: Model, step: np.ndarray) -> Model:
    """The model with its free parameters moved, inside their limits; a static coefficient not below the Coulomb one."""
    table = {n: par for k in range(len(model.names)) for n, par in model.parameters(k).items()}
    values = dict(model.values)
    for name, d in zip(model.free, step, strict=True):
        if name in model.logarithmic:
            values[name] *= float(np.exp(np.clip(d, -1.0, 1.0)))
        else:
            values[name] += float(d)
        if name in table:
            values[name] = float(np.clip(values[name], table[name].low, table[name].high))
    for name in model.free:
        if plain_name(name) == "mu_c":
            values[name] = max(values[name], 1e-6)
            static = at_contact(contact_of(name), "mu_s")
            if static in values:
                values[static] = max(values[static], values[name])
    return replace(model, values=values)
