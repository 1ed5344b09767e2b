"""Friction compensation in a closed loop whose plant is not the compensator's model: tracking, stability, time.

    python benchmarks/compensation.py                 # tunes, runs, reports: 20 minutes on a core
    python benchmarks/compensation.py --seeds 2       # a quick look, not written
    python benchmarks/compensation.py --margins       # over-compensation, 100 random axes
    python benchmarks/compensation.py --ways          # ways of learning on the same axes
    python benchmarks/compensation.py --latency       # one cycle in C and in Python
    python benchmarks/compensation.py --diagnosed     # the missing effect diagnosed and added before compensating
    python benchmarks/compensation.py --oracle        # what separates our estimator from the oracle
    python benchmarks/compensation.py --learned       # the online estimator's force and a network's

Writes benchmarks/results/compensation*.json, .txt and compensation.html. What is adjustable in an arm (the bandwidth
of what observes, how fast the disturbance changes for an oracle that measures, the transition of a regularised sign)
is chosen for every kind of axis on seeds 0 to 3, by the lowest mean log rms error; results are of seeds from 1000 on.
One PID for an axis, from its nominal inertia and delay by the rule of frictionpinn.control.tuned (maximum sensitivity
1.4), without compensation.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Iterable
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numpy as np
from compensation_plants import KINDS, Draw, draw
from omegaconf import OmegaConf

from frictionpinn.control import Compensator, Gains, Loop, close, reference, tuned
from frictionpinn.control.build import build_compensator
from frictionpinn.control.loop import Adds
from frictionpinn.control.pid import loop_dead_time
from frictionpinn.control.references import Reference, halted, stroke

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "benchmarks" / "results"
INTERVAL, DELAY = 1e-3, 1.5e-3  # s; the delay is what controllers believe: it is 1, 1.5 or 2 ms
MOVES, HOLDS, SKIPPED = 6.0, 1.5, 2.0  # s: of motion, at rest after it, of the motion before errors count
SETTLES = 0.3  # s at rest before a limit cycle is looked for
TUNING, FIRST = range(4), 1000  # seeds
REFERENCES: dict[str, tuple[str, float, tuple[float, ...]]] = {  # shape, period in s, phases of the axes
    "slow triangle": ("triangle", 4.0, (0.0,)),
    "reversing sine": ("sine", 2.0, (0.0,)),
    "circle": ("sine", 3.0, (0.0, np.pi / 2)),
    "point to point": ("point_to_point", 2.0, (0.0,)),
    "multisine": ("multisine", 2.0, (0.0,)),
}
SLOW = ("slow triangle", "reversing sine", "circle")
ARMS = {
    "none": "no compensation",
    "coulomb": "Coulomb, tanh",
    "stribeck": "Coulomb + viscous + Stribeck",
    "feedforward": "LuGre feed-forward",
    "disturbance_observer": "disturbance observer",
    "estimator": "our estimator",
    "measuring": "oracle that measures",
    "oracle": "oracle",
}
INFORMED = ("measuring", "oracle")  # arms that are told the axis: its effect, every parameter, the load and the delay
CHOICES = {  # what is adjustable in an arm, and the values tried
    "coulomb": ("transition", (0.1, 0.3, 1.0, 3.0)),
    "stribeck": ("transition", (0.03, 0.1, 0.3, 1.0)),
    "disturbance_observer": ("bandwidth", (30.0, 45.0, 60.0, 90.0, 120.0)),
    "estimator": ("bandwidth", (30.0, 45.0, 60.0, 90.0, 120.0)),
    "measuring": ("disturbance", (0.02, 0.1, 0.5, 2.0)),
}
# An elastic gear's twist under gravity, which the oracle leaves as it is, is most of the arm's error.
MEASURED = [name for name, kind in KINDS.items() if not np.isfinite(kind.resonance)]
PARTS = {  # option -> module with a function of that name
    "margins": "compensation_parts",
    "ways": "compensation_parts",
    "latency": "compensation_parts",
    "diagnosed": "compensation_diagnosed",
    "oracle": "compensation_oracle",
    "learned": "compensation_learned",
}
FIGURES = {"rms": "rms error", "peak": "peak error at reversals", "variation": "torque variation", "energy": "energy"}


def config(arm: str, **options: object) -> dict:
    """The file of conf/control with other values for some of its options."""
    return {**OmegaConf.to_container(OmegaConf.load(ROOT / "conf" / "control" / f"{arm}.yaml")), **options}  # type: ignore[dict-item]


def controller(name: str) -> Gains:
    """The PID of a kind of axis."""
    kind = KINDS[name]
    m = kind.truth.get("M", kind.truth.get("J", 1.0))
    return tuned(m, loop_dead_time(DELAY, INTERVAL), limit=kind.limit, dead=2 * kind.resolution)


def compensator(arm: str, it: Draw, gain: float = 1.0, **options: object) -> Compensator | None:
    """An arm for an axis."""
    loop = {"interval": INTERVAL, "delay": DELAY, "resolution": it.plant.resolution}
    if arm in INFORMED:
        loop |= {"delay": it.plant.delay, "known": it.believed}
    if arm == "oracle":  # watches nothing
        return Compensator(it.plant.mechanism, it.plant.parameters, gain=gain, **loop)
    if arm == "measuring":  # has nothing to learn, and makes good what the encoder shows, as far as it can be trusted
        nothing = {"adapt": {}, "spread": {}, "uneven": 0.0, "bandwidth": max(CHOICES["estimator"][1])}
        own = config("estimator", gain=gain, **nothing, **options)
        return build_compensator(own, it.plant.mechanism, it.plant.parameters, **loop)
    own = config(arm, **({} if arm == "none" else {"gain": gain}), **options)
    return build_compensator(own, it.model, it.believed, stroke=it.stroke, **loop)


def closed(
    name: str,
    motion: str,
    seed: int,
    make: Callable[[Draw], Adds | None],
    change: Callable[[Draw], Draw] = lambda it: it,
    holds: float = HOLDS,
    moves: float = MOVES,
) -> list[tuple[Loop, Draw]]:
    """The loops of every axis of a reference, which ends at rest; ``change`` is made to the axes of the seed."""
    found = []
    for axis, path in enumerate(paths(name, motion, moves)):
        it = change(draw(name, seed + 500_000 * axis))
        it = replace(it, stroke=stroke([path], moves))
        believed, helper = (it.model, it.believed), make(it)
        delay = helper.plan.lag * INTERVAL if isinstance(helper, Compensator) else DELAY
        loop = close(it.plant, controller(name), path, moves + holds, helper, believed, INTERVAL, delay)
        found.append((loop, it))
    return found


def paths(name: str, motion: str, moves: float = MOVES) -> list[Reference]:
    """A reference for every axis of a motion, which ends at rest."""
    shape, period, phases = REFERENCES[motion]
    options: list[dict[str, float]] = [{"phase": phase} if shape == "sine" else {} for phase in phases]
    return [halted(reference(shape, KINDS[name].amplitude, period, **option), moves) for option in options]


def figures(loops: list[tuple[Loop, Draw]], begins: float = SKIPPED, ends: float = MOVES) -> dict[str, float]:
    """Errors in the unit of position, torque variation in force per second, energy in J per second."""
    first = loops[0][0]
    moving = (first.t >= begins) & (first.t < ends)
    square = sum(loop.error**2 for loop, _ in loops)
    peaks, variation, energy = [], 0.0, 0.0
    for loop, _ in loops:
        v = loop.reference[:, 1]
        turns = np.flatnonzero((np.sign(v[1:]) != np.sign(v[:-1])) & moving[1:])
        near = np.zeros(len(v), dtype=bool)
        for k in turns:
            near[k : k + 200] = True
        peaks.append(float(np.abs(loop.error[near & moving]).max(initial=0.0)))
        variation += float(np.abs(np.diff(loop.torque[moving])).sum()) / (ends - begins)
        energy += float(np.maximum(loop.torque * loop.velocity, 0.0)[moving].mean())
    return {"rms": float(np.sqrt(square[moving].mean())), "peak": max(peaks), "variation": variation, "energy": energy}


def limit_cycle(position: np.ndarray, resolution: float) -> bool:
    """Whether an axis that is to rest goes to and fro: three turns or more, each by more than three encoder steps."""
    turns, sign, extreme = 0, 0.0, position[0]
    for x in position:
        if (x - extreme) * sign > 0 or (sign == 0.0 and abs(x - extreme) > 3 * resolution):
            sign, extreme = (sign or float(np.sign(x - extreme))), x
        elif (extreme - x) * sign > 3 * resolution:
            turns, sign, extreme = turns + 1, -sign, x
    return turns >= 3


def made(chosen: dict, name: str, arm: str, **more: float) -> Callable[[Draw], Compensator | None]:
    """Maker of an arm with what was chosen for a kind of axis."""
    own = {CHOICES[arm][0]: chosen[name][arm]} if arm in CHOICES else {}
    return lambda it: compensator(arm, it, **{**own, **more})


def tune(chosen: dict[str, dict[str, float]], kinds: Iterable[str]) -> dict[str, dict[str, float]]:
    """What is adjustable in those arms and kinds of axis that are not yet there, chosen on the tuning seeds."""
    for name in kinds:
        own = chosen.setdefault(name, {})
        for arm, (_, values) in CHOICES.items():
            if arm in own:
                continue
            scores = {}
            for value in values:
                make = made({name: {arm: value}}, name, arm)
                found = [figures(closed(name, motion, seed, make))["rms"] for seed in TUNING for motion in REFERENCES]
                scores[value] = float(np.exp(np.mean(np.log(found))))
            own[arm] = min(scores, key=scores.__getitem__)
            print(name, arm, scores, flush=True)
    return chosen


def measure(chosen: dict, seeds: range, kinds: Iterable[str], arms: Iterable[str], table: dict) -> dict:
    """Figures of every kind of axis, reference, arm and seed, in the places of those in ``table``."""
    for name in kinds:
        for motion in REFERENCES:
            begun = time.process_time()
            for arm in arms:
                rows = [figures(closed(name, motion, seed, made(chosen, name, arm))) for seed in seeds]
                columns = {key: [float(f"{row[key]:.5g}") for row in rows] for key in rows[0]}
                table.setdefault(name, {}).setdefault(motion, {})[arm] = columns
            told = {arm: float(np.median(table[name][motion][arm]["rms"])) for arm in arms}
            print(f"{name} {motion}: {told} {time.process_time() - begun:.0f} s", flush=True)
    return table


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--tune", action="store_true", help="tune anew")
    parser.add_argument("--arms", nargs="+", choices=ARMS, default=list(ARMS), help="measure these, keep the others")
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=MEASURED, help="measure these, keep the others")
    for part in (*PARTS, "page"):
        parser.add_argument(f"--{part}", action="store_true")
    arguments = parser.parse_args()
    import compensation_report as report

    tuned_file = RESULTS / "compensation_tuned.json"
    chosen = {} if arguments.tune or not tuned_file.exists() else json.loads(tuned_file.read_text(encoding="utf-8"))
    if any(set(CHOICES) - set(chosen.get(name, {})) for name in arguments.kinds) and not arguments.page:
        tuned_file.write_text(json.dumps(tune(chosen, arguments.kinds), indent=1) + "\n", encoding="utf-8")
    asked = [name for name in PARTS if getattr(arguments, name)]
    if asked:
        for name in asked:
            getattr(import_module(PARTS[name]), name)(chosen, arguments.kinds)
    elif not arguments.page:
        seeds, file = [FIRST, FIRST + arguments.seeds - 1], RESULTS / "compensation.json"
        before = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {"seeds": seeds, "table": {}}
        whole = set(arguments.arms) == set(ARMS)
        if before["seeds"] != seeds and not whole:
            raise SystemExit(f"{file.name} holds seeds {before['seeds']}: measure all arms")
        kept = before["table"] if before["seeds"] == seeds and arguments.seeds >= 20 else {}
        table = measure(chosen, range(FIRST, seeds[1] + 1), arguments.kinds, arguments.arms, kept)
        result = {"seeds": seeds, "table": {name: table[name] for name in KINDS if name in table}}
        if arguments.seeds < 20:
            print(report.text(result, chosen))
            return
        file.write_text(json.dumps(result) + "\n", encoding="utf-8")
    report.write(chosen)


if __name__ == "__main__":
    main()
