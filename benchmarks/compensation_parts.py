"""Further parts of benchmarks/compensation.py: stability, and time of a cycle."""

from __future__ import annotations

import gc
import os
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterable
from dataclasses import replace
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
    figures,
    limit_cycle,
    made,
)
from compensation_plants import KINDS, LOAD, Draw, draw
from compensation_report import keep, kept, save

from frictionpinn.control import Compensator, reference
from frictionpinn.control.references import stroke
from frictionpinn.export.compensator import write_compensator_c

GAINS = (1.0, 1.25, 1.5, 2.0, 3.0)
RANDOM, EACH = 5000, 25  # first seed of the random axes, which no choice has seen; axes of each kind
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


CASES = {  # arms that random axes are given
    "no compensation": lambda chosen, name: default("none")(name),
    "our estimator, default": lambda chosen, name: default("estimator")(name),
    "our estimator, bandwidth as tuned": lambda chosen, name: made(chosen, name, "estimator"),
}


def margins(chosen: dict, kinds: Iterable[str] = tuple(KINDS)) -> None:
    """Random axes under load at the default settings, and the largest over-compensation that a loop bears."""
    found = kept("stability", kinds)
    for name in kinds:
        found[name] = {"cycles": {title: _cycles(arm(chosen, name), name) for title, arm in CASES.items()}}
        found[name]["gains"] = {arm: _margin(chosen, name, arm) for arm in ARMS if arm != "none"}
        keep("stability", found, _stability)


def _cycles(make: Callable, name: str) -> list[str]:
    """Random axes of a kind that have a limit cycle, with the motion."""
    return [
        f"{name} {seed}, {motion}"
        for seed in range(RANDOM + 1, RANDOM + 1 + 2 * EACH, 2)  # odd seeds carry the load
        for motion in STABILITY
        if unstable(closed(name, motion, seed, make, holds=RESTS))
    ]


def _stability(found: dict) -> list[str]:
    lines = [
        "python benchmarks/compensation.py --margins",
        f"limit cycle: three turns or more by over three steps of the encoder in {RESTS:g} s at rest, or motion",
        f"against the reference in more than {100 * BACKWARDS:g} % of the samples later than {AFTER:g} s after a turn",
        "default: conf/control/estimator.yaml, and half of the first resonance where that is below its bandwidth",
        "",
        f"{EACH * len(found)} random axes ({EACH} of each kind, seeds from {RANDOM}), parameters 20 % wrong, "
        f"load +{100 * (LOAD - 1):g} %: axes with a limit cycle",
    ]
    for title in CASES:
        texts = [text for name in found for text in found[name]["cycles"][title]]
        axes = {text.partition(",")[0] for text in texts}
        told = f" ({'; '.join(texts)})" if texts else ""
        lines.append(f"  {title:<40} {len(axes):>3} of {EACH * len(found)}{told}")
    lines += [
        "",
        f"largest gain of the added torque, of {', '.join(f'{g:g}' for g in GAINS)}, before a limit cycle on",
        f"{' or '.join(STABILITY)}; smallest of seeds {FIRST} and {FIRST + 1}, the latter with the load",
        f"  {'':<34}" + "".join(f"{name:>10}" for name in found),
    ]
    for arm in [name for name in ARMS if name != "none"]:
        lines.append(f"  {ARMS[arm]:<34}" + "".join(f"{found[name]['gains'][arm]:>10}" for name in found))
    return lines


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


def anywhere(it: Draw) -> Compensator:
    """Our estimator, its places learned however fast they pass."""
    own = compensator("estimator", it)
    assert own is not None
    own.plan = own.plan._replace(passing=1e9)
    return own


FASTER = dict.fromkeys(config("estimator")["adapt"], 0.1)
WAYS: dict[str, Callable[[Draw], Compensator | None]] = {
    "our estimator, default": lambda it: compensator("estimator", it),
    "parameters change by 10 % in a second": lambda it: compensator("estimator", it, adapt=FASTER),
    "places learned at any speed": anywhere,
    "nothing learned by place": lambda it: compensator("estimator", it, uneven=0.0),
    "nothing learned but the disturbance": lambda it: compensator("estimator", it, uneven=0.0, adapt={}, spread={}),
    "bandwidth 60 Hz": lambda it: compensator("estimator", it, bandwidth=60.0),
}
TRIED = 4200  # first seed of the random axes on which ways of learning were compared and chosen
SHARP = ("drive", "stage")  # axes whose slow triangle is near stick-slip with the PID alone


def ways(chosen: dict, kinds: Iterable[str] = SHARP) -> None:
    """Ways of learning on the same random axes: limit cycles, and error relative to the default."""
    kinds, seeds = [name for name in kinds if name in SHARP], range(TRIED + 1, TRIED + 1 + 4 * EACH, 2)
    lines = [
        "python benchmarks/compensation.py --ways",
        f"{len(seeds) * len(kinds)} random axes ({', '.join(kinds)}; seeds from {TRIED}, on which ways were compared), "
        f"{' and '.join(STABILITY)},",
        f"parameters 20 % wrong, load +{100 * (LOAD - 1):g} %; limit cycles as in compensation_stability.txt",
        "",
        f"  {'':<40}{'motions with a':>16}{'rms error over that of the default':>40}",
        f"  {'':<40}{'limit cycle':>16}{'median, 90 %, worst':>40}",
    ]
    first = np.ones(0)
    for title, make in WAYS.items():
        runs = [(name, seed, motion) for name in kinds for seed in seeds for motion in STABILITY]
        cycles, errors = 0, []
        for name, seed, motion in runs:
            found = closed(name, motion, seed, make, holds=RESTS)
            cycles += unstable(found)
            errors.append(figures(found)["rms"])
        first = first if len(first) else np.array(errors)
        share = np.array(errors) / first
        told = f"{np.median(share):.2f}, {np.quantile(share, 0.9):.2f}, {share.max():.3g}"
        lines.append(f"  {title:<40}{f'{cycles} of {len(runs)}':>16}{told:>40}")
    save("ways", lines)


_CLOCKED = """#define _POSIX_C_SOURCE 199309L
#include <stdio.h>
#include <time.h>
#include "compensator.h"
static compensator c;
int main(int count, char **words)
{
    const clockid_t clock = count > 1 && words[1][0] == 'c' ? CLOCK_PROCESS_CPUTIME_ID : CLOCK_MONOTONIC;
    double r[3], q, u, sum = 0.0;
    compensator_reset(&c);
    while (scanf("%lf %lf %lf %lf %lf", &r[0], &r[1], &r[2], &q, &u) == 5) {
        struct timespec a, b, d;
        clock_gettime(clock, &a);
        clock_gettime(clock, &b);
        sum += compensator_update(&c, r, q, u).torque;
        clock_gettime(clock, &d);
        printf("%ld %ld\\n", (b.tv_sec - a.tv_sec) * 1000000000L + b.tv_nsec - a.tv_nsec,
               (d.tv_sec - b.tv_sec) * 1000000000L + d.tv_nsec - b.tv_nsec);
    }
    return sum > 1e300;
}
"""
CYCLES, IN_PYTHON = 50_000, 10_000
CLOCKS = {"wall": time.perf_counter, "cpu": time.process_time}


def latency(chosen: dict, kinds: Iterable[str] = ("drive", "joint")) -> None:
    """Time of one cycle on one core: the exported C, and Python."""
    lines = [
        "python benchmarks/compensation.py --latency",
        f"one cycle of {CYCLES} ({IN_PYTHON} in Python) on one core, microseconds:",
        "wall is the time that passed, cpu the process's own; each holds what 'clock' says that a reading of it takes;",
        f"other programs ran beside it (load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores): "
        "what wall has beyond cpu is theirs",
        "",
        f"  {'':<36}{'':<14}{'':<6}{'median':>10}{'99 %':>10}{'worst':>10}{'clock':>10}",
    ]
    for name, arm in (("drive", "estimator"), ("joint", "estimator"), ("drive", "feedforward"),
                      ("drive", "disturbance_observer")):  # fmt: skip
        if name not in kinds:
            continue
        path = reference("sine", KINDS[name].amplitude, 2.0)
        it = replace(draw(name, FIRST), stroke=stroke([path], MOVES))
        own = made(chosen, name, arm)(it)
        assert own is not None
        t = np.arange(CYCLES) * INTERVAL
        wanted = path(t)
        rng = np.random.default_rng(0)
        rows = np.column_stack(
            [wanted, wanted[:, 0] + it.plant.resolution * rng.normal(size=len(t)), rng.normal(size=len(t))]
        )
        for kind, spent in {"C99 (cc -O2)": _in_c(own, rows), "Python": _in_python(own, rows[:IN_PYTHON])}.items():
            for clock, (empty, times) in spent.items():
                told = (np.median(times), np.quantile(times, 0.99), times.max(), np.median(empty))
                lines.append(
                    f"  {name + ', ' + ARMS[arm]:<36}{kind:<14}{clock:<6}" + "".join(f"{v:>10.2f}" for v in told)
                )
    save("latency", lines)


def _in_c(own, rows: np.ndarray) -> dict[str, np.ndarray]:
    """Microseconds of nothing and of a cycle by clock, shape (2, n)."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        write_compensator_c(folder, own)
        (folder / "main.c").write_text(_CLOCKED, encoding="ascii")
        program = folder / "main"
        files = [folder / "main.c", folder / "compensator.c"]
        subprocess.run(["cc", "-std=c99", "-O2", "-o", program, *files, "-lm"], check=True)
        text = "\n".join(" ".join(map(repr, row)) for row in rows.tolist())
        spent = {}
        for clock in CLOCKS:
            said = subprocess.run([program, clock], input=text, capture_output=True, text=True, check=True).stdout
            spent[clock] = np.array(said.split(), dtype=float).reshape(-1, 2)[1:].T / 1e3
    return spent


def _in_python(own, rows: np.ndarray) -> dict[str, np.ndarray]:
    """The same in Python."""
    own.update(rows[0, :3], rows[0, 3], rows[0, 4])  # compiles
    found = {}
    for clock, now in CLOCKS.items():
        spent = np.zeros((2, len(rows)))
        own.reset()
        gc.disable()
        for k, row in enumerate(rows):
            before, begun = now(), now()
            own.update(row[:3], row[3], row[4])
            spent[:, k] = begun - before, now() - begun
        gc.enable()
        found[clock] = 1e6 * spent[:, 1:]
    return found
