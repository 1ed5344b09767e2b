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
from ..evaluate.style import squared
from ..models import FrictionEnsemble, FrictionModel
from ..models.base import Batch
from ..models.ensemble import losses_of
from ..physics import LAWS, FrictionLaw, System
from ..physics.base import at_contact, contact_of, plain_name
from ..physics.contacts import by_parameter, law_named, laws_of
from ..physics.mechanism import Mechanism
from ..show import readable_unit
from .build import Config
from .configs import called
from .dashboard import show_figures, show_hyper_parameters
from .ensemble import band, member_spread, uncertainty
from .manifest import write_json as write_json
from .provenance import commit, versions

HALF = 0.5  # of the force, root mean square: a model that leaves more is none
HARDLY_TOLD = ("sigma_0", "sigma_1", "mu_s", "v_s")  # between stick and slip noise blurs a network's map
AT_BOUND = 0.01  # of the logarithm between two bounds: as near as a start may lie to one
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
    held_out, train = data.select("held_out"), data.select("train")
    scored = held_out or train
    told = uncertainty(model, train, scored) if isinstance(model, FrictionEnsemble) else None
    unit, drawn, errors = system.force_unit, dict[str, Figure](), dict[str, dict[str, Any]]()
    for contact in model.contacts:
        own, at, here = model.map_of(contact), system.at(contact), [trial.at(contact) for trial in scored]
        seen = [trial.at(contact) for trial in train]
        baseline = CoulombViscousFit(seen)
        errors[contact] = {
            "model": force_errors(own, here),
            "coulomb_viscous": force_errors(baseline, here) | {"parameters": baseline.parameters},
        }
        law, truth = truth_at(cfg["data"], system, contact)
        made = figures(at, seen, here, own, baseline, errors[contact], (law, truth), told)
        drawn |= {f"{name}_{contact}".rstrip("_"): figure for name, figure in made.items()}
    losses = final_losses(model, data.train_batch(model.device))
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
            "inputs": "causal: each sample with the samples before it",
            **(over_contacts(errors, system) if model.contacts != ("",) else _with_unit(errors[""], unit)),
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


def _with_unit(errors: Config, unit: str) -> Config:
    return {"unit": {"rmse": unit, "mse": squared(unit), "relative": "1"}, **errors}


def over_contacts(errors: Mapping[str, Config], system: System) -> Config:
    """Errors of every contact, and of all of them: over each one's force, the mean square over the contacts."""
    found: Config = {"unit": {"rmse": "1", "mse": "1", "relative": "1"}}
    for key in ("model", "coulomb_viscous"):
        parts = [own[key] for own in errors.values()]
        shares = {
            trial: [part["by_trial"][trial] / part["reference_rms"] for part in parts] for trial in parts[0]["by_trial"]
        }
        mse = float(np.mean([part["relative"] ** 2 for part in parts]))
        found[key] = {
            "mse": mse,
            "rmse": mse**0.5,
            "relative": mse**0.5,
            "reference_rms": 1.0,
            "reference": parts[0]["reference"],
            "by_trial": {trial: float(np.sqrt(np.mean(np.square(own)))) for trial, own in shares.items()},
        }
    own = {contact: _with_unit(table, system.at(contact).force_unit) for contact, table in errors.items()}
    return found | {"contacts": own}


def truth_at(data: Config, system: System, contact: str) -> tuple[FrictionLaw | None, dict[str, float]]:
    """The law that simulated data obey at a contact and its parameters; None and nothing where they are not known."""
    known, truth = data.get("friction"), data.get("truth") or {}
    if not known:
        return None, {}
    if not contact:
        return LAWS[known](), truth
    laws = laws_of(system, law_named(known, "data.friction"))
    own = by_parameter(truth, laws)
    return laws.at(contact), {plain_name(name): value for name, value in own.items() if contact_of(name) == contact}


def final_losses(model: FrictionModel, batch: Batch) -> dict[str, float]:
    """Terms of the loss on the training samples with the weights that are reported; of an ensemble their means."""
    if isinstance(model, FrictionEnsemble):
        return {name: float(value.mean().detach()) for name, value in model.each(losses_of, batch).items()}
    return {name: float(value.detach()) for name, value in model.losses(batch).items()}


def parameters(cfg: Config, system: System, model: FrictionModel) -> dict[str, dict[str, Any]]:
    """Value, unit, start and, for simulated data, truth of every physical parameter of the model."""
    values = model.physical()
    if not values:
        return {}
    table, spread = {}, member_spread(model)
    for contact in model.contacts:
        own = model.map_of(contact)
        options = own.hparams["law"]
        law, (obeyed, known) = LAWS[options["name"]](), truth_at(cfg["data"], system, contact)
        units = Mechanism(system, law).read_in
        for par in law.parameters:
            name = at_contact(contact, par.name)
            entry: dict[str, Any] = {"value": values[name], "unit": units[name], "text": par.text}
            entry["start"] = options["start"].get(par.name)
            entry["trained"] = par.name in own.law_parameters.raw  # type: ignore[union-attr, operator]
            if entry["trained"]:
                entry["bounds"] = options["bounds"][par.name]
            if name in spread:
                entry["spread"] = spread[name]
            if obeyed is not None and obeyed.name == law.name and par.name in known:
                entry["truth"] = float(known[par.name])
            table[name] = entry
    return table


def figures(
    system: System, train: list[ContactTrial], trials: list[ContactTrial], model, baseline, errors, truth, told=None
) -> dict[str, Figure]:
    """Force over time, force against velocity, what is left of both, and the characteristics beside the true ones.

    Args:
        system, train, trials, model: of one contact; ``truth`` the law there and its parameters.
    """
    name = model.hparams["name"].upper()
    unit, slip = readable_unit(system.force_unit), readable_unit(f"{system.slip_unit}/s")
    ours, theirs = errors["model"]["rmse"], errors["coulomb_viscous"]["rmse"]
    labels = {f"{name}: {ours:.3g} {unit} rms": model, f"Coulomb + viscous fit: {theirs:.3g} {unit} rms": baseline}
    predicted = {label: [item.predict_trial(trial)["force"] for trial in trials] for label, item in labels.items()}
    k = int(np.argmax([len(trial) for trial in trials]))
    longest = {label: forces[k] for label, forces in predicted.items()}
    contact = system.contacts[0].name if len(system.whole.contacts) > 1 else ""
    title = f"{name} on {system.title}" + (f", {contact}" if contact else "")
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
    law, values = truth
    surface = characteristics(model, system, train, law, values, GRID)
    units = {"unit": system.force_unit, "v_slip": {"unit": f"{system.slip_unit}/s"}}
    units["normal_force"] = {"unit": system.force_unit}
    drawn["characteristics"] = characteristics_figure({name: surface}, units)
    return drawn


def doubts(result: Mapping[str, Any]) -> list[str]:
    """What to know before using the model: that it is no better than two numbers, or leaves most of the force."""
    said = []
    for contact, error in result["force_error"].get("contacts", {"": result["force_error"]}).items():
        ours, theirs, at = error["model"], error["coulomb_viscous"], f" at {contact}" if contact else ""
        if ours["rmse"] >= theirs["rmse"]:
            said.append(f"the model predicts no better{at} than Coulomb + viscous friction, two numbers")
        if ours["relative"] > HALF:
            wrong = theirs["relative"] > HALF  # two numbers do no better: it is not the training
            why = f"{called('check')} tells of signs, units and masses" if wrong else "train longer, trainer.max_epochs"
            said.append(f"it leaves {100 * ours['relative']:.0f} % of the force{at}: {why}")
    for name, entry in result["parameters"].items():
        if "bounds" in entry and at_bound(entry["value"], *entry["bounds"]):
            said.append(f"{name} ended at its bound, {entry['value']:.3g}: give friction.bounds.{name} more room, or "
                        "another law")  # fmt: skip
    untold = [name for name in HARDLY_TOLD if name in map(plain_name, result["parameters"]) and "refined" not in result]
    if untold:
        said.append(f"a training hardly tells {', '.join(untold)}: refine=true estimates them with intervals")
    return said


def at_bound(value: float, low: float, high: float) -> bool:
    """Whether a trained parameter is as good as at one of its bounds."""
    share = np.log(value / low) / np.log(high / low)
    return not AT_BOUND < share < 1 - AT_BOUND


def summarise(result: Mapping[str, Any], folder: Path) -> str:
    """What a person wants to read after a training."""
    lines = []
    units = {name: readable_unit(entry["unit"]) for name, entry in result["parameters"].items()}
    broad = max([10, *map(len, units.values())])
    if result["parameters"]:
        wide = max(10, *(len(name) + 2 for name in result["parameters"]))
        lines.append(f"{'parameter':<{wide}}{'value':>12}  {'unit':<{broad}}{'start':>12}{'truth':>12}")
        for name, entry in result["parameters"].items():
            truth = f"{entry['truth']:>12.5g}" if "truth" in entry else f"{'':>12}"
            start = f"{entry['start']:>12.5g}" if entry["trained"] else f"{'fixed':>12}"
            lines.append(f"{name:<{wide}}{entry['value']:>12.5g}  {units[name]:<{broad}}{start}{truth}")
    if "refined" in result:
        refined = result["refined"]
        lines.append(f"refined by maximum likelihood ({refined['outcome']}, {refined['seconds']:.1f} s):")
        for name, entry in refined["parameters"].items():
            low, high = (np.nan if bound is None else bound for bound in entry["ci95"])
            value = np.nan if entry["value"] is None else entry["value"]
            truth = f"{entry['truth']:>12.5g}" if "truth" in entry else ""
            lines.append(
                f"{name:<{wide}}{value:>12.5g}  {readable_unit(entry['unit']):<{broad}} [{low:.5g}, {high:.5g}]{truth}"
            )
        lines += [f"  {sentence}" for sentence in refined["advice"]]
    whole = result["force_error"]
    lines.append(f"force error on {whole['on']}, against the {whole['model']['reference']}:")
    for contact, error in whole.get("contacts", {"": whole}).items():
        unit, at = readable_unit(error["unit"]["rmse"]), f", {contact}" if contact else ""
        for key, label in (("model", result["model"]), ("coulomb_viscous", "Coulomb + viscous fit")):
            item, told = error[key], f"{label}{at}"
            lines.append(f"  {told:<{22 + len(at)}}{item['rmse']:>10.4g} {unit} rms  "
                         f"({100 * item['relative']:.3g} % of the force)")  # fmt: skip
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
