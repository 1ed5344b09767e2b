"""Trajectories of an evaluation: simulated ones with their truth, or the held-out trials of a measurement."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from ..data.contact import contact_trials, smooth_trials
from ..data.module import TrajectoryData
from ..data.recording import Recording
from ..errors import UserError
from ..evaluate.trajectory import Trajectory
from ..physics import System
from ..physics.base import plain_name
from .build import Config, build_noise, build_smoothing, simulated
from .experiment import frictional

REFERENCE = ("friction_force", "normal_force", "v_slip")  # what a measurement is compared with


def transferred(trained: Config, system: Mapping[str, Any] | None, chosen: Mapping[str, Any] | None) -> Config:
    """The run's configuration on the system to evaluate, with the trajectories as ``data.trajectories``.

    Another system brings its own friction and trials from its ``simulate`` section, without the run's effects;
    sampling rate, noise and smoothing stay the run's.
    """
    cfg, table = dict(trained), dict(trained["data"])
    if system is not None and system["name"] != trained["system"]["name"]:
        own = system["simulate"]
        table |= {key: own[key] for key in ("friction", "truth", "trials", "held_out")} | {
            "validation": [],
            "equations": None,
            "effects": None,
        }
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


def build_trajectories(cfg: Config, system: System, data: TrajectoryData, options: Config) -> list[Trajectory]:
    """Simulate the trajectories, add the run's noise for every seed, filter as the run does.

    Args:
        cfg: see :func:`transferred`.
        data: training data on this system, to which the filters are fitted.
        options: of the evaluation: ``seeds``.
    """
    table = cfg["data"]
    specs = [{"name": f"trajectory {k + 1}", **spec} for k, spec in enumerate(table["trajectories"])]
    try:
        clean = simulated(table, system, specs)
    except UserError as error:  # the trials are called trajectories here
        where = (error.where or "data.trials").replace("data.trials", f"trajectories.{system.name}")
        told = {"received": error.received, "allowed": error.allowed, "fix": error.fix}
        raise UserError(error.what, where=where, **told) from error  # type: ignore[arg-type]
    train = data.recording.select(data.splits["train"])
    noise, noisy, places = build_noise(cfg["noise"]), list(train.trials), []
    for trial in clean.trials:
        for seed in options["seeds"]:
            # One trajectory at a time: noise in proportion to a signal's spread must not depend on the others.
            (made,) = noise(Recording((trial,), clean.units), seed).trials
            noisy.append(replace(made, name=f"{trial.name}, seed {seed}"))
            places.append((trial.name, seed))
    offline, online = build_smoothing(cfg["smoothing"])
    everything, own = Recording(tuple(noisy), clean.units), frictional(cfg, system)
    contact = contact_trials(everything, system, offline, online, data.splits["train"], own)
    seen = dict(zip(places, contact[len(train.trials) :], strict=True))
    return [
        Trajectory(system, trial, {seed: seen[trial.name, seed] for seed in options["seeds"]}) for trial in clean.trials
    ]


def recorded_trajectories(cfg: Config, system: System, data: TrajectoryData) -> list[Trajectory]:
    """The held-out trials of a measurement (the training trials where none are held out).

    The friction force to compare with is what the equation of motion implies, from signals that were smoothed in both
    directions; positions and velocities are compared with the smoothed measurement.
    """
    recording, train = data.recording, data.splits["train"]
    offline, _ = build_smoothing(cfg["smoothing"])
    fitting = [trial for trial in recording.trials if trial.name in train]
    smoothed = smooth_trials(recording, fitting, system, offline)
    trajectories = []
    for trial, signals in zip(recording.trials, smoothed, strict=True):
        if trial.name not in (data.splits["held_out"] or train):
            continue
        contact = data.by_name[trial.name]
        reference = {name: x for name, x in contact.offline.items() if plain_name(name) in REFERENCE}
        clean = replace(trial, name=f"trial {trial.name}", signals=signals, truth=reference)
        trajectories.append(Trajectory(system, clean, {int(cfg["seed"]): contact}, "force balance, smoothed"))
    return trajectories
