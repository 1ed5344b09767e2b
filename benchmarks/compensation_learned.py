"""Arms that the compiled benchmark leaves out for their time: the online estimator's force, and networks'.

    python benchmarks/compensation.py --learned

A network is trained for every axis on a recording of it with the PID alone, with the inertia and gravity that are
believed; the online estimator starts from the believed parameters, as every other arm, and adapts what
conf/control/estimator.yaml lets adapt. A cycle of the estimator takes a millisecond of Python, so there are few seeds.
"""

from __future__ import annotations

import logging
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
from compensation import ARMS, DELAY, FIRST, INTERVAL, closed, compensator, config, controller, figures, made
from compensation_plants import KINDS, Draw
from compensation_report import save, unit

import frictionpinn as fp
from frictionpinn.control import Compensator, close, reference
from frictionpinn.control.build import dry_friction
from frictionpinn.control.feedback import EstimatorFeedback, NetworkFeedforward
from frictionpinn.control.loop import Adds, Loop
from frictionpinn.control.record import recorded
from frictionpinn.export.portable import PortableModel
from frictionpinn.online import OnlineEstimator, tune
from frictionpinn.physics.mechanism import Mechanism
from frictionpinn.workflow.export import sampling_interval
from frictionpinn.workflow.load import load_run

SEEDS = (FIRST, FIRST + 1)  # without and with the load
AXES = ("drive", "joint")  # one linear, one rotary with gravity
MOTIONS = ("reversing sine", "multisine")
BESIDE = ("none", "feedforward", "estimator", "oracle")  # arms of the main table on the same seeds
NETWORKS = ("bb2", "pe2")
EPOCHS = 300  # of a network's training
RATE = 250.0  # Hz, of the recording that networks are trained on
SHAPES = (("triangle", 4.0, 1.0), ("sine", 2.0, 1.0), ("multisine", 3.0, 1.3), ("sine", 1.0, 0.7))


def alone(name: str, it: Draw, duration: float = 3.0) -> dict[str, Loop]:
    """An axis with the PID alone on four motions, by the name of the trial."""
    return {
        str(k + 1): close(it.plant, controller(name), reference(shape, size * KINDS[name].amplitude, period), duration,
                          None, (it.model, it.believed), INTERVAL, DELAY)
        for k, (shape, period, size) in enumerate(SHAPES)
    }  # fmt: skip


def declared(it: Draw) -> Mechanism:
    """The axis as its user declares it, with the inertia and gravity that are believed."""
    system = {key: it.believed[key] for key in ("M", "J", "W_cos", "W_sin") if key in it.believed}
    return Mechanism(type(it.model.system)(**system), it.model.law)


def online(name: str, it: Draw) -> Adds:
    """The online estimator along the measured motion, bristle carried, parameters adapting."""
    options = config("estimator")
    adapt = {key: rate for key, rate in options["adapt"].items() if it.believed.get(key, 0.0) > 0.0}
    log = recorded({"1": alone(name, it)["2"]}, it.model, DELAY, 1 / INTERVAL)
    position = it.model.free[0].signals[0]
    tuning = tune(it.model, log, {position: it.plant.resolution / np.sqrt(12)})
    estimator = OnlineEstimator.fit(it.model, it.believed, log, tuning=tuning)
    spread = np.diag([options["spread"][key] ** 2 for key in adapt])
    adapting = OnlineEstimator(it.model, it.believed, tuning, adapt, estimator.share, spread)
    limit = options["limit"] * dry_friction(it.model, it.believed)
    return EstimatorFeedback(
        adapting, interval=INTERVAL, delay=DELAY, limit=limit, resolution=it.plant.resolution
    )  # fmt: skip


def network(name: str, it: Draw, model: str) -> Adds:
    """A network trained on the axis with the PID alone, along the reference."""
    own = declared(it)
    recording = recorded(alone(name, it), own, DELAY, RATE)
    with tempfile.TemporaryDirectory() as place:
        options = {"max_epochs": EPOCHS, "progress_bar": False, "accelerator": "cpu", "threads": 1}
        run = fp.train(own, recording, model=model, folder=Path(place) / "run", check="warn", trainer=options)
        trained, system, net = load_run(run.folder)
        portable = PortableModel.of(net, system, sampling_interval(trained, system))
    limit = config("estimator")["limit"] * dry_friction(it.model, it.believed)
    inertia = it.believed.get("M", it.believed.get("J", 1.0))
    return NetworkFeedforward(portable, inertia=inertia, normal=1.0, interval=INTERVAL, limit=limit)


def learned(chosen: dict) -> None:
    """Rms error of the online estimator's force and of networks, beside arms of the main table."""
    arms: dict[str, str] = {arm: ARMS[arm] for arm in BESIDE}
    arms |= {"online": "online estimator's force", **{key: f"network {key.upper()}" for key in NETWORKS}}
    lines = [
        "python benchmarks/compensation.py --learned",
        f"rms error, seeds {SEEDS[0]} (no load) and {SEEDS[1]} (load): online estimator from parameters believed 20 %",
        f"wrong; networks of {EPOCHS} epochs on 12 s of the axis with the PID alone at {RATE:g} Hz",
    ]
    won: dict[str, list[float]] = {arm: [] for arm in arms if arm != "none"}
    for name in AXES:
        factor, told = unit(name)
        lines += ["", f"  {name + ', ' + told:<26}" + "".join(f"{text:>26}" for text in arms.values())]
        makers: dict[int, dict[str, Callable[[Draw], Adds | None]]] = {seed: {} for seed in SEEDS}
        for motion in MOTIONS:
            for seed in SEEDS:
                row = []
                for arm in arms:
                    make = makers[seed].setdefault(arm, _maker(chosen, name, arm))
                    row.append(figures(closed(name, motion, seed, make))["rms"])
                for arm, value in zip(arms, row, strict=True):
                    if arm != "none":
                        won[arm].append(value / row[0])
                lines.append(f"    {motion + ', ' + str(seed):<24}" + "".join(f"{factor * v:>26.4g}" for v in row))
                print(lines[-1], flush=True)
    lines += ["", "rms error over that without compensation, median, lowest and highest of all rows"]
    lines += [f"  {arms[arm]:<28}{np.median(v):>8.3f}{min(v):>8.3f}{max(v):>8.3f}" for arm, v in won.items()]
    save("learned", lines)


def _maker(chosen: dict, name: str, arm: str) -> Callable[[Draw], Adds | None]:
    """Maker of an arm that is made once and used for every motion."""
    logging.getLogger("lightning.pytorch").setLevel(logging.ERROR)
    torch.set_num_threads(1)
    kept: list[Adds | None] = []

    def make(it: Draw) -> Adds | None:
        if not kept:
            kept.append(_new(chosen, name, arm, it))
        return kept[0]

    return make


def _new(chosen: dict, name: str, arm: str, it: Draw) -> Adds | Compensator | None:
    if arm == "online":
        return online(name, it)
    if arm in NETWORKS:
        return network(name, it, arm)
    return compensator("none", it) if arm == "none" else made(chosen, name, arm)(it)
