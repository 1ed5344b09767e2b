"""One evaluation: from a training run to errors on trajectories, figures, ``result.json`` and a page."""

from __future__ import annotations

import hashlib
import logging
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..data.contact import ContactTrial, contact_trials
from ..data.module import TrajectoryData
from ..data.recording import Recording
from ..data.simulated import simulate_recording
from ..errors import UserError
from ..evaluate.characteristics import Characteristics, characteristics
from ..evaluate.draw import draw
from ..evaluate.page import terminal_table, write_page
from ..evaluate.published import add_published
from ..evaluate.trajectory import Trajectory, compare
from ..evaluate.yardsticks import candidates
from ..models import FrictionModel
from ..physics import LAWS, System
from .build import Config, build_data, build_noise, build_smoothing, build_system
from .load import load_run
from .result import commit, versions, write_json
from .train import quiet

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
    _require_truth(trained)
    away = transferred(trained, cfg.get("system"), cfg["trajectories"])
    system = build_system(away["system"])
    log.info(f"evaluating {trained['model']['name']}, trained on {home.title}, on {system.title}")
    data = build_data(trained, home)
    train = data.select("train")
    trajectories = build_trajectories(away, system, data if system.name == home.name else None, cfg)
    methods = candidates(model, system, train, int(cfg["substeps"]))
    errors, runs = compare(methods, trajectories)
    surfaces = build_characteristics(cfg, trained, home, model, train)
    result = _result(cfg, away, home, system, trajectories, errors, surfaces)
    folder = Path(cfg["run"]) / ("evaluation" if system.name == home.name else f"evaluation_{system.name}")
    figures = draw(folder / "figures", result, system, methods, trajectories, runs, surfaces)
    result["figures"] = [str(path.relative_to(folder)) for path in figures]
    result["seconds"] = round(time.perf_counter() - begin, 3)
    write_json(folder / "result.json", result)
    page = write_page(folder / "report.html", result, figures)
    log.info(terminal_table(result))
    log.info(f"figures, result.json and the page {page.name} are in {folder}")
    return result


def _check(cfg: Config) -> None:
    for key, least in (("substeps", 1), ("grid", 2)):
        value = cfg[key]
        if isinstance(value, bool) or not isinstance(value, int) or value < least:
            raise UserError("impossible number", where=key, received=repr(value), allowed=f"at least {least}")
    seeds = cfg["seeds"]
    if not isinstance(seeds, list) or not seeds or any(not isinstance(s, int) or s < 0 for s in seeds):
        raise UserError("impossible seeds", where="seeds", received=repr(seeds), allowed="a list such as [0, 1, 2]")


def _require_truth(trained: Config) -> None:
    name = trained["data"]["name"]
    if name != "simulated":
        raise UserError(
            "no true friction force to compare with",
            where="run",
            received=f"trained on data={name}",
            allowed="a run trained on data=simulated",
            fix="errors on the held-out trials of a measurement stand in the run's own result.json",
        )


def transferred(trained: Config, system: Mapping[str, Any] | None, chosen: Mapping[str, Any] | None) -> Config:
    """The run's configuration on the system to evaluate, with the trajectories as ``data.trajectories``.

    Another system brings its own friction and trials from its ``simulate`` section; sampling rate, noise and
    smoothing stay the run's.
    """
    cfg, table = dict(trained), dict(trained["data"])
    if system is not None and system["name"] != trained["system"]["name"]:
        own = system["simulate"]
        table |= {key: own[key] for key in ("friction", "truth", "trials", "held_out")} | {"validation": []}
        cfg["system"] = dict(system)
    name = cfg["system"]["name"]
    if chosen and chosen.get(name):
        table["trajectories"] = list(chosen[name])
    else:
        held = {str(item) for item in table.get("held_out") or ()}
        named = [{"name": str(k + 1), **trial} for k, trial in enumerate(table["trials"])]
        wanted = [trial for trial in named if trial["name"] in held] or named[-1:]
        table["trajectories"] = [{**trial, "name": f"trial {trial['name']}"} for trial in wanted]
    return cfg | {"data": table}


def build_trajectories(cfg: Config, system: System, data: TrajectoryData | None, options: Config) -> list[Trajectory]:
    """Simulate the trajectories, add the run's noise for every seed, filter as the run does.

    Args:
        cfg: see :func:`transferred`.
        data: training data on this system, to which the filters are fitted; None to simulate it anew.
        options: of the evaluation: ``seeds``.
    """
    table = cfg["data"]
    specs = [{"name": f"trajectory {k + 1}", **spec} for k, spec in enumerate(table["trajectories"])]
    try:
        clean = simulate_recording(system, table["friction"], table["truth"], specs, float(table["rate_hz"]))
    except UserError as error:  # the trials are called trajectories here
        where = (error.where or "data.trials").replace("data.trials", f"trajectories.{system.name}")
        told = {"received": error.received, "allowed": error.allowed, "fix": error.fix}
        raise UserError(error.what, where=where, **told) from error  # type: ignore[arg-type]
    data = data or build_data(cfg, system)
    train = data.recording.select(data.splits["train"])
    noise, noisy, places = build_noise(cfg["noise"]), list(train.trials), []
    for trial in clean.trials:
        for seed in options["seeds"]:
            # One trajectory at a time: noise in proportion to a signal's spread must not depend on the others.
            (made,) = noise(Recording((trial,), clean.units), seed).trials
            noisy.append(replace(made, name=f"{trial.name}, seed {seed}"))
            places.append((trial.name, seed))
    offline, online = build_smoothing(cfg["smoothing"])
    contact = contact_trials(Recording(tuple(noisy), clean.units), system, offline, online, data.splits["train"])
    seen = dict(zip(places, contact[len(train.trials) :], strict=True))
    return [
        Trajectory(system, trial, {seed: seen[trial.name, seed] for seed in options["seeds"]}) for trial in clean.trials
    ]


def build_characteristics(
    cfg: Config, trained: Config, home: System, model: FrictionModel, train: list[ContactTrial]
) -> dict[str, Characteristics]:
    """Friction characteristics of the run's model and of those named in ``beside``, on the run's grid, by label."""
    law, truth = LAWS[trained["data"]["friction"]](), trained["data"]["truth"]
    models = {trained["model"]["name"].upper(): model}
    for folder in cfg["beside"]:
        other, system, further = load_run(folder)
        if system.name != home.name:
            allowed = f"a run on {home.name}"
            raise UserError(
                "run on another system", where="beside", received=f"{folder}, {system.name}", allowed=allowed
            )
        label = other["model"]["name"].upper()
        models[label if label not in models else f"{label}, {Path(folder).name}"] = further
    return {label: characteristics(item, home, train, law, truth, int(cfg["grid"])) for label, item in models.items()}


def _result(
    cfg: Config,
    away: Config,
    home: System,
    system: System,
    trajectories: list[Trajectory],
    errors: dict[str, Any],
    surfaces: dict[str, Characteristics],
) -> dict[str, Any]:
    name = away["model"]["name"]
    same = system.name == home.name
    grid = next(iter(surfaces.values()))
    path = Path(cfg["run"]) / "checkpoints" / "best.ckpt"
    result = {
        "model": name,
        "trained_on": home.name,
        "system": system.name,
        "run": {"folder": str(cfg["run"]), "checkpoint_sha256": hashlib.sha256(path.read_bytes()).hexdigest()},
        "truth": {"friction": away["data"]["friction"], "parameters": away["data"]["truth"]},
        "noise": away["noise"],
        "smoothing": away["smoothing"],
        "seeds": cfg["seeds"],
        "trajectories": {item.name: item.describe() for item in trajectories},
        "errors": errors,
        "characteristics": {
            "difference_rms": {label: item.rms for label, item in surfaces.items()},
            "unit": home.force_unit,
            "v_slip": {"low": float(grid.v[0]), "high": float(grid.v[-1]), "unit": f"{home.slip_unit}/s"},
            "normal_force": {"low": float(grid.N[0]), "high": float(grid.N[-1]), "unit": home.force_unit},
        },
        "versions": versions(),
        "commit": commit(),
        "config": cfg,
    }
    return add_published(result, name, system.name if same else None)
