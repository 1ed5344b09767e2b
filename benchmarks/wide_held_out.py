"""Held-out errors of drawn recordings beside the noise that was drawn in those very samples.

    python benchmarks/wide_held_out.py [--label now]

A diagnosis knows no noise but the floor that it estimates from all trials; in short held-out trials the noise itself
is a tenth more or less. In a drawn recording it is known: what was recorded less what would have been without noise,
in the held-out trials, and of a friction force what the equation of motion makes of it. It is the error that the truth
leaves there. Each answer is asked in the signal by which it quotes its error, from wide_diagnose_<label>.json; nothing
is diagnosed anew. Writes benchmarks/results/wide_held_out.txt.
"""

from __future__ import annotations

import argparse
import json

import numpy as np
from wide import RESULTS
from wide_draw import Case, draw
from wide_report import FLOOR

from frictionpinn.data.recording import Trial
from frictionpinn.numerics.excess import rms
from frictionpinn.numerics.torch_functions import contact_signals
from frictionpinn.physics import SYSTEMS


def drawn_noise(case: Case, name: str) -> float:
    """Root mean square of the noise in the held-out trials: of a signal, or of the friction force they imply."""
    system = SYSTEMS[case.system](**case.parameters)

    def along(trial: Trial) -> np.ndarray:
        return trial.signals[name] if name in trial.signals else contact_signals(system, trial.signals)[name]

    noisy, clean = (whole.select(case.held_out).trials for whole in (case.recording, case.clean))
    return rms([along(a) - along(b) for a, b in zip(noisy, clean, strict=True)])


def row(told: dict) -> tuple[int, str, float, float]:
    """Seed, signal, and the held-out error over the estimated floor and over the noise that was drawn."""
    error = told["error"]
    floor = error["after"] / error["noise_floor"]
    name = min(told["errors"], key=lambda n: abs(told["errors"][n] - floor))  # the one that the answer quotes
    return told["seed"], name, floor, error["after"] / drawn_noise(draw(told["seed"]), name)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--label", default="now")
    label = parser.parse_args().label
    cases = json.loads((RESULTS / f"wide_diagnose_{label}.json").read_text(encoding="utf-8"))
    rows = [row(told) for told in cases if "error" in told]
    floor, drawn = (sum(r[k] <= FLOOR for r in rows) for k in (2, 3))
    lines = [
        f"Held-out error at most {FLOOR:g} of the noise that was drawn: {drawn} of {len(rows)} recordings;",
        f"at most {FLOOR:g} of the floor that the diagnosis estimates: {floor} of {len(rows)}. Beyond either:",
        "  seed  signal          over the floor  over the noise drawn",
        *(f"{seed:6d}  {name:15s} {a:14.3f} {b:21.3f}" for seed, name, a, b in rows if max(a, b) > FLOOR),
    ]
    (RESULTS / "wide_held_out.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")
    print("\n".join(lines))


if __name__ == "__main__":
    main()
