"""Time and memory of a diagnosis against the number of trials and of samples, up to 500,000 samples.

    python benchmarks/diagnosis_scaling.py [--most 500000]

The trials of the pendulum on a box, as its own file has them, with 5 % noise on every signal, LuGre friction declared
and an undeclared constant force; more trials are the same ones again, each with its own noise, more samples the same
ones at a higher rate. Each diagnosis is a process of its own, alone, after one that compiles what it needs; its
processor time is that of all threads, its memory the largest that it held. A case is kept in
benchmarks/results/diagnosis_scaling.json and not asked again; writes diagnosis_scaling.txt.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import time

from identify_scaling import ROOT, exponent
from omegaconf import OmegaConf

from frictionpinn.data.noise import GaussianNoise
from frictionpinn.data.recording import Recording, Trial
from frictionpinn.data.simulated import simulate_recording
from frictionpinn.diagnose.diagnosis import diagnose
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.mechanism import Mechanism

RESULTS = ROOT / "benchmarks" / "results"
LEVEL, RATE_HZ, FORCE_N = 0.05, 400.0, 0.1  # noise; samples in a second where trials are counted; what is undeclared
SIZES = (1, 2, 5, 12, 30, 86)  # times the trials, or the samples in a second


def recording(copies: int, rate_hz: float) -> tuple[Mechanism, Recording]:
    """The declared mechanism, and its trials ``copies`` times."""
    declared = OmegaConf.to_container(OmegaConf.load(ROOT / "conf" / "system" / "pob.yaml"), resolve=True)
    system, made = SYSTEMS["pob"](**declared["parameters"]), declared["simulate"]
    truth = made["truth"] | {"constant_force": FORCE_N}
    clean = simulate_recording(system, made["friction"], truth, made["trials"], rate_hz, ("constant_force",))
    copied = [Trial(f"{k}_{n}", t.t, t.signals) for k in range(copies) for n, t in enumerate(clean.trials)]
    return Mechanism(system, LAWS[made["friction"]]()), GaussianNoise(LEVEL)(Recording(tuple(copied), clean.units), 0)


def measured(kind: str, size: int) -> dict:
    """One diagnosis in this process; every fifth trial is held out."""
    mechanism, whole = recording(*((size, RATE_HZ) if kind == "trials" else (1, size * RATE_HZ)))
    names = [trial.name for trial in whole.trials]
    kept, held_out = [n for k, n in enumerate(names, 1) if k % 5], names[4::5]
    began, cpu = time.perf_counter(), time.process_time()
    found = diagnose(mechanism, whole.select(kept), whole.select(held_out))
    return {
        "trials": len(names), "samples": len(whole), "seconds": time.perf_counter() - began,
        "processor_s": time.process_time() - cpu, "effects": [a.candidate.name for a in found.accepted],
        "memory_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    }  # fmt: skip


def table(kind: str, cases: list[dict]) -> list[str]:
    lines = [f"{'trials':>10s}{'samples':>10s}{'seconds':>10s}{'processor s':>13s}{'memory MB':>11s}  found"]
    lines += [f"{c['trials']:10d}{c['samples']:10d}{c['seconds']:10.1f}{c['processor_s']:13.1f}{c['memory_mb']:11.0f}"
              f"  {', '.join(c['effects']) or 'nothing'}" for c in cases]  # fmt: skip
    if len(cases) > 1:
        power = exponent([c["samples"] for c in cases], [c["processor_s"] for c in cases])
        lines.append(f"processor time grows with the samples, by more {kind}, to the power {power:.2f}")
    return [*lines, ""]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--most", type=int, default=500_000, help="samples")
    parser.add_argument("--case", nargs=2, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.case:
        sys.stdout.write(json.dumps(measured(args.case[0], int(args.case[1]))))
        return
    path = RESULTS / "diagnosis_scaling.json"
    kept = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    each = len(recording(1, RATE_HZ)[1])

    def asked(kind: str, size: int) -> dict:
        command = [sys.executable, __file__, "--case", kind, str(size)]
        return json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)

    if not kept:
        asked("trials", 1)  # compiles
    for size in (s for s in SIZES if s * each <= args.most):
        for kind in ("trials", "samples"):
            if str(size) not in kept.setdefault(kind, {}):
                kept[kind][str(size)] = asked(kind, size)
                path.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")
    lines = [line for kind, cases in kept.items() for line in table(kind, list(cases.values()))]
    sys.stdout.write("\n".join(lines))
    (RESULTS / "diagnosis_scaling.txt").write_text("\n".join(lines), encoding="utf-8")


if __name__ == "__main__":
    main()
