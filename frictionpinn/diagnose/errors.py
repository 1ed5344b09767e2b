"""Error of a model before and after, on trials that no fit saw, beside the noise that no model can explain."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import sympy as sp

from ..physics.system import System
from .bench import Bench
from .fit import Fit
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


def signal_rms(fit: Fit, without: Masks) -> dict[str, float]:
    """Root-mean-square distance of model and measurement by signal, SI units, all trials together."""
    squares: dict[str, list[np.ndarray]] = {}
    for piece, masks in zip(fit.state.pieces, without, strict=True):
        for name, r in piece.residuals.items():
            squares.setdefault(name, []).append(np.where(masks.get(name, False), np.nan, r) ** 2)
    return {name: float(np.sqrt(np.nanmean(np.concatenate(own)))) for name, own in squares.items()}


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


def force_rms(pairs: Sequence[tuple[np.ndarray, np.ndarray]]) -> tuple[float, float]:
    """Root-mean-square error of the force, and that relative to the measured force."""
    difference = np.concatenate([a - b for a, b in pairs])
    size = float(np.sqrt(np.nanmean(np.concatenate([a for a, _ in pairs]) ** 2)))
    error = float(np.sqrt(np.nanmean(difference**2)))
    return error, error / max(size, 1e-300)


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
    """The signal by which errors are quoted first: the slip velocity, else whatever of it is measured."""
    for c in system.free:
        if system.jacobian[c.name] != 0 and not system.massless:
            for name in (c.signals[1], c.signals[0], c.signals[2]):
                if name in errors:
                    return name
    return next(iter(errors))


def compare(bench: Bench, before: Fit, after: Fit, sigmas: Mapping[str, float]) -> dict[str, Any]:
    """Errors of two fits on the same trials by signal, and in the implied friction force.

    Args:
        sigmas: noise levels as the loss tells them, SI units.

    Returns:
        signal -> {quantity, unit, before, after, noise_floor} and, where there are any, outliers_left_out, a number of
        samples; the friction force that the motion implies last; the force, where it is that which is predicted, with
        its error relative to the measured one.
    """
    system = bench.mechanism.system
    units = system.signal_units
    sigmas = {name: bench.problem.loss.spread * sigma for name, sigma in sigmas.items()}
    without = left_out(bench, after, sigmas)
    old, new = signal_rms(before, without), signal_rms(after, without)
    result: dict[str, Any] = {}
    for name in old:
        if name in bench.problem.channels.outputs:
            count = sum(int(masks[name].sum()) for masks in without if name in masks)
            floor, what = sigmas.get(name, float("nan")), f"rms error of {name} in simulation"
            result[name] = _entry(what, units.get(name, ""), old[name], new[name], floor)
            result[name] |= {"outliers_left_out": count} if count else {}
    pairs = [implied_force(bench, fit, without) for fit in (before, after)]
    (old_force, old_share), (new_force, new_share) = (force_rms(p) for p in pairs)
    floor = force_floor(bench, after, sigmas)
    name = next(iter(result)) if system.massless else FORCE
    what = "measured" if system.massless else "friction"
    result[name] = _entry(f"rms error of the {what} force", system.force_unit, old_force, new_force, floor)
    size = old_force / max(old_share, 1e-300)
    result[name]["relative"] = {"before": old_share, "after": new_share, "noise_floor": floor / size}
    return result


def _entry(quantity: str, unit: str, before: float, after: float, floor: float) -> dict[str, Any]:
    return {"quantity": quantity, "unit": unit, "before": before, "after": after, "noise_floor": floor}
