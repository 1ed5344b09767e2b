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
from .observe import samples

FORCE = "friction_force"


def signal_rms(fit: Fit) -> dict[str, float]:
    """Root-mean-square distance of model and measurement by signal, SI units, all trials together."""
    result = {}
    for name in dict.fromkeys(name for piece in fit.state.pieces for name in piece.residuals):
        r = np.concatenate([p.residuals[name] for p in fit.state.pieces if name in p.residuals])
        result[name] = float(np.sqrt(np.nanmean(r**2)))
    return result


def implied_force(bench: Bench, fit: Fit) -> list[tuple[np.ndarray, np.ndarray]]:
    """Friction force that each trial's measured motion implies, and the simulated one, shape (n,) each.

    The measured force of a system whose motion is imposed is taken as it is.
    """
    system, pairs = bench.mechanism.system, []
    for model, run in zip(fit.models, bench.simulate(fit), strict=True):
        measured = dict(run.signals) | dict(zip(model.outputs, model.y, strict=True))
        for item in model.inputs:
            measured |= {n: np.where(np.isnan(y), run.signals[n], y) for n, y in zip(item.names, item.y, strict=True)}
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
        sigmas: noise levels, SI units.

    Returns:
        signal -> {quantity, unit, before, after, noise_floor}, the friction force that the motion implies last; the
        force, where it is that which is predicted, with its error relative to the measured one.
    """
    system = bench.mechanism.system
    units = system.signal_units
    old, new = signal_rms(before), signal_rms(after)
    result: dict[str, Any] = {}
    for name in old:
        if name in bench.problem.channels.outputs:
            result[name] = _entry(f"rms error of {name} in simulation", units.get(name, ""), old[name], new[name],
                                  sigmas.get(name, float("nan")))  # fmt: skip
    pairs = [implied_force(bench, fit) for fit in (before, after)]
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
