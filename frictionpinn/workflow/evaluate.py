"""One evaluation: from a training run to errors on trajectories, figures, ``result.json`` and a page."""

from __future__ import annotations

import hashlib
import logging
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..data.contact import ContactTrial
from ..errors import UserError
from ..evaluate.characteristics import Characteristics, characteristics
from ..evaluate.draw import characteristics_figure, draw
from ..evaluate.fidelity import fidelity
from ..evaluate.page import terminal_table, write_page
from ..evaluate.picture import save_png
from ..evaluate.published import add_published
from ..evaluate.trajectory import Trajectory, compare
from ..models import FrictionEnsemble, FrictionModel
from ..physics import System
from ..show import readable_unit
from .build import Config, build_system
from .configs import called, written
from .experiment import build_data
from .load import check_recording, load_run
from .manifest import write_json
from .methods import build_methods
from .provenance import commit, versions
from .result import truth_at
from .train import quiet
from .trajectories import build_trajectories, recorded_trajectories, transferred

log = logging.getLogger(__name__)


def evaluate(cfg: Config) -> dict[str, Any]:
    """Evaluate the model of a run online and in simulation, beside its yardsticks and the published figures.

    Args:
        cfg: resolved conf/evaluate.yaml: run, system (None: the run's), beside, seeds, substeps, grid, trajectories.

    Returns:
        What stands in ``<run>/evaluation/result.json`` (``evaluation_<system>`` for another system than the run's).

    Raises:
        UserError: anything that the user can mend.
    """
    begin = time.perf_counter()
    quiet()
    _check(cfg)
    trained, home, model = load_run(cfg["run"])
    simulated = trained["data"]["name"] == "simulated"
    _require_own_contacts(home, cfg.get("system"))
    if not simulated:
        _require_own_system(trained, cfg.get("system"))
    _require_own_values(trained["system"], cfg.get("system"))
    away = transferred(trained, cfg.get("system"), cfg["trajectories"]) if simulated else trained
    system = build_system(away["system"])
    if len(system.contacts) > len(home.contacts):
        raise UserError("a model of one contact on a system with several", where="system", received=system.name,
                        allowed="a system with one contact")  # fmt: skip
    log.info(f"evaluating {trained['model']['name']}, trained on {home.title}, on {system.title}")
    here, there = ((s.slip_unit, s.force_unit) for s in (home, system))
    if here != there:
        (slip, force), (other, unit) = (map(readable_unit, pair) for pair in (here, there))
        log.warning(f"mind: the model was trained on a slip in {slip} and a force in {force}; on {system.name}, in "
                    f"{other} and {unit}, its numbers are taken as they are")  # fmt: skip
    data = build_data(trained, home)
    if not simulated:
        check_recording(cfg["run"], data.recording)
    train = data.select("train")
    local = data if system.name == home.name else build_data(away, system)
    if simulated:
        trajectories = build_trajectories(away, system, local, cfg)
    else:
        trajectories = recorded_trajectories(trained, system, data)
    methods = build_methods(cfg, trained, away, home, system, model, data, local)
    errors, runs, surfaces = dict[str, Any](), dict[str, Any](), dict[str, dict[str, Characteristics]]()
    for contact, table in methods.items():
        found, made = compare(table, [trajectory.at(contact) for trajectory in trajectories])
        errors |= found
        runs |= made
        surfaces[contact] = build_characteristics(cfg, trained, home, model, train, contact)
    result = _result(cfg, away, home, system, trajectories, errors, surfaces)
    folder = Path(cfg["run"]) / ("evaluation" if system.name == home.name else f"evaluation_{system.name}")
    figures = draw(folder / "figures", result, methods, trajectories, runs, surfaces)
    result["figures"] = [str(path.relative_to(folder)) for path in figures]
    result["seconds"] = round(time.perf_counter() - begin, 3)
    write_json(folder / "result.json", result)
    page = write_page(folder / "report.html", result, figures)
    log.info(terminal_table(result))
    log.info(f"figures, result.json and the page {page.name} are in {folder}")
    if not isinstance(model, FrictionEnsemble):  # not handed on as one model
        log.info(f"next: {called('evaluate')} run={cfg['run']} export=c (or onnx, mujoco) hands the model on")
    return result


def _check(cfg: Config) -> None:
    for key, least in (("substeps", 1), ("grid", 2)):
        value = cfg[key]
        if isinstance(value, bool) or not isinstance(value, int) or value < least:
            raise UserError("impossible number", where=key, received=repr(value), allowed=f"at least {least}")
    seeds = cfg["seeds"]
    if not isinstance(seeds, list) or not seeds or any(not isinstance(s, int) or s < 0 for s in seeds):
        raise UserError("impossible seeds", where="seeds", received=repr(seeds), allowed="a list such as [0, 1, 2]")


def _require_own_system(trained: Config, system: Mapping[str, Any] | None) -> None:
    own = trained["system"]["name"]
    if system is not None and system["name"] != own:
        raise UserError(
            "the friction of a measured system is not known on another one",
            where="system",
            received=f"{system['name']}, of a run on data={trained['data']['name']}",
            allowed=f"{own}, or none",
            fix="leave system out; transfer is measured with runs on data=simulated",
        )


def _require_own_values(own: Mapping[str, Any], system: Mapping[str, Any] | None) -> None:
    """Raise :class:`UserError` where the run's system is named with other values: what is simulated are the run's."""
    if system is None or system["name"] != own["name"]:
        return
    for key, value in _flat(system).items():
        before = _flat(own).get(key, value)
        if value != before:
            raise UserError("a run is evaluated on its own system as it was trained", where=f"system.{key}",
                            received=written(value), allowed=f"{written(before)}, as in the run",
                            fix="leave system out, or train with this value")  # fmt: skip


def _flat(table: Mapping[str, Any], before: str = "") -> dict[str, Any]:
    """Values by their full key."""
    found: dict[str, Any] = {}
    for key, value in table.items():
        found |= _flat(value, f"{before}{key}.") if isinstance(value, Mapping) else {f"{before}{key}": value}
    return found


def _require_own_contacts(home: System, system: Mapping[str, Any] | None) -> None:
    if len(home.contacts) > 1 and system is not None and system["name"] != home.name:
        raise UserError("a model of several contacts is of their system alone", where="system",
                        received=system["name"], allowed=home.name, fix="leave system out")  # fmt: skip


def build_characteristics(
    cfg: Config, trained: Config, home: System, model: FrictionModel, train: list[ContactTrial], contact: str = ""
) -> dict[str, Characteristics]:
    """Friction characteristics of the run's model and of those named in ``beside``, on the run's grid, by label."""
    law, truth = truth_at(trained["data"], home, contact)
    models = {trained["model"]["name"].upper(): model.map_of(contact)}
    for folder in cfg["beside"]:
        other, system, further = load_run(folder)
        if system.name != home.name or contact not in further.contacts:
            allowed = f"a run on {home.name}{f' with friction at {contact}' if contact else ''}"
            raise UserError(
                "run on another system", where="beside", received=f"{folder}, {system.name}", allowed=allowed
            )
        label = other["model"]["name"].upper()
        models[label if label not in models else f"{label}, {Path(folder).name}"] = further.map_of(contact)
    at, own, grid = home.at(contact), [trial.at(contact) for trial in train], int(cfg["grid"])
    return {label: characteristics(item, at, own, law, truth, grid) for label, item in models.items()}


def draw_characteristics(cfg: Config, path: Path) -> dict[str, Any]:
    """Only the friction characteristics of an evaluation: a panel for the run, for each ``beside`` and for the truth.

    Returns:
        what ``result.json`` holds of them.
    """
    trained, home, model = load_run(cfg["run"])
    train = build_data(trained, home).select("train")
    surfaces = build_characteristics(cfg, trained, home, model, train)
    told = _characteristics(home, surfaces)
    save_png(characteristics_figure(surfaces, told), path)
    return told


def _characteristics(home: System, surfaces: Mapping[str, Characteristics]) -> dict[str, Any]:
    grid = next(iter(surfaces.values()))
    return {
        "difference_rms": {label: item.rms for label, item in surfaces.items()},
        "unit": home.force_unit,
        "v_slip": {"low": float(grid.v[0]), "high": float(grid.v[-1]), "unit": f"{home.slip_unit}/s"},
        "normal_force": {"low": float(grid.N[0]), "high": float(grid.N[-1]), "unit": home.force_unit},
    }


def _result(
    cfg: Config,
    away: Config,
    home: System,
    system: System,
    trajectories: list[Trajectory],
    errors: dict[str, Any],
    surfaces: dict[str, dict[str, Characteristics]],
) -> dict[str, Any]:
    about = {item.name: item.describe() for contact in surfaces for item in (t.at(contact) for t in trajectories)}
    told = {contact: _characteristics(home.at(contact), own) for contact, own in surfaces.items()}
    name = away["model"]["name"]
    same = system.name == home.name
    path = Path(cfg["run"]) / "checkpoints" / "best.ckpt"
    result = {
        "model": name,
        "trained_on": home.name,
        "system": system.name,
        "run": {"folder": str(cfg["run"]), "checkpoint_sha256": hashlib.sha256(path.read_bytes()).hexdigest()},
        "truth": {
            "friction": away["data"].get("friction"),
            "parameters": away["data"].get("truth"),
            "effects": away["data"].get("effects"),
        },
        "reference": trajectories[0].reference,
        "noise": away["noise"],
        "smoothing": away["smoothing"],
        "seeds": cfg["seeds"],
        "trajectories": {key: about[key] for key in errors},
        "errors": errors,
        "fidelity": fidelity(errors),
        "characteristics": told.get("", told),
        "versions": versions(),
        "commit": commit(),
        "config": cfg,
    }
    return add_published(result, name, system.name if same else None)
