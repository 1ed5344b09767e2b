"""Held-out errors of drawn recordings beyond 1.05 of the noise: how many are as large at the true parameters.

    python benchmarks/wide_held_out.py [--label now] [--seeds 1046 1178]

Each recording whose held-out error stands beyond 1.05 of the floor in wide_diagnose_<label>.json (or the seeds given)
is diagnosed again; then the held-out trials' own unknowns are estimated at the true parameters of the same model. What
is left there is what these samples' noise and the estimate of its level make: no diagnosis can be nearer. Recordings
whose true effects were not named are left out: their model has no true parameters.
Writes benchmarks/results/wide_held_out.txt.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace

from wide import RESULTS, declared, draw, known_at
from wide_report import FLOOR

from frictionpinn.diagnose.diagnosis import diagnose
from frictionpinn.diagnose.errors import compare
from frictionpinn.diagnose.held_out import check


def ratios(seed: int) -> tuple[float, float] | None:
    """Held-out error over the floor as diagnosed and at the truth; None where the model is not the true one."""
    case = draw(seed)
    fitted = case.recording.select(set(case.recording.names) - set(case.held_out))
    d = diagnose(declared(case), fitted, case.recording.select(case.held_out))
    if {a.candidate.effect for a in d.accepted} != set(case.effects):
        return None
    known = known_at(case, fitted)
    fit = d.selection.fit
    there = check(d.bench, replace(fit, values=fit.values | {n: v for n, v in known.items() if n in fit.values}))
    if there is None:
        return None
    at_truth = compare(d.bench, [d.before, there], d.selection.last.sigmas)[0][d.main]
    own = d.errors[d.main]
    return own["after"] / own["noise_floor"], at_truth["after"] / own["noise_floor"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--label", default="now")
    parser.add_argument("--seeds", type=int, nargs="+")
    args = parser.parse_args()
    cases = json.loads((RESULTS / f"wide_diagnose_{args.label}.json").read_text(encoding="utf-8"))
    beyond = [c["seed"] for c in cases if "error" in c and c["error"]["after"] > FLOOR * c["error"]["noise_floor"]]
    lines = [f"held-out error over the floor, of {len(beyond)} recordings beyond {FLOOR:g}: as diagnosed, at the truth"]
    for seed in args.seeds or beyond:
        found = ratios(seed)
        told = "not all true effects named" if found is None else f"{found[0]:.3f}  {found[1]:.3f}"
        lines.append(f"{seed}  {told}")
        print(lines[-1], flush=True)
        (RESULTS / "wide_held_out.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
