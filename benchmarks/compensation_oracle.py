"""What stands between an arm and the oracle: each piece of knowledge given to our estimator alone, then all of it.

    python benchmarks/compensation.py --oracle

The oracle is told what no arm can measure beforehand: the undeclared effect with its size, every parameter, the load
and the delay. A rung of the table gives one of these to our estimator and leaves the rest as it is; the encoder's rung
gives a finer encoder to arm and oracle alike, the last lets both move for longer before errors count. Beside them is
the oracle itself, told the delay that all other arms believe in. Seeds are those on which arms are tuned.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

import numpy as np
from compensation import CHOICES, DELAY, INTERVAL, REFERENCES, TUNING, closed, compensator, config, figures
from compensation_plants import KINDS, Draw
from compensation_report import keep, kept

from frictionpinn.control import Compensator
from frictionpinn.control.build import build_compensator

SYSTEM = ("M", "J", "W_cos", "W_sin", "preload")
FINER = 100.0  # times as many steps of the encoder
LATER = (14.0, 18.0)  # s: when errors count in the last rung, instead of 2 to 6 s
WITHIN = 1.5  # times the oracle's error: what is asked of our estimator
RUNGS: dict[str, tuple[str, ...]] = {
    "as it is": (),
    "knows the delay": ("delay",),
    "knows mass, gravity and load": ("system",),
    "knows the law's parameters": ("law",),
    "knows the effect": ("effect",),
    "knows effect and parameters": ("effect", "law", "system"),
    "knows all": ("effect", "law", "system", "delay"),
}


def told(it: Draw, knows: tuple[str, ...], options: dict[str, Any]) -> Compensator | None:
    """Our estimator with true values in the place of what is believed."""
    truth, believed, model = it.plant.parameters, dict(it.believed), it.model
    if "effect" in knows:
        model = it.plant.mechanism
        believed |= {name: value for name, value in truth.items() if name not in believed}
    for name in believed:
        if ("system" if name in SYSTEM else "law") in knows:
            believed[name] = truth[name]
    delay = it.plant.delay if "delay" in knows else DELAY
    loop = {"interval": INTERVAL, "delay": delay, "resolution": it.plant.resolution, "known": it.believed,
            "stroke": it.stroke}  # fmt: skip
    return build_compensator(config("estimator", **options), model, believed, **loop)


def late(it: Draw) -> Compensator:
    """The oracle, which does not know its axis's delay."""
    return Compensator(it.plant.mechanism, it.plant.parameters, known=it.believed, interval=INTERVAL, delay=DELAY)


def finer(it: Draw) -> Draw:
    """The axis with a finer encoder."""
    return replace(it, plant=replace(it.plant, resolution=it.plant.resolution / FINER))


def oracle(chosen: dict, kinds: Iterable[str] = tuple(KINDS)) -> None:
    """Rms error of every rung relative to the oracle's, medians over seeds."""
    found, last = kept("oracle", kinds), "knows all"
    for name in kinds:
        chosen_here = {CHOICES["estimator"][0]: chosen[name]["estimator"]}
        wide = {key: 2 * value for key, value in chosen_here.items()}
        base = {motion: _rms(name, motion, lambda it: compensator("oracle", it)) for motion in REFERENCES}
        fine = {motion: _rms(name, motion, lambda it: compensator("oracle", it), finer) for motion in REFERENCES}
        rows: dict[str, list[float]] = {}
        for title, knows in RUNGS.items():
            rows[title] = [_ratio(name, m, _maker(knows, chosen_here), base[m]) for m in REFERENCES]
        nothing = {**chosen_here, "uneven": 0.0, "adapt": {}, "spread": {}}
        rows[f"{last}, learns nothing"] = [_ratio(name, m, _maker(RUNGS[last], nothing), base[m]) for m in REFERENCES]
        rows["bandwidth twice as high"] = [_ratio(name, m, _maker((), wide), base[m]) for m in REFERENCES]
        rows[f"the oracle, told {1e3 * DELAY:g} ms"] = [_ratio(name, m, late, base[m]) for m in REFERENCES]
        rows["finer encoder, both"] = [_ratio(name, m, _maker((), chosen_here), fine[m], finer) for m in REFERENCES]
        found[name] = rows
        rows[f"errors from {LATER[0]:g} to {LATER[1]:g} s, both"] = [
            float(
                np.median(
                    _late(name, m, _maker((), chosen_here)) / _late(name, m, lambda it: compensator("oracle", it))
                )
            )
            for m in REFERENCES
        ]
        keep("oracle", found, _table)


def _late(name: str, motion: str, make: Callable) -> np.ndarray:
    runs = [closed(name, motion, seed, make, holds=0.0, moves=LATER[1]) for seed in TUNING]
    return np.array([figures(loops, *LATER)["rms"] for loops in runs])


def _table(found: dict) -> list[str]:
    width = 34
    lines = [
        "python benchmarks/compensation.py --oracle",
        f"our estimator's rms error over the oracle's, medians over seeds {TUNING[0]} to {TUNING[-1]}; each row",
        f"gives it one piece of what the oracle knows; wanted: at most {WITHIN:g}",
    ]
    for name, rows in found.items():
        lines += ["", f"  {name:<{width}}" + "".join(f"{text:>16}" for text in REFERENCES)]
        for title, cells in rows.items():
            lines.append(f"    {title:<{width - 2}}" + "".join(f"{cell:>16.2f}" for cell in cells))
    lines += ["", f"settings within {WITHIN:g} times the oracle's, of {len(found) * len(REFERENCES)}"]
    for title in next(iter(found.values())):
        count = sum(cell <= WITHIN for rows in found.values() for cell in rows[title])
        lines.append(f"    {title:<{width - 2}}{count:>4}")
    return lines


def _maker(knows: tuple[str, ...], options: dict[str, Any]) -> Callable[[Draw], Compensator | None]:
    return lambda it: told(it, knows, options)


def _rms(name: str, motion: str, make: Callable, change: Callable[[Draw], Draw] = lambda it: it) -> np.ndarray:
    return np.array([figures(closed(name, motion, seed, make, change))["rms"] for seed in TUNING])


def _ratio(name: str, motion: str, make: Callable, base: np.ndarray, change: Callable = lambda it: it) -> float:
    return float(np.median(_rms(name, motion, make, change) / base))
