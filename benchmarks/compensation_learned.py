"""Arms that the compiled benchmark leaves out for their time: the online estimator's force, and networks'.

    python benchmarks/compensation.py --learned

A network is trained for every axis on a recording of it with the PID alone, with the inertia and gravity that are
believed; the online estimator starts from the believed parameters, as every other arm, and adapts what
conf/control/estimator.yaml lets adapt, at rates of its own: its filter is linear about the measured motion, and grows
sure of a wrong mass and loses the axis where it may not forget (seeds 0 to 2 of the drive, multisine: 2.8 mm, 153 µm
and 2.9 mm at 1 % per root of a second, 101, 144 and 99 µm at 3 %, 100, 141 and 93 µm at 10 %). A cycle of these arms
takes 0.1 to 1 ms of Python, so there are few axes.

PE2 sees the frictionless acceleration a + F/m. Along a reference it is known only with the force that the network gave
last, so one that has learned F = m (a_frictionless - a), which is true of every recording, gives what it gave before;
BB1, PE1, and PE2 without that input, tell friction from the motion. The correlation shows which.
"""

from __future__ import annotations

import logging
import tempfile
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from compensation import (
    ARMS,
    DELAY,
    FIRST,
    INTERVAL,
    MOVES,
    SKIPPED,
    closed,
    compensator,
    config,
    controller,
    figures,
    made,
    paths,
)
from compensation_plants import KINDS, Draw, draw
from compensation_report import keep, kept, unit

import frictionpinn as fp
from frictionpinn.control import Compensator, close, reference
from frictionpinn.control.compensator import dry_friction
from frictionpinn.control.feedback import EstimatorFeedback, NetworkFeedforward
from frictionpinn.control.loop import Adds, Loop
from frictionpinn.control.record import recorded
from frictionpinn.control.references import stroke
from frictionpinn.export.portable import PortableModel
from frictionpinn.online import OnlineEstimator, tune
from frictionpinn.physics.mechanism import Mechanism
from frictionpinn.workflow.export import sampling_interval
from frictionpinn.workflow.load import load_run

AXES = {"drive": FIRST, "joint": FIRST + 1}  # seed: one linear without the load, one rotary with gravity and load
MOTIONS = ("reversing sine", "multisine")
BESIDE = ("none", "feedforward", "estimator", "oracle")  # arms of the main table on the same seeds
SEES = ["v_slip", "normal_force"]  # all but the frictionless acceleration
NETWORKS: dict[str, tuple[str, dict]] = {  # title, model and options
    "BB1": ("bb1", {}),
    "PE1": ("pe1", {}),
    "PE2": ("pe2", {}),
    "PE2, velocity alone": ("pe2", {"model.inputs": SEES}),
}
WANDER = 0.1  # per root of a second, of every parameter of the online estimator: see above
EPOCHS = 300  # of a network's training: 5 s
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
    adapt = {key: WANDER for key in options["adapt"] if it.believed.get(key, 0.0) > 0.0}
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


def network(name: str, it: Draw, model: str, more: dict) -> Adds:
    """A network trained on the axis with the PID alone, along the reference."""
    own = declared(it)
    recording = recorded(alone(name, it), own, DELAY, RATE)
    with tempfile.TemporaryDirectory() as place:
        options = {"max_epochs": EPOCHS, "progress_bar": False, "accelerator": "cpu", "threads": 1}
        run = fp.train(own, recording, model=model, folder=Path(place) / "run", check="warn", trainer=options, **more)
        trained, system, net = load_run(run.folder)
        portable = PortableModel.of(net, system, sampling_interval(trained, system))
    limit = config("estimator")["limit"] * dry_friction(it.model, it.believed)
    inertia = it.believed.get("M", it.believed.get("J", 1.0))
    return NetworkFeedforward(portable, inertia=inertia, normal=1.0, interval=INTERVAL, limit=limit)


def learned(chosen: dict, kinds: Iterable[str] = tuple(AXES)) -> None:
    """Rms error of the online estimator's force and of networks, beside arms of the main table."""
    asked = [kind for kind in AXES if kind in kinds]
    found = kept("learned", asked)
    for name in asked:
        it, found[name] = draw(name, AXES[name]), {}
        it = replace(it, stroke=stroke([path for motion in MOTIONS for path in paths(name, motion)], MOVES))
        for arm in _arms():
            helper, row = _new(chosen, name, arm, it), {}
            for motion in MOTIONS:
                ((loop, _),) = runs = closed(name, motion, AXES[name], lambda _, helper=helper: helper, holds=0.0)
                late = loop.t >= SKIPPED
                true, added = loop.friction[late], loop.added[late]
                alike = float(np.corrcoef(added, true)[0, 1]) if added.any() else 0.0
                row[motion] = [figures(runs)["rms"], alike, float(added @ true / (true @ true))]
            found[name][arm] = row
            print(name, arm, row, flush=True)
        keep("learned", found, _table)


def _arms() -> dict[str, str]:
    named = {arm: ARMS[arm] for arm in BESIDE} | {"online": "online estimator's force"}
    return named | {key: f"network {key}" for key in NETWORKS}


def _table(found: dict) -> list[str]:
    lines = [
        "python benchmarks/compensation.py --learned",
        "rms error; online estimator from parameters believed 20 % wrong; networks of "
        f"{EPOCHS} epochs on 12 s of the axis with",
        f"the PID alone at {RATE:g} Hz; correlation and share: of what was added with the true friction",
    ]
    for name, rows in found.items():
        factor, told = unit(name)
        head = "".join(f"{f'{motion}, {told}':>24}{'correlation':>13}{'share':>8}" for motion in MOTIONS)
        loaded = ", load +50 %" if AXES[name] % 2 else ""
        lines += ["", f"  {f'{name} {AXES[name]}{loaded}':<30}{head}"]
        for arm, row in rows.items():
            cells = "".join(f"{factor * rms:>24.4g}{alike:>13.2f}{share:>8.2f}" for rms, alike, share in row.values())
            lines.append(f"    {_arms()[arm]:<28}{cells}")
    return lines


def _new(chosen: dict, name: str, arm: str, it: Draw) -> Adds | Compensator | None:
    logging.getLogger("lightning.pytorch").setLevel(logging.ERROR)
    torch.set_num_threads(1)
    if arm == "online":
        return online(name, it)
    if arm in NETWORKS:
        return network(name, it, *NETWORKS[arm])
    return compensator("none", it) if arm == "none" else made(chosen, name, arm)(it)
