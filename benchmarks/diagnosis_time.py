"""Time of a diagnosis of six trials over all effects, alone on all cores, with compiled code warm.

    python benchmarks/diagnosis_time.py [--from-seed 72] [--repeats 1] [--slowest] [--only clean,drag,...]

Blind recordings as in blind.py: a clean one and one of every effect that it names; ``--slowest`` those that took
longest of all that were tried. Beside each, the processor time of the command, since other work may share the machine,
and how fast that was just before: 1e7 additions in a loop of Python.
Writes benchmarks/results/diagnosis_time.txt (half a minute per recording), with ``--slowest``
diagnosis_time_slowest.txt.
"""

from __future__ import annotations

import argparse
import os
import platform
import resource
import time

import numpy as np
from blind import NAMED, RESULTS, right, run

LIMIT_S = 60.0  # what a diagnosis may take on two cores
SLOWEST = {
    "sensor_bias": (29,), "sensor_delay": (17,), "constant_force": (23, 33, 37, 75), "spring_force": (35, 74, 84, 85),
    "asymmetry": (31, 74), "com_offset": (16, 41), "low_speed": (36,), "payload": (17,), "sensor_scale": (75,),
}  # fmt: skip


def additions_s() -> float:
    """Time of 1e7 additions, s: what a core of this machine does at the moment."""
    began, total = time.perf_counter(), 0
    for k in range(10_000_000):
        total += k
    return time.perf_counter() - began


def processor_s() -> float:
    """Processor time of all commands so far, s."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def report(cases: list[dict], name: str) -> None:
    lines = [
        f"{platform.processor() or platform.machine()}, {len(os.sched_getaffinity(0))} cores; s",
        f"{'recording':28s}{'diagnosis':>10s}{'command':>9s}{'processor':>11s}{'1e7 additions':>15s}  right",
    ]
    for c in cases:
        lines.append(
            f"{c['kind']:22s}{c['seed']:6d}{c['diagnosis_s']:10.1f}{c['command_s']:9.1f}{c['processor_s']:11.1f}"
            f"{c['additions_s']:15.2f}"
            f"  {'yes' if right(c) else 'NO'}"
        )
    seconds = np.array([c["diagnosis_s"] for c in cases])
    lines.append(
        f"diagnosis: median {np.median(seconds):.1f} s, longest {seconds.max():.1f} s; "
        f"{int((seconds <= LIMIT_S).sum())} of {len(seconds)} within {LIMIT_S:.0f} s"
    )
    print("\n".join(lines))
    (RESULTS / name).write_text("\n".join(lines) + "\n")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--from-seed", type=int, default=72)
    parser.add_argument("--repeats", type=int, default=1)
    parser.add_argument("--slowest", action="store_true")
    parser.add_argument("--only", default="")
    args = parser.parse_args()
    seeds = range(args.from_seed, args.from_seed + args.repeats)
    tasks = [(kind, seed) for seed in seeds for kind in ("clean", *NAMED)]
    if args.slowest:
        tasks = [(kind, seed) for kind, own in SLOWEST.items() for seed in own]
    tasks = [task for task in tasks if not args.only or task[0] in args.only.split(",")]
    run(*tasks[0])  # whatever is not compiled yet
    cases = []
    for kind, seed in tasks:
        speed, before = additions_s(), processor_s()
        case = run(kind, seed)
        cases.append({**case, "additions_s": speed, "processor_s": processor_s() - before})
        report(cases, "diagnosis_time_slowest.txt" if args.slowest else "diagnosis_time.txt")


if __name__ == "__main__":
    main()
