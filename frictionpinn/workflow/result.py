"""What a training leaves: ``result.json``, figures as PNG and in TensorBoard, a summary on the terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ..data.contact import ContactTrial
from ..data.module import TrajectoryData
from ..evaluate.characteristics import characteristics
from ..evaluate.draw import characteristics_figure
from ..evaluate.figures import force_over_time, force_over_velocity, residuals
from ..evaluate.force import CoulombViscousFit, force_errors
from ..evaluate.picture import save_png
from ..models import FrictionEnsemble, FrictionModel
from ..models.base import Batch
from ..physics import LAWS, System
from ..physics.mechanism import Mechanism
from .build import Config
from .configs import called
from .dashboard import show_figures, show_hyper_parameters
from .ensemble import band, member_spread, uncertainty
from .manifest import write_json as write_json
from .provenance import commit, versions

HALF = 0.5  # of the force, root mean square: a model that leaves more is none
HARDLY_TOLD = ("sigma_0", "sigma_1", "mu_s", "v_s")  # between stick and slip noise blurs a network's map
GRID = 61  # values of velocity and of normal force in the figure of characteristics


def report(
    cfg: Config, folder: Path, system: System, data: TrajectoryData, model: FrictionModel, training: Config,
    loggers: Sequence[Any] = (), step: int = 0,
) -> dict[str, Any]:  # fmt: skip
    """Score the model and the Coulomb + viscous fit on the held-out trials, draw the figures, return the result.

    Args:
        training: epochs, device and seconds of the training.
        loggers, step: of the training; they show the figures too.
    """
    held_out = data.select("held_out")
    scored = held_out or data.select("train")
    baseline = CoulombViscousFit(data.select("train"))
    unit = system.force_unit
    errors = {
        "model": force_errors(model, scored),
        "coulomb_viscous": force_errors(baseline, scored) | {"parameters": baseline.parameters},
    }
    told = uncertainty(model, data.select("train"), scored) if isinstance(model, FrictionEnsemble) else None
    drawn = figures(cfg, system, data, scored, model, baseline, errors, told)
    losses = final_losses(model, data.train_batch(model.device))
    square = f"({unit})^2" if "*" in unit else f"{unit}^2"
    result = {
        **({"ensemble": {"over": cfg["ensemble_over"], "unit": unit, **told}} if told else {}),
        "model": cfg["model"]["name"],
        "system": system.name,
        "data": {
            "name": cfg["data"]["name"],
            "source": data.recording.source,
            "sha256": data.recording.checksum,
            "samples": {split: sum(len(t) for t in data.select(split)) for split in data.splits},
            "trials": data.splits,
        },
        "parameters": parameters(cfg, system, model),
        "force_error": {
            "on": "held-out trials" if held_out else "training trials (none held out)",
            "unit": {"rmse": unit, "mse": square, "relative": "1"},
            "inputs": "causal: each sample with the samples before it",
            **errors,
        },
        "training": {
            **training,
            "seconds": {key: round(value, 3) for key, value in training["seconds"].items()},
            "seed": cfg["seed"],
            "loss": losses,
        },
        "versions": versions(),
        "commit": commit(),
        "config": cfg,
    }
    (folder / "figures").mkdir(parents=True, exist_ok=True)
    pictures = {key: save_png(figure, folder / "figures" / f"{key}.png") for key, figure in drawn.items()}
    show_figures(loggers, pictures, step)
    show_hyper_parameters(loggers, cfg, folder, result, step)
    for logger in loggers:
        logger.experiment.close()  # its thread would go on writing to the run's folder
    return result


def final_losses(model: FrictionModel, batch: Batch) -> dict[str, float]:
    """Terms of the loss on the training samples with the weights that are reported; of an ensemble their means."""
    if isinstance(model, FrictionEnsemble):
        return {name: float(value.mean().detach()) for name, value in model.each(FrictionModel.losses, batch).items()}
    return {name: float(value.detach()) for name, value in model.losses(batch).items()}


def parameters(cfg: Config, system: System, model: FrictionModel) -> dict[str, dict[str, Any]]:
    """Value, unit, start and, for simulated data, truth of every physical parameter of the model."""
    values = model.physical()
    if not values:
        return {}
    law = LAWS[cfg["friction"]["name"]]
    start = model.hparams["law"]["start"]
    known = cfg["data"].get("truth") or {}
    same_law = cfg["data"].get("friction") == law.name
    table, spread, units = {}, member_spread(model), Mechanism(system, law()).read_in
    for par in law.parameters:
        entry: dict[str, Any] = {"value": values[par.name], "unit": units[par.name], "text": par.text}
        entry["start"] = start.get(par.name)
        entry["trained"] = par.name in model.law_parameters.raw  # type: ignore[union-attr, operator]
        if par.name in spread:
            entry["spread"] = spread[par.name]
        if same_law and par.name in known:
            entry["truth"] = float(known[par.name])
        table[par.name] = entry
    return table


def figures(
    cfg: Config, system: System, data: TrajectoryData, trials: list[ContactTrial], model, baseline, errors, told=None
) -> dict[str, Figure]:
    """Force over time, force against velocity, what is left of both, and the characteristics beside the true ones."""
    name = model.hparams["name"].upper()
    unit, slip = readable(system.force_unit), readable(f"{system.slip_unit}/s")
    ours, theirs = errors["model"]["rmse"], errors["coulomb_viscous"]["rmse"]
    labels = {f"{name}: {ours:.3g} {unit} rms": model, f"Coulomb + viscous fit: {theirs:.3g} {unit} rms": baseline}
    predicted = {label: [item.predict_trial(trial)["force"] for trial in trials] for label, item in labels.items()}
    k = int(np.argmax([len(trial) for trial in trials]))
    longest = {label: forces[k] for label, forces in predicted.items()}
    title = f"{name} on {system.title}"
    drawn = {
        "force_over_time": force_over_time(
            trials[k],
            longest,
            unit,
            f"{title}, trial {trials[k].name}: friction force",
            band(model.predict_trial(trials[k]), told) if told else None,
        ),
        "force_over_velocity": force_over_velocity(
            trials, predicted, (unit, slip), f"{title}: friction against slip velocity"
        ),
        "residuals": residuals(trials, predicted, unit, f"{title}: what the Coulomb + viscous fit and the model leave"),
    }
    known = cfg["data"].get("friction") if cfg["data"]["name"] == "simulated" else None
    law = LAWS[known]() if known else None
    surface = characteristics(model, system, data.select("train"), law, cfg["data"].get("truth") or {}, GRID)
    units = {"unit": system.force_unit, "v_slip": {"unit": f"{system.slip_unit}/s"}}
    units["normal_force"] = {"unit": system.force_unit}
    drawn["characteristics"] = characteristics_figure({name: surface}, units)
    return drawn


def doubts(result: Mapping[str, Any]) -> list[str]:
    """What to know before using the model: that it is no better than two numbers, or leaves most of the force."""
    error, said = result["force_error"], []
    ours, theirs = error["model"], error["coulomb_viscous"]
    if ours["rmse"] >= theirs["rmse"]:
        said.append("the model predicts no better than Coulomb + viscous friction, two numbers")
    if ours["relative"] > HALF:
        said.append(f"it leaves {100 * ours['relative']:.0f} % of the force: {called('check')} tells of signs, "
                    "units and masses")  # fmt: skip
    untold = [name for name in HARDLY_TOLD if name in result["parameters"] and "refined" not in result]
    if untold:
        said.append(f"a training hardly tells {', '.join(untold)}: refine=true estimates them with intervals")
    return said


def readable(unit: str) -> str:
    """Unit as people write it: N*m becomes N m."""
    return unit.replace("*", " ")


def summarise(result: Mapping[str, Any], folder: Path) -> str:
    """What a person wants to read after a training."""
    lines = []
    if result["parameters"]:
        lines.append(f"{'parameter':<10}{'value':>12}  {'unit':<10}{'start':>12}{'truth':>12}")
        for name, entry in result["parameters"].items():
            truth = f"{entry['truth']:>12.5g}" if "truth" in entry else f"{'':>12}"
            start = f"{entry['start']:>12.5g}" if entry["trained"] else f"{'fixed':>12}"
            lines.append(f"{name:<10}{entry['value']:>12.5g}  {readable(entry['unit']):<10}{start}{truth}")
    if "refined" in result:
        refined = result["refined"]
        lines.append(f"refined by maximum likelihood ({refined['outcome']}, {refined['seconds']:.1f} s):")
        for name, entry in refined["parameters"].items():
            low, high = (np.nan if bound is None else bound for bound in entry["ci95"])
            value = np.nan if entry["value"] is None else entry["value"]
            truth = f"{entry['truth']:>12.5g}" if "truth" in entry else ""
            lines.append(f"{name:<10}{value:>12.5g}  {readable(entry['unit']):<10}[{low:.5g}, {high:.5g}]{truth}")
        lines += [f"  {sentence}" for sentence in refined["advice"]]
    error, unit = result["force_error"], readable(result["force_error"]["unit"]["rmse"])
    lines.append(f"force error on {error['on']}, against the {error['model']['reference']}:")
    for key, label in (("model", result["model"]), ("coulomb_viscous", "Coulomb + viscous fit")):
        item = error[key]
        lines.append(f"  {label:<22}{item['rmse']:>10.4g} {unit} rms  ({100 * item['relative']:.3g} % of the force)")
    lines += [f"mind: {sentence}" for sentence in doubts(result)]
    if "ensemble" in result:
        told = result["ensemble"]
        lines.append(
            f"  {told['members']} members: the interval of {100 * told['coverage']['wanted']:.0f} % holds "
            f"{100 * told['coverage']['interval']:.1f} % of the force; the spread alone (1.96 standard deviations) "
            f"{100 * told['coverage']['spread_alone']:.1f} %"
        )
    seconds = result["training"]["seconds"]
    lines.append(f"{result['training']['epochs']} epochs in {seconds['training']:.1f} s; everything is in {folder}")
    return "\n".join(lines)
