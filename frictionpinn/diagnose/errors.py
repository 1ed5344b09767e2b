"""Error of models beside the noise that no model can explain, with intervals.

A signal's error beyond the noise is e = sqrt(max(0, mean r^2 - sigma^2)), r its residuals and sigma its noise: where
noise is most of the error, the error itself hardly moves. The 95 % interval of e is that of a circular block bootstrap
(Politis and Romano 1992): blocks of several correlation times of the residual, drawn over all trials, the same for all
models that are compared; sigma is drawn along with its own standard error.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import sympy as sp

from ..errors import UserError
from ..identify.trial import TrialModel
from ..numerics.smoothing import difference_sigma
from ..physics.system import System
from .bench import Bench
from .candidates import samples, signal_symbols
from .fit import Fit
from .noise import lone

FORCE = "friction_force"
NEIGHBOURS, RESIDUAL = "differences of neighbouring samples", "residual of the model"
MOVES = 1.15  # times the residual: differences above it show motion between samples, not noise
APART = 1.5  # factor from which both levels are told: the noise is correlated in time, or the model is far off
# Standard error of a level, relative to it, times sqrt(samples): of a median of differences (simulated), of an rms.
STATISTICAL = {NEIGHBOURS: 1.6, RESIDUAL: 0.71}
DRAWS = 1000  # of the bootstrap: 25 beyond either end of a 95 % interval
TIMES = 3.0  # correlation times of the residual in a block: one block then tells little of the next
SMOOTH = 5  # lags over which an autocorrelation is averaged: single ones are noise
FEW = 10  # samples in a block at least, where the residual is white
MANY = 6.0  # blocks in all trials together at least: fewer make no distribution
FADED = 0.05  # autocorrelation below which a residual counts as uncorrelated

Masks = Sequence[Mapping[str, np.ndarray]]  # of every trial: signal -> which samples are outliers, shape (n,)


def compare(
    bench: Bench, fits: Sequence[Fit], sigmas: Mapping[str, float]
) -> tuple[dict[str, dict[str, Any]], dict[str, Excess]]:
    """Errors of fits on the same trials by signal, and in the friction forces that the motion implies (last).

    Args:
        fits: the declared model first, the augmented one last.
        sigmas: levels of the residual as the loss tells them, SI units.

    Returns:
        signal -> entry, SI units, and signal -> errors beyond the noise of all fits. An entry holds quantity and unit;
        before and after, rms errors of the first fit and the last; noise_floor, noise_from (differences of neighbouring
        samples, or residual of the model) and noise_other (the other of the two where they are far apart, else None);
        excess_before and excess_after {value, ci95}, the errors beyond the noise; block_s, length of a bootstrap's
        block; drop_over_error, the drop of the excess over its standard error. Where there are any also
        outliers_left_out, a number of samples; of the force, where it is that which is predicted, the errors relative
        to the measured one.
    """
    system = bench.mechanism.system
    sigmas = {name: bench.problem.loss.spread * sigma for name, sigma in sigmas.items()}
    outliers, noise = find_outliers(bench, fits[-1], sigmas), noise_levels(bench, fits[-1], sigmas)
    forces = [implied_forces(bench, fit, outliers) for fit in fits]
    tables = [residuals(bench, fit, outliers) for fit in fits]
    for table, implied in zip(tables, forces, strict=True):
        table |= {name: [simulated - measured for measured, simulated in pairs] for name, pairs in implied.items()}
    entries: dict[str, dict[str, Any]] = {}
    excesses: dict[str, Excess] = {}
    for name in tables[0]:
        if name in forces[0]:
            at = "" if system.massless else name.removesuffix(FORCE).removesuffix(".")
            what, unit = f"the {'measured' if system.massless else 'friction'} force", system.at(at).force_unit
            what += f" of the {at}" if at else ""
        else:
            predicted = name in bench.problem.channels.outputs
            what = f"{name} in simulation" if predicted else f"the {name} that the model needs"
            unit = system.signal_units.get(name, "")
        level, own = noise[name], [table[name] for table in tables]
        excess = excesses[name] = Excess.of([model.t for model in fits[-1].models], own, level)
        entry = entries[name] = {
            "quantity": f"rms error of {what}", "unit": unit, "before": rms(own[0]), "after": rms(own[-1]),
            "noise_floor": level.sigma, "noise_from": level.source, "noise_other": level.other,
            "excess_before": excess.told(0), "excess_after": excess.told(-1),
            "block_s": excess.block_s, "drop_over_error": excess.drop_over_error,
        }  # fmt: skip
        count = sum(int(masks[name].sum()) for masks in outliers if name in masks)
        if name in forces[0]:
            measured = max(rms([measured for measured, _ in forces[0][name]]), 1e-300)
            entry["relative"] = {key: entry[key] / measured for key in ("before", "after", "noise_floor")}
        elif count:
            entry["outliers_left_out"] = count
    return entries, excesses


def main_signal(system: System, errors: Mapping[str, Any]) -> str:
    """The signal by which errors are quoted first.

    That whose error beyond the noise drops most, relative to the drop's standard error; where none drops, that with
    most error beyond the noise for certain; where none has any, the slip velocity, else whatever of it is measured.
    """
    drops = {name: e["drop_over_error"] for name, e in errors.items()}
    certain = {name: e["excess_before"]["ci95"][0] / max(e["noise_floor"], 1e-300) for name, e in errors.items()}
    for table in (drops, certain):
        best = max(table, key=table.__getitem__)
        if table[best] > 0:
            return best
    slipping = [] if system.massless else [c for c in system.free if any(v.jacobian[c.name] != 0 for v in system.each)]
    measured = [c.signals[order] for c in slipping for order in (1, 0, 2) if c.signals[order] in errors]
    return measured[0] if measured else next(iter(errors))


def find_outliers(bench: Bench, fit: Fit, sigmas: Mapping[str, float]) -> Masks:
    """Samples of each trial that are taken for outliers, by signal; none where the loss does not expect any.

    No model comes near them, and one in a hundred would hide in the root mean square what the model does. A law without
    memory makes lone residuals itself, where it jumps a sample too late: those count.
    """
    if not (bench.problem.loss.robust and bench.mechanism.memory):
        return [{} for _ in fit.state.pieces]
    return [{n: lone(r, sigmas[n]) for n, r in p.residuals.items() if n in sigmas} for p in fit.state.pieces]


def residuals(bench: Bench, fit: Fit, outliers: Masks) -> dict[str, list[np.ndarray]]:
    """Signal -> model minus measurement on each trial, shape (n,), SI units, NaN where missing.

    Inputs whose noise is estimated are among them: a model bends them into what it lacks, and follows the motion then.
    """
    result: dict[str, list[np.ndarray]] = {}
    for model, piece, masks in zip(fit.models, fit.state.pieces, outliers, strict=True):
        for name in (*bench.problem.channels.outputs, *(n for item in model.inputs for n in item.names)):
            r = piece.residuals.get(name, np.full(len(model.t), np.nan))
            result.setdefault(name, []).append(np.where(masks.get(name, False), np.nan, r))
    return {name: own for name, own in result.items() if not all(np.isnan(r).all() for r in own)}


def rms(own: Sequence[np.ndarray]) -> float:
    """Root mean square over all trials."""
    return float(np.sqrt(np.nanmean(np.concatenate(own) ** 2)))


def frictions(system: System) -> dict[str, tuple[System, sp.Expr]]:
    """Name of a friction force -> the system as its contact sees it, and the force that the motion implies there.

    None where fewer equations than contacts hold one.
    """
    with suppress(UserError):
        return {f"{at.contacts[0].name}.{FORCE}".lstrip("."): (at, at.friction_implied) for at in system.each}
    return {}


def implied_forces(bench: Bench, fit: Fit, outliers: Masks) -> dict[str, list[tuple[np.ndarray, np.ndarray]]]:
    """Friction forces that each trial's measured motion implies, by name, and the simulated ones, shape (n,) each.

    The measured force of a system whose motion is imposed is taken as it is.
    """
    system = bench.mechanism.system
    result: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {}
    for model, run, masks in zip(fit.models, bench.simulate(fit), outliers, strict=True):
        measured = dict(run.signals)
        for name, y in measured_signals(model).items():
            y = y if name in model.outputs else np.where(np.isnan(y), run.signals[name], y)
            measured[name] = np.where(masks.get(name, False), np.nan, y)
        if system.massless:
            ((name, key), *_) = model.outputs.items()
            result.setdefault(name, []).append((measured[name], run.F if key == "F" else run.signals[key]))
            continue
        for name, (at, force) in frictions(system).items():
            pair = samples(at, replace(run, signals=measured), force), run.at(at.contacts[0].name).F
            result.setdefault(name, []).append(pair)
    return result


def measured_signals(model: TrialModel) -> dict[str, np.ndarray]:
    """Measured outputs and inputs of a trial, shape (n,) each, NaN where missing."""
    inputs = {name: y for item in model.inputs for name, y in zip(item.names, item.y, strict=True)}
    return dict(zip(model.outputs, model.y, strict=True)) | inputs


@dataclass(frozen=True)
class Level:
    """Noise of a signal.

    Attributes:
        sigma: standard deviation, in the signal's unit.
        error: its standard error relative to it.
        source: NEIGHBOURS or RESIDUAL.
        other: what the other of the two says, where it is far from sigma.
    """

    sigma: float
    error: float
    source: str
    other: float | None = None


def noise_levels(bench: Bench, fit: Fit, sigmas: Mapping[str, float]) -> dict[str, Level]:
    """Noise of every signal over all trials, fitted and held out, and of the forces that the motion implies.

    Args:
        sigmas: standard deviations of the model's residual with everything explained that a candidate or a variable
            can, SI units.
    """
    trials = [*bench.problem.trials, *(bench.checked.trials if bench.checked is not None else ())]
    measured = [(model.t, measured_signals(model)) for model in trials]
    result = {n: noise_level([(t, own[n]) for t, own in measured if n in own], sigma) for n, sigma in sigmas.items()}
    system = bench.mechanism.system
    if system.massless:
        return result
    source = NEIGHBOURS if {r.source for r in result.values()} == {NEIGHBOURS} else RESIDUAL
    worst = max((r.error for r in result.values()), default=0.0)
    runs, forces = bench.simulate(fit), dict[str, Level]()
    for name, (at, force) in frictions(system).items():
        implied = {n: sp.diff(force, s) for n, s in signal_symbols(system).items() if n in result}
        slopes = {n: rms([samples(at, run, slope) for run in runs]) for n, slope in implied.items() if slope != 0}
        own = float(np.linalg.norm([slope * result[n].sigma for n, slope in slopes.items()]))
        other = float(np.linalg.norm([slope * (result[n].other or result[n].sigma) for n, slope in slopes.items()]))
        forces[name] = Level(own, worst, source, _if_apart(own, other))
    return result | forces


def noise_level(measured: Sequence[tuple[np.ndarray, np.ndarray]], residual: float) -> Level:
    """Noise of one signal from pairs (t, y) of shape (n,), NaN where missing, and the level of its residual.

    A model that is far off leaves a residual much larger than the noise; what a sample differs by from its neighbours,
    cubics cancelled, does not depend on any model. The residual counts only where the signal itself moves faster than
    it was sampled. Steps of an encoder, values taken again and again, are noise of a twelfth of their square.
    """
    y = np.concatenate([np.zeros(0), *(y[~np.isnan(y)] for _, y in measured)])
    values = np.unique(y)
    step = float(np.median(np.diff(values))) if 1 < len(values) < len(y) / 2 else 0.0
    near = max(difference_sigma(measured), step / np.sqrt(12))
    source = NEIGHBOURS if 0 < near < MOVES * residual else RESIDUAL
    own, other = (near, residual) if source == NEIGHBOURS else (residual, near)
    return Level(own, STATISTICAL[source] / np.sqrt(max(len(y), 1)), source, _if_apart(own, other))


def _if_apart(own: float, other: float) -> float | None:
    return other if other > 0 and not 1 / APART < own / other < APART else None


@dataclass(frozen=True)
class Excess:
    """Squared errors beyond the noise of k models, the declared one first, on the same samples.

    Attributes:
        squared: max(0, mean r^2 - sigma^2), shape (k,).
        drawn: the same of every bootstrap draw, the noise level drawn along, shape (draws, k).
        fixed: the same at the noise level as told, shape (draws, k).
        block_s: length of a block, s.
    """

    squared: np.ndarray
    drawn: np.ndarray
    fixed: np.ndarray
    block_s: float

    @classmethod
    def of(cls, t: Sequence[np.ndarray], residuals: Sequence[Sequence[np.ndarray]], level: Level) -> Excess:
        """From the residuals of each model on each trial, shape (n,), NaN where missing; t the trials' times, s."""
        block, floor = block_length(t, residuals[0]), level.sigma**2
        squares = [np.stack(own, axis=1) ** 2 for own in zip(*residuals, strict=True)]
        means = block_means(squares, [max(1, round(block / max(_interval([x]), 1e-300))) for x in t])
        luck = 1 + level.error * np.random.default_rng(1).standard_normal((len(means), 1))
        mean = np.nanmean(np.concatenate(squares), axis=0)
        squared, drawn, fixed = (np.maximum(x, 0.0) for x in (mean - floor, means - floor * luck**2, means - floor))
        return cls(squared, drawn, fixed, block)

    def told(self, k: int) -> dict[str, Any]:
        """Error beyond the noise of model k in the signal's unit, with its 95 % interval."""
        return {"value": float(np.sqrt(self.squared[k])), "ci95": _ci95(np.sqrt(self.drawn[:, k]))}

    @property
    def drop_over_error(self) -> float:
        """Drop of the error beyond the noise from the first model to the last, over its standard error."""
        drop = float(np.sqrt(self.squared[0]) - np.sqrt(self.squared[-1]))
        spread = float(np.std(np.sqrt(self.drawn[:, 0]) - np.sqrt(self.drawn[:, -1])))
        return drop / spread if spread > 0 else 0.0

    def share(self, k: int) -> dict[str, Any]:
        """What model k takes off beyond model k - 1, relative to the first's squared excess; k = 0: what is left."""
        if self.squared[0] <= 0:
            return {"value": None, "ci95": [None, None]}
        drawn = self.fixed[self.fixed[:, 0] > 0]
        value, draws = (x[..., -1] if k == 0 else x[..., k - 1] - x[..., k] for x in (self.squared, drawn))
        return {"value": float(value / self.squared[0]), "ci95": _ci95(draws / drawn[:, 0])}


def block_length(t: Sequence[np.ndarray], residuals: Sequence[np.ndarray]) -> float:
    """Length of a block, s: long against the residual's correlation time, and short against the recording.

    The correlation time is that after which the autocorrelation has faded, not its integral: of a slow error in much
    white noise that is short.

    Args:
        t, residuals: of each trial, shape (n,), NaN where missing.
    """
    length = max(len(r) for r in residuals)
    products = np.zeros(length)
    for r in residuals:
        spectrum = np.abs(np.fft.rfft(np.nan_to_num(r), 2 * len(r))) ** 2
        products[: len(r)] += np.fft.irfft(spectrum)[: len(r)]
    correlated = 0
    if products[0] > 0 and length > SMOOTH:
        rho = np.convolve(products[1:] / products[0], np.ones(SMOOTH) / SMOOTH, "valid")
        faded = np.flatnonzero(rho < FADED)
        correlated = 1 + int(faded[0]) if len(faded) else length
    return min(max(TIMES * correlated, FEW) * _interval(t), sum(float(x[-1] - x[0]) for x in t) / MANY)


def block_means(squares: Sequence[np.ndarray], spans: Sequence[int]) -> np.ndarray:
    """Means over samples of blocks drawn with replacement, shape (DRAWS, k).

    Args:
        squares: of each trial, shape (n, k), NaN where missing: k models on the same samples.
        spans: samples in a block of each trial.
    """
    sums = []  # over every block of a trial, which goes on at its start: of the squares, and of the samples there are
    for y, span in zip(squares, spans, strict=True):
        size = min(max(span, 1), len(y))
        both = np.stack([np.nan_to_num(y), ~np.isnan(y)])
        total = np.cumsum(np.concatenate([np.zeros_like(both[:, :1]), both, both[:, : size - 1]], axis=1), axis=1)
        sums.append(total[:, size:] - total[:, :-size])
    S, N = np.concatenate(sums, axis=1)
    blocks = max(1, round(len(S) / float(np.mean(spans))))
    at = np.random.default_rng(0).integers(len(S), size=(DRAWS, blocks))
    return S[at].sum(axis=1) / np.maximum(N[at].sum(axis=1), 1.0)


def _interval(t: Sequence[np.ndarray]) -> float:
    return float(np.median(np.concatenate([np.diff(x) for x in t])))


def _ci95(values: np.ndarray) -> list[float]:
    return [float(x) for x in np.quantile(values, [0.025, 0.975])]
