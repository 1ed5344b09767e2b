"""Errors of the declared model and of the augmented one: by signal and in the friction forces that a motion implies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np
import sympy as sp

from ..errors import UserError
from ..identify.trial import TrialModel
from ..numerics.along import samples, signal_symbols
from ..numerics.coloured import lone
from ..numerics.excess import NEIGHBOURS, RESIDUAL, Excess, Level, if_apart, noise_level, rms
from ..physics.system import System
from .bench import Bench
from .fit import Fit

FORCE = "friction_force"
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
            name = model.outputs[0]
            result.setdefault(name, []).append((measured[name], run.signals[name]))
            continue
        for name, (at, force) in frictions(system).items():
            pair = samples(at, replace(run, signals=measured), force), run.at(at.contacts[0].name).F
            result.setdefault(name, []).append(pair)
    return result


def measured_signals(model: TrialModel) -> dict[str, np.ndarray]:
    """Measured outputs and inputs of a trial, shape (n,) each, NaN where missing."""
    inputs = {name: y for item in model.inputs for name, y in zip(item.names, item.y, strict=True)}
    return dict(zip(model.outputs, model.y, strict=True)) | inputs


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
        forces[name] = Level(own, worst, source, if_apart(own, other))
    return result | forces
