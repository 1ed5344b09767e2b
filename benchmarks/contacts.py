"""Friction of two contacts identified at once: error over the Cramer-Rao bound, and coverage of the intervals.

    python benchmarks/contacts.py --systems pob_hinge cartpole --draws 20
    python benchmarks/contacts.py --report       # of the draws that were made so far

The trials of a system's own file that are not held out, 5 % noise on every signal, LuGre at both contacts, nothing
fixed but alpha. Each draw of the noise is identified from the recording alone; the bound is that at the truth, which
serves for scoring alone. A draw's result is kept in benchmarks/results/contacts.json and not made again.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

import numpy as np
from omegaconf import OmegaConf

from frictionpinn.data.noise import GaussianNoise
from frictionpinn.data.simulated import simulate_recording
from frictionpinn.identify import bound, maximum_likelihood
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.contacts import by_parameter
from frictionpinn.physics.mechanism import Mechanism

ROOT = Path(__file__).resolve().parents[1]
RESULTS, NOISE, RATE = ROOT / "benchmarks" / "results", 0.05, 400.0


def case(name: str):
    """Mechanism, truth by parameter, and the trials to identify from, without noise."""
    declared = OmegaConf.to_container(OmegaConf.load(ROOT / "conf" / "system" / f"{name}.yaml"), resolve=True)
    system, made = SYSTEMS[name](**declared["parameters"]), declared["simulate"]
    mechanism = Mechanism(system, {contact: LAWS[law]() for contact, law in made["friction"].items()})
    trials = [trial for k, trial in enumerate(made["trials"], 1) if k not in made["held_out"]]
    recording = simulate_recording(system, made["friction"], made["truth"], trials, RATE)
    return mechanism, by_parameter(made["truth"], mechanism.law), recording


def identified(mechanism: Mechanism, recording, seed: int) -> dict:
    """The estimate from one draw of the noise."""
    begin = time.perf_counter()
    found = maximum_likelihood(mechanism, GaussianNoise(NOISE)(recording, seed))
    return {
        "outcome": found.outcome,
        "values": {name: float(value) for name, value in found.values.items()},
        "ci95": {name: [float(end) for end in ends] for name, ends in found.ci95.items()},
        "seconds": time.perf_counter() - begin,
    }


def summary(name: str, truth: dict[str, float], least: dict[str, float], draws: list[dict]) -> list[str]:
    """Lines of the table of one system."""
    lines = [f"{name}: {len(draws)} draws, {np.median([d['seconds'] for d in draws]):.0f} s each"]
    lines.append(f"{'parameter':18s} {'truth':>9s} {'bound':>7s} {'rmse':>7s} {'rmse/bound':>10s} {'in 95 %':>8s}")
    inside = total = 0
    for par, spread in least.items():
        found = np.array([d["values"][par] for d in draws])
        within = sum(d["ci95"][par][0] <= truth[par] <= d["ci95"][par][1] for d in draws)
        inside, total = inside + within, total + len(draws)
        rmse = float(np.sqrt(np.mean((found - truth[par]) ** 2)))
        share = f"{100 * spread / truth[par]:6.1f}% {100 * rmse / truth[par]:6.1f}%"
        lines.append(f"{par:18s} {truth[par]:9.4g} {share} {rmse / spread:10.2f} {within:4d}/{len(draws)}")
    outcomes = [d["outcome"] for d in draws]
    told = ", ".join(f"{outcomes.count(o)} {o}" for o in sorted(set(outcomes)))
    return [*lines, f"coverage {100 * inside / total:.1f} % of {total} intervals; {told}", ""]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--systems", nargs="+", default=["pob_hinge", "cartpole"])
    parser.add_argument("--draws", type=int, default=20)
    parser.add_argument("--report", action="store_true")
    args = parser.parse_args()
    path, lines = RESULTS / "contacts.json", []
    kept = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    for name in args.systems:
        mechanism, truth, recording = case(name)
        least = bound(mechanism, GaussianNoise(NOISE)(recording, 0), truth).std
        draws = kept.setdefault(name, {})
        for seed in range(args.draws):
            if str(seed) not in draws and not args.report:
                draws[str(seed)] = identified(mechanism, recording, seed)
                path.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")
        made = [draws[str(seed)] for seed in range(args.draws) if str(seed) in draws]
        lines += summary(name, truth, least, made)
        print("\n".join(lines[-len(least) - 4 :]), flush=True)
    (RESULTS / "contacts.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
