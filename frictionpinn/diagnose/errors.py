"""Error of a model before and after, on trials that no fit saw, beside the noise that no model can explain."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import sympy as sp

from ..physics.system import System
from .bench import Bench
from .excess import Excess, Level
from .fit import Fit
from .floor import APART, NEIGHBOURS, RESIDUAL, levels
from .noise import lone
from .observe import samples

FORCE = "friction_force"


Masks = Sequence[Mapping[str, np.ndarray]]  # of every trial: signal -> which samples, shape (n,)


def left_out(bench: Bench, fit: Fit, sigmas: Mapping[str, float]) -> Masks:
    """Samples of each trial that are taken for outliers, by signal; none where the loss does not expect any.

    No model comes near them, and one in a hundred would hide in the root mean square what the model does. A law without
    memory makes lone residuals itself, where it jumps a sample too late: those count.
    """
    if not (bench.problem.loss.robust and bench.mechanism.memory):
        return [{} for _ in fit.state.pieces]
    return [{n: lone(r, sigmas[n]) for n, r in p.residuals.items() if n in sigmas} for p in fit.state.pieces]


def residuals(bench: Bench, fit: Fit, without: Masks) -> dict[str, list[np.ndarray]]:
    """Signal -> model minus measurement on each trial, shape (n,), SI units, NaN where missing; the force last.

    Inputs whose noise is estimated are among them: a model bends them into what it lacks, and follows the motion then.
    """
    result: dict[str, list[np.ndarray]] = {}
    for model, piece, masks in zip(fit.models, fit.state.pieces, without, strict=True):
        for name in (*bench.problem.channels.outputs, *(n for item in model.inputs for n in item.names)):
            r = piece.residuals.get(name, np.full(len(model.t), np.nan))
            result.setdefault(name, []).append(np.where(masks.get(name, False), np.nan, r))
    result = {name: own for name, own in result.items() if not all(np.isnan(r).all() for r in own)}
    name = next(iter(result)) if bench.mechanism.system.massless else FORCE
    return result | {name: [b - a for a, b in implied_force(bench, fit, without)]}


def rms(own: Sequence[np.ndarray]) -> float:
    """Root mean square over all trials."""
    return float(np.sqrt(np.nanmean(np.concatenate(own) ** 2)))


def implied_force(bench: Bench, fit: Fit, without: Masks) -> list[tuple[np.ndarray, np.ndarray]]:
    """Friction force that each trial's measured motion implies, and the simulated one, shape (n,) each.

    The measured force of a system whose motion is imposed is taken as it is.
    """
    system, pairs = bench.mechanism.system, []
    for model, run, masks in zip(fit.models, bench.simulate(fit), without, strict=True):
        measured = dict(run.signals) | dict(zip(model.outputs, model.y, strict=True))
        measured |= {n: np.where(mask, np.nan, measured[n]) for n, mask in masks.items() if n in model.outputs}
        for item in model.inputs:
            given = dict(zip(item.names, item.y, strict=True))
            measured |= {n: np.where(np.isnan(y), run.signals[n], y) for n, y in given.items()}
            measured |= {n: np.where(masks[n], np.nan, measured[n]) for n in given if n in masks}
        if system.massless:
            name = next(iter(model.outputs))
            pairs.append((measured[name], run.signals[name]))
        else:
            pairs.append((samples(system, replace(run, signals=measured), system.friction_implied), run.F))
    return pairs


def force_floor(bench: Bench, fit: Fit, sigmas: Mapping[str, float]) -> float:
    """Standard deviation that the signals' noise alone gives to the implied force."""
    system = bench.mechanism.system
    if system.massless:
        return float(sigmas[next(iter(fit.models[0].outputs))])
    total, count = 0.0, 0
    table = {n: s for c in system.moving for s, n in zip(c.symbols, c.signals, strict=True)}
    table |= {item.name: item.symbol for item in system.inputs}
    for run in bench.simulate(fit):
        for name, sigma in sigmas.items():
            slope = sp.diff(system.friction_implied, table[name]) if name in table else sp.Integer(0)
            if slope != 0:
                total += float(np.sum((samples(system, run, slope) * sigma) ** 2))
        count += len(run.t)
    return float(np.sqrt(total / max(count, 1)))


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
    for c in system.free:
        if system.jacobian[c.name] != 0 and not system.massless:
            for name in (c.signals[1], c.signals[0], c.signals[2]):
                if name in errors:
                    return name
    return next(iter(errors))


def compare(bench: Bench, before: Fit, after: Fit, sigmas: Mapping[str, float]) -> dict[str, Any]:
    """Errors of two fits on the same trials by signal, and in the implied friction force.

    Args:
        sigmas: levels of the residual as the loss tells them, SI units.

    Returns:
        signal -> entry, SI units; the friction force that the motion implies last. An entry holds quantity and unit;
        before and after, rms errors; noise_floor, noise_from (differences of neighbouring samples, or residual of the
        model) and noise_other (the other of the two where they are far apart, else None); excess_before and
        excess_after {value, ci95}, the errors beyond the noise; block_s, length of a bootstrap's block;
        drop_over_error, the drop of the excess over its standard error. Where there are any also
        outliers_left_out, a number of samples; of the force, where it is that which is predicted, the errors relative
        to the measured one.
    """
    system = bench.mechanism.system
    units = system.signal_units
    sigmas = {name: bench.problem.loss.spread * sigma for name, sigma in sigmas.items()}
    without, noise = left_out(bench, after, sigmas), noises(bench, after, sigmas)
    old, new = (residuals(bench, fit, without) for fit in (before, after))
    times = [model.t for model in after.models]
    result: dict[str, Any] = {}
    the_force = next(iter(old)) if system.massless else FORCE
    for name in old:
        force = name == the_force
        if force:
            what = f"rms error of the {'measured' if system.massless else 'friction'} force"
        elif name in bench.problem.channels.outputs:
            what = f"rms error of {name} in simulation"
        else:
            what = f"rms error of the {name} that the model needs"
        excess = Excess.of(times, (old[name], new[name]), noise[name])
        result[name] = {
            "quantity": what, "unit": system.force_unit if force else units.get(name, ""),
            "before": rms(old[name]), "after": rms(new[name]),
            "noise_floor": noise[name].sigma, "noise_from": noise[name].source, "noise_other": noise[name].other,
            "excess_before": excess.told(0), "excess_after": excess.told(1),
            "block_s": excess.block_s, "drop_over_error": excess.drop_over_error,
        }  # fmt: skip
        count = sum(int(masks[name].sum()) for masks in without if name in masks)
        result[name] |= {"outliers_left_out": count} if count and not force else {}
        if force:
            size = max(rms([a for a, _ in implied_force(bench, before, without)]), 1e-300)
            relative = {key: result[name][key] / size for key in ("before", "after", "noise_floor")}
            result[name]["relative"] = relative
    return result


def along(bench: Bench, fits: Sequence[Fit], sigmas: Mapping[str, float], name: str) -> Excess:
    """Error beyond the noise of a signal for models on the same trials, as :func:`compare` tells it of two."""
    sigmas = {key: bench.problem.loss.spread * sigma for key, sigma in sigmas.items()}
    without = left_out(bench, fits[-1], sigmas)
    own = [residuals(bench, fit, without)[name] for fit in fits]
    return Excess.of([model.t for model in fits[-1].models], own, noises(bench, fits[-1], sigmas)[name])


def noises(bench: Bench, fit: Fit, sigmas: Mapping[str, float]) -> dict[str, Level]:
    """Noise of every signal and of the implied force; ``sigmas`` as standard deviations."""
    result = levels(bench, sigmas)
    sure = [n.source for n in result.values()]
    worst = max((n.error for n in result.values()), default=0.0)
    source = NEIGHBOURS if sure and set(sure) == {NEIGHBOURS} else RESIDUAL
    if not bench.mechanism.system.massless:
        sigma = force_floor(bench, fit, {name: n.sigma for name, n in result.items()})
        other = force_floor(bench, fit, {name: n.other or n.sigma for name, n in result.items()})
        far = other > 0 and not 1 / APART < sigma / other < APART
        result[FORCE] = Level(sigma, worst, source, other if far else None)
    return result
