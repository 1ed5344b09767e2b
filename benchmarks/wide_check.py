"""Whether the equations of benchmarks/wide_simulate.py and those of the package give the same motion.

    python benchmarks/wide_check.py

Every system with every law, and every effect, on drawn motions of seeds below 1000: the package simulates each trial
from the state at its first sample, with the same excitation. Laws without memory are compared at
v_t = 1e-6 too, where theirs hold a resting contact as ours. Late accelerations differ where they jump between samples.
Writes benchmarks/results/wide_check.txt.
"""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
from wide_draw import ROOT, SIGNALS, Case, draw
from wide_effects import SLIP, effects_on
from wide_simulate import KINDS, Excitation

from frictionpinn.data.simulated import simulate_trials
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.mechanism import Mechanism

RESULT = ROOT / "benchmarks" / "results" / "wide_check.txt"
LAWS_USED = ("coulomb_viscous", "stribeck", "lugre")


def compare(case: Case) -> dict[str, float]:
    """Signal -> rms difference of the clean recordings over the signal's standard deviation."""
    system = SYSTEMS[case.system](**case.parameters)
    mechanism = Mechanism(system, LAWS[case.law](), case.effects)
    driven = [c.signals[0] for c in mechanism.driven]
    inputs = [item.name for item in system.inputs if item.name in SIGNALS[case.system]]
    slip = SLIP.get(case.system, ("x", "v", "a"))
    specs = []
    for run, trial in zip(case.runs, case.clean.trials, strict=True):
        names = [*driven, *inputs]
        spec = {name: _shown(case, name, e) for name, e in zip(names, run.excitations, strict=True)}
        start = {name: float(trial.truth[key][0]) for name, key in zip(slip, ("s", "v_slip"), strict=False)}
        if mechanism.memory:
            start["z"] = float(trial.truth["z"][0])
        specs.append(spec | {"duration": len(trial) / case.rate_hz, "initial": start})
    theirs = simulate_trials(mechanism, case.truth | case.values, specs, case.rate_hz)
    result = {}
    for name in SIGNALS[case.system]:
        own, other = (np.concatenate([t.signals[name] for t in r.trials]) for r in (case.clean, theirs))
        result[name] = float(np.sqrt(np.mean((own - other) ** 2)) / np.std(own))
    return result


def _shown(case: Case, name: str, path: Excitation) -> str:
    """An imposed path as late as its sensors show it, which is what the package is given; of a force, itself."""
    late = sum(v for k, v in case.values.items() if k.startswith(f"sensor_delay_{name}_"))
    return path.expression(late)


def main() -> None:
    lines = [f"{'system':9s} {'law':16s} {'effect':18s} difference of each signal, % of its spread"]
    cases = [draw(seed, effects=False) for seed in range(60)]
    for kind, law in itertools.product(KINDS, LAWS_USED):
        seed = next(c.seed for c in cases if (c.system, c.law) == (kind, law))
        varied = [()] if law != "lugre" else [(), *((name,) for name in effects_on(kind))]
        for case in [draw(seed, names) for names in varied]:
            sharp = [] if law == "lugre" else [replace(case, truth=case.truth | {"v_t": 1e-6})]
            for compared in (case, *sharp):
                named = "v_t = 1e-6" if compared in sharp else "+".join(case.effects)
                told = ", ".join(f"{y} {100 * e:.3f}" for y, e in compare(compared).items() if e > 1e-6)
                lines.append(f"{kind:9s} {law:16s} {named:18s} {told}")
                print(lines[-1], flush=True)
    RESULT.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
