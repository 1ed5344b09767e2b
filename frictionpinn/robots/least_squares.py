"""Least squares of a robot's force balance.

Gauss-Newton on all parameters together, each joint's rows in units of its own residual. Intervals come from fits
without one block of time each (delete-a-group jackknife: Kuensch, Ann. Statist. 17, 1989), since filters, the closed
loop and what the model leaves correlate residuals in time, and are not alike where a joint sticks and where it slides.

Public: :func:`solve` and :class:`Solution`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy.stats import t

from ..numerics.score import inverse_root
from ..physics.base import at_contact, contact_of, plain_name
from .balance import Model
from .motion import Prepared

STEPS, TRIES = 60, 12  # of Gauss-Newton at most, and dampings that each tries
SETTLED, SAME = 1e-7, 1e-3  # relative fall of the cost, and change of the residuals' sizes, that end the search
DAMPING, LEAST = 1e-3, 1e-12  # of Levenberg and Marquardt at first and at least, of a column's own square
BLOCKS = 40  # of time at most: as many tell a variance to a fifth
PERIODS = 4.0  # of the cutoff in a block at least: what passed it is forgotten within one


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
            if static in table and static not in model.free:
                values[name] = min(values[name], values[static])
            elif static in values:
                values[static] = max(values[static], values[name])
    return replace(model, values=values)
