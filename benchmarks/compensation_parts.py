"""Further parts of benchmarks/compensation.py: stability, time of a cycle, and the whole chain with a diagnosis."""

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
    DELAY,
    FIRST,
    INTERVAL,
    MOVES,
    RESULTS,
    SETTLES,
    closed,
    compensator,
    config,
    controller,
    figures,
    limit_cycle,
    made,
)
from compensation_plants import KINDS, LOAD, Draw, draw

from frictionpinn.control import Compensator, close, reference
from frictionpinn.control.record import recorded
from frictionpinn.errors import UserError
from frictionpinn.export.compensator import write_compensator_c
from frictionpinn.physics.mechanism import Mechanism
from frictionpinn.workflow.compensate import identified

EFFECTS = ("asymmetry", "position_friction", "ripple")  # that a diagnosis tries: those of the axes
TRIED = ("slow triangle", "reversing sine", "point to point", "multisine")
DIAGNOSED = (FIRST, FIRST + 1)  # seeds: without and with the load
GAINS = (1.0, 1.25, 1.5, 2.0, 3.0)
RANDOM, EACH = 2000, 25  # first seed of the random axes, axes of each kind
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
        counts = {}
        for name in KINDS:
            seeds = range(RANDOM + 1, RANDOM + 1 + 2 * EACH, 2)  # odd seeds carry the load
            runs = [[closed(name, m, seed, arm(name), holds=RESTS) for m in STABILITY] for seed in seeds]
            counts[name] = sum(any(map(unstable, loops)) for loops in runs)
        told = ", ".join(f"{name} {count}" for name, count in counts.items())
        lines.append(f"  {title:<40} {sum(counts.values()):>3} of {EACH * len(KINDS)} ({told})")
        print(lines[-1], flush=True)
    _save("stability", lines)
    lines += [
        "",
        f"largest gain of the added torque, of {', '.join(f'{g:g}' for g in GAINS)}, before a limit cycle on",
        f"{' or '.join(STABILITY)}; smallest of seeds {FIRST} and {FIRST + 1}, the latter with the load",
        f"  {'':<34}" + "".join(f"{name:>10}" for name in KINDS),
    ]
    for arm_name in [name for name in ARMS if name != "none"]:
        cells = [f"{_margin(chosen, name, arm_name):>10}" for name in KINDS]
        lines.append(f"  {ARMS[arm_name]:<34}" + "".join(cells))
    _save("stability", lines)


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
    _save("latency", lines)


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


def diagnosed(chosen: dict) -> None:
    """The missing effect, diagnosed on recordings with the PID alone and added before compensating."""
    lines = [
        "python benchmarks/compensation.py --diagnosed",
        "identified from 12 s with the PID alone (encoder and torque at 100 Hz), believed parameters 20 % wrong as",
        f"starts; effects tried: {', '.join(EFFECTS)}; rms error, LuGre alone and with what the diagnosis added,",
        f"medians over {', '.join(TRIED)}",
        "",
    ]
    rows = []
    for name in KINDS:
        for seed in DIAGNOSED:
            try:
                rows.append(_diagnosed(chosen, name, seed))
                lines.append(rows[-1]["line"])
            except UserError as error:
                lines.append(f"  {name} {seed}: could not be identified ({error})")
            print(lines[-1], flush=True)
    for arm in ("feedforward", "estimator"):
        better = {r["name"] for r in rows if r["found"] and r[arm] < 1.0}
        lines.append(f"{ARMS[arm]}: a lower median with the added effect in {', '.join(sorted(better)) or 'no'} axes")
    _save("diagnosed", lines)


def _diagnosed(chosen: dict, name: str, seed: int) -> dict:
    kind, it = KINDS[name], draw(name, seed)
    shapes = (("triangle", 4.0, 1.0), ("sine", 2.0, 1.0), ("multisine", 3.0, 1.3), ("sine", 1.0, 0.7))
    alone = {
        str(k + 1): close(it.plant, controller(name), reference(shape, size * kind.amplitude, period), 3.0, None,
                          (it.model, it.believed), INTERVAL, DELAY)
        for k, (shape, period, size) in enumerate(shapes)
    }  # fmt: skip
    system = {key: it.believed[key] for key in ("M", "J", "W_cos", "W_sin") if key in it.believed}
    declared = Mechanism(type(it.model.system)(**system), it.model.law)
    law = [par.name for par in declared.law.parameters if par.value is None]
    free = [*law, *(key for key, value in system.items() if value)]
    recording = recorded(alone, declared, DELAY, 100.0)
    begun, models = time.time(), {}
    with tempfile.TemporaryDirectory() as place:
        for case, effects in (("alone", []), ("added", list(EFFECTS))):
            options = {"free": free, "start": {key: it.believed[key] for key in free}}
            models[case] = identified(declared, recording, Path(place), effects=effects, **options)
    told = {}
    for arm in ("feedforward", "estimator"):
        medians = {}
        for case, (mechanism, values, _) in models.items():
            found = Draw(it.plant, mechanism, values, it.loaded)
            rms = [figures(closed(name, motion, seed, made(chosen, name, arm), found))["rms"] for motion in TRIED]
            medians[case] = float(np.median(rms))
        told[arm] = medians
    mechanism, _, verdict = models["added"]
    names = [effect.name for effect in mechanism.effects]
    scale = 1e6
    cells = "; ".join(f"{ARMS[arm]} {scale * m['alone']:.3g} to {scale * m['added']:.3g}" for arm, m in told.items())
    line = (f"  {name} {seed}: true effect {kind.effect}; {verdict}: {', '.join(names) or 'nothing'} "
            f"({time.time() - begun:.0f} s); rms in µ: {cells}")  # fmt: skip
    return {"name": name, "found": bool(names), "line": line,
            **{arm: m["added"] / m["alone"] for arm, m in told.items()}}  # fmt: skip


def _save(name: str, lines: list[str]) -> None:
    text = "\n".join(lines) + "\n"
    (RESULTS / f"compensation_{name}.txt").write_text(text, encoding="utf-8")
    print(text)
