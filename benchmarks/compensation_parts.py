"""Further parts of benchmarks/compensation.py: stability, and time of a cycle."""

from __future__ import annotations

import gc
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from compensation import (
    ARMS,
    FIRST,
    INTERVAL,
    MOVES,
    SETTLES,
    closed,
    compensator,
    config,
    limit_cycle,
    made,
)
from compensation_plants import KINDS, LOAD, Draw, draw
from compensation_report import save

from frictionpinn.control import Compensator, reference
from frictionpinn.export.compensator import write_compensator_c

GAINS = (1.0, 1.25, 1.5, 2.0, 3.0)
RANDOM, EACH = 3000, 20  # first seed of the random axes, which no choice has seen; axes of each kind
STABILITY = ("slow triangle", "point to point")
RESTS = 3.0  # s, at rest after a motion
AFTER = 0.25  # s after a turn or a start of the reference, in which an axis may still turn
BACKWARDS = 0.02  # share of the other samples in which it may move against the reference


def unstable(found: list) -> bool:
    """Whether an axis goes to and fro: at rest after the motion, or against its reference within it."""
    for loop, _ in found:
        v = loop.reference[:, 1]
        fast = np.abs(v) > 0.2 * np.abs(v).max()
        for k in np.flatnonzero(np.sign(v[1:]) != np.sign(v[:-1])):
            fast[k : k + round(AFTER / INTERVAL)] = False
        if np.mean((loop.velocity * v < 0)[fast]) > BACKWARDS:
            return True
    return any(limit_cycle(loop.position[loop.t >= MOVES + SETTLES], it.plant.resolution) for loop, it in found)


def margins(chosen: dict) -> None:
    """Random axes under load at the default settings, and the largest over-compensation that a loop bears."""
    lines = [
        "python benchmarks/compensation.py --margins",
        f"limit cycle: three turns or more by over three steps of the encoder in {RESTS:g} s at rest, or motion",
        f"against the reference in more than {100 * BACKWARDS:g} % of the samples later than {AFTER:g} s after a turn",
        "default: conf/control/estimator.yaml, and half of the first resonance where that is below its bandwidth",
        "",
        f"{EACH * len(KINDS)} random axes ({EACH} of each kind, seeds from {RANDOM}), parameters 20 % wrong, "
        f"load +{100 * (LOAD - 1):g} %: axes with a limit cycle",
    ]
    cases = {
        "no compensation": default("none"),
        "our estimator, default": default("estimator"),
        "our estimator, bandwidth as tuned": lambda name: made(chosen, name, "estimator"),
    }
    for title, arm in cases.items():
        found = [
            f"{name} {seed}, {motion}"
            for name in KINDS
            for seed in range(RANDOM + 1, RANDOM + 1 + 2 * EACH, 2)  # odd seeds carry the load
            for motion in STABILITY
            if unstable(closed(name, motion, seed, arm(name), holds=RESTS))
        ]
        axes = {text.partition(",")[0] for text in found}
        told = f" ({'; '.join(found)})" if found else ""
        lines.append(f"  {title:<40} {len(axes):>3} of {EACH * len(KINDS)}{told}")
        save("stability", lines)
    lines += [
        "",
        f"largest gain of the added torque, of {', '.join(f'{g:g}' for g in GAINS)}, before a limit cycle on",
        f"{' or '.join(STABILITY)}; smallest of seeds {FIRST} and {FIRST + 1}, the latter with the load",
        f"  {'':<34}" + "".join(f"{name:>10}" for name in KINDS),
    ]
    for arm_name in [name for name in ARMS if name != "none"]:
        cells = [f"{_margin(chosen, name, arm_name):>10}" for name in KINDS]
        lines.append(f"  {ARMS[arm_name]:<34}" + "".join(cells))
    save("stability", lines)


def default(arm: str) -> Callable[[str], Callable[[Draw], Compensator | None]]:
    """An arm as conf/control has it, its bandwidth at most half of the axis's first resonance."""
    if arm == "none":
        return lambda name: lambda it: None
    most = float(config(arm)["bandwidth"])
    return lambda name: lambda it: compensator(arm, it, bandwidth=min(most, KINDS[name].resonance / 2))


def _margin(chosen: dict, name: str, arm: str) -> str:
    best = 0.0
    for gain in GAINS:
        make = made(chosen, name, arm, gain=gain)
        runs = [(motion, seed) for motion in STABILITY for seed in (FIRST, FIRST + 1)]
        if any(unstable(closed(name, motion, seed, make, holds=RESTS)) for motion, seed in runs):
            break
        best = gain
    print(name, arm, best, flush=True)
    return f"{best:g}" if 0 < best < GAINS[-1] else (f"over {best:g}" if best else "below 1")


_CLOCKED = """#define _POSIX_C_SOURCE 199309L
#include <stdio.h>
#include <time.h>
#include "compensator.h"
static compensator c;
int main(void)
{
    double r[3], q, u, sum = 0.0;
    compensator_reset(&c);
    while (scanf("%lf %lf %lf %lf %lf", &r[0], &r[1], &r[2], &q, &u) == 5) {
        struct timespec a, b;
        clock_gettime(CLOCK_MONOTONIC, &a);
        sum += compensator_update(&c, r, q, u).torque;
        clock_gettime(CLOCK_MONOTONIC, &b);
        printf("%ld\\n", (b.tv_sec - a.tv_sec) * 1000000000L + b.tv_nsec - a.tv_nsec);
    }
    return sum > 1e300;
}
"""


def latency(chosen: dict) -> None:
    """Time of one cycle on one core: the exported C, and Python."""
    lines = ["python benchmarks/compensation.py --latency", "one cycle of 50000 on one core, microseconds", ""]
    for name, arm in (("drive", "estimator"), ("joint", "estimator"), ("drive", "feedforward"),
                      ("drive", "disturbance_observer")):  # fmt: skip
        it = draw(name, FIRST)
        own = made(chosen, name, arm)(it)
        assert own is not None
        t = np.arange(50_000) * INTERVAL
        wanted = reference("sine", KINDS[name].amplitude, 2.0)(t)
        rng = np.random.default_rng(0)
        rows = np.column_stack(
            [wanted, wanted[:, 0] + it.plant.resolution * rng.normal(size=len(t)), rng.normal(size=len(t))]
        )
        spent = {"C99 (cc -O2)": _in_c(own, rows), "Python": _in_python(own, rows)}
        for kind, times in spent.items():
            lines.append(f"  {name + ', ' + ARMS[arm]:<34} {kind:<14} median {np.median(times):8.2f}  "
                         f"99 % {np.quantile(times, 0.99):8.2f}  worst {times.max():8.2f}")  # fmt: skip
    save("latency", lines)


def _in_c(own, rows: np.ndarray) -> np.ndarray:
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        write_compensator_c(folder, own)
        (folder / "main.c").write_text(_CLOCKED, encoding="ascii")
        program = folder / "main"
        files = [folder / "main.c", folder / "compensator.c"]
        subprocess.run(["cc", "-std=c99", "-O2", "-o", program, *files, "-lm"], check=True)
        text = "\n".join(" ".join(map(repr, row)) for row in rows.tolist())
        said = subprocess.run([program], input=text, capture_output=True, text=True, check=True).stdout
    return np.array(said.split(), dtype=float)[1:] / 1e3


def _in_python(own, rows: np.ndarray) -> np.ndarray:
    spent = np.zeros(len(rows))
    own.reset()
    own.update(rows[0, :3], rows[0, 3], rows[0, 4])
    own.reset()
    gc.disable()
    for k, row in enumerate(rows):
        begun = time.perf_counter()
        own.update(row[:3], row[3], row[4])
        spent[k] = time.perf_counter() - begun
    gc.enable()
    return 1e6 * spent[1:]
