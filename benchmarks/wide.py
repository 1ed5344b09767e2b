"""Recordings off the beaten path, drawn at random: what identification and diagnosis make of them.

    python benchmarks/wide.py --identify [--label before] [--seeds 1000 1040] [--minutes 20]
    python benchmarks/wide.py --diagnose [--label before] [--seeds 1000 1040] [--minutes 25]
    python benchmarks/wide.py --imposed --identify --label imposed                          (and --diagnose)
    python benchmarks/wide_report.py identify before [after]      python benchmarks/wide_check.py

Four systems, masses and lengths within a factor of two of conf/system, three laws, random multisines, chirps and skewed
sines, 3 to 10 trials of unequal length at 100 to 2000 Hz, 1 to 10 % noise on every signal, some of it quantised; two
thirds with an effect that nobody declared, 3 to 6 % of the friction force. The data come from equations of motion and
friction laws of the benchmark's own (wide_simulate.py), where laws without memory hold a resting contact entirely; the
package's creep at up to v_t (1e-5 m/s). --identify draws the same recordings without effects. --imposed draws
recordings in which the motion is taken as measured and the force predicted instead (wide_imposed.py).

Seeds below 1000 are for development. Those from 1000 on are the unseen ones: NOTHING may ever be tuned on them, no
threshold compared and no fault mended with one of them in view, or they prove nothing any more.

Writes benchmarks/results/wide_<mode>_<label>.json (every case, as it comes: a stopped run goes on) and .txt.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import wide_imposed
from wide_draw import ROOT, Case, draw
from wide_effects import SHAPES, ends
from wide_report import report

from frictionpinn.data.recording import Recording
from frictionpinn.errors import UserError
from frictionpinn.identify import Problem, bound, maximum_likelihood
from frictionpinn.identify.trial import TrialModel
from frictionpinn.numerics.descent import levenberg_marquardt
from frictionpinn.numerics.simulate import ContactLost, SimulationFailed
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.mechanism import Mechanism
from frictionpinn.show import plain
from frictionpinn.workflow.provenance import commit

__all__ = ["RESULTS", "Case", "cost_from_truth", "declared", "diagnose", "draw", "identify", "least_errors"]

RESULTS = ROOT / "benchmarks" / "results"
LONGEST_S = 600  # of a diagnosis


def declared(case: Case, effects: tuple[str, ...] = ()) -> Mechanism:
    """The mechanism as the program is told of it, optionally with effects."""
    imposed = case.imposed and not SYSTEMS[case.system].massless
    return Mechanism(SYSTEMS[case.system](imposed=imposed, **case.parameters), LAWS[case.law](), effects)


def about(case: Case) -> dict:
    """What describes a case in the results."""
    return {
        "seed": case.seed, "system": case.system, "law": case.law, "rate_hz": case.rate_hz, "level": case.level,
        "quantised": case.quantised, "trials": len(case.clean.trials), "samples": len(case.clean),
        "imposed": case.imposed, "commit": (commit() or "")[:7],
    }  # fmt: skip


def cost_from_truth(problem: Problem, case: Case, sigmas: dict[str, float]) -> tuple[float, float]:
    """Cost at the truth, its initial states and paths included, and of the Levenberg-Marquardt fit that starts there.

    Both at these noise levels; NaN where the package cannot simulate the truth.
    """
    problem = problem.varied(limits=problem.space.reaching(case.truth))  # the default bounds may exclude the truth
    u = problem.space.to_search(case.truth)
    try:
        models = problem.models_at(u)
        evaluate = problem.evaluator(models, sigmas)
        locals_ = [_true_local(model, case, sigmas)[: model.size(problem.joint)] for model in models]
        first = evaluate(u, locals_, True)
        if first is None:
            return np.nan, np.nan
        return first.cost, levenberg_marquardt(evaluate, first, problem.space.limits, iterations=100).state.cost
    except (ContactLost, SimulationFailed):
        return np.nan, np.nan


def _true_local(model: TrialModel, case: Case, sigmas: dict[str, float]) -> np.ndarray:
    """True initial states, the bristle's as its force, and the coefficients closest to the true inputs."""
    trial = next(t for t in case.clean.trials if t.name == model.trial.partition("[")[0])
    here = np.searchsorted(trial.t, model.t[0]) + np.arange(len(model.t))
    states = trial.signals | {"z": trial.truth["z"] * case.truth.get("sigma_0", 1.0)}
    paths = [
        item.basis.fit(
            np.stack([trial.signals[n][here] for n in item.names]), np.array([sigmas[n] for n in item.names])
        )[0]
        for item in model.inputs
    ]
    return np.concatenate([[states[name][here[0]] for name in model.states], *paths])


def least_errors(case: Case, recording: Recording | None = None) -> dict[str, float | None]:
    """Cramer-Rao bound at the truth: least standard errors by name, effects included; None where nothing is told."""
    mechanism = declared(case, case.effects)
    shapes = {k: v for k, v in case.values.items() if k in SHAPES}
    values = case.truth | {k: v for k, v in case.values.items() if k not in shapes}
    found = bound(mechanism, recording or case.clean, values, sigmas=case.sigmas, free=tuple(values), fixed=shapes)
    deviations = np.sqrt(np.diag(found.covariance))
    return {name: plain(float(s)) for name, s in zip(found.names, deviations, strict=True)}


def identify(case: Case) -> dict:
    """One recording without effects: maximum likelihood with default options, beside a fit from the truth."""
    result = about(case) | {"truth": case.truth}
    began, processor = time.perf_counter(), time.process_time()
    problem = Problem(declared(case), case.recording)
    estimate = maximum_likelihood(problem)
    seconds, processor_s = time.perf_counter() - began, time.process_time() - processor
    there, reference = cost_from_truth(problem, case, estimate.sigmas)
    return result | {
        "outcome": estimate.outcome, "advice": list(estimate.advice),
        "values": {n: plain(v) for n, v in estimate.values.items()},
        "std": {n: plain(s) for n, s in estimate.std.items()},
        "ci95": {n: [plain(x) for x in ends] for n, ends in estimate.ci95.items()},
        "inside": {n: low <= case.truth[n] <= high for n, (low, high) in estimate.ci95.items() if np.isfinite(low)},
        "distance": {n: plain((estimate.values[n] - case.truth[n]) / estimate.std[n]) for n in estimate.names},
        "bound": least_errors(case), "cost": plain(estimate.cost), "cost_at_truth": plain(there),
        "cost_from_truth": plain(reference),
        "sigmas": {n: estimate.sigmas[n] / s for n, s in case.sigmas.items() if n in estimate.sigmas and s > 0},
        "simulations": estimate.n_simulations, "seconds": seconds, "processor_s": processor_s,
    }  # fmt: skip


def write_csv(case: Case, path: Path) -> None:
    """The noisy recording as the program reads it."""
    rows = [pd.DataFrame({"trial": t.name, "t": t.t} | t.signals) for t in case.recording.trials]
    pd.concat(rows).to_csv(path, index=False)


def diagnose(case: Case) -> dict:
    """One recording through the command line, scored."""
    result = about(case) | {"truth": case.truth, "true_effects": list(case.effects), "true_values": case.values}
    fitted = case.clean.select(set(case.clean.names) - set(case.held_out))
    least = least_errors(case, fitted)
    result["shows"] = {n: plain(abs(v) / least[n]) if least[n] else None for n, v in case.values.items() if n in least}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.csv"
        write_csv(case, path)
        command = [sys.executable, str(ROOT / "diagnose.py"), f"system={case.system}", f"friction={case.law}"]
        command += [f"system.parameters.{name}={value!r}" for name, value in case.parameters.items()]
        command += ["system.imposed=true"] * case.imposed
        command += ["data=csv", f"data.path={path}", f"data.held_out=[{','.join(case.held_out)}]"]
        command += [f"hydra.run.dir={folder}/out"]
        began, processor = time.perf_counter(), _children_s()
        try:
            done = subprocess.run(command, capture_output=True, text=True, cwd=folder, check=False, timeout=LONGEST_S)
            failed = done.stderr.strip().splitlines()[-3:] if done.returncode else []
        except subprocess.TimeoutExpired:
            failed = ["timeout"]
        result |= {"seconds": time.perf_counter() - began, "processor_s": _children_s() - processor}
        if failed:
            return result | {"failed": failed}
        answer = json.loads((Path(folder) / "out" / "result.json").read_text())
    found, known = answer["parameters"], known_at(case, fitted)
    return result | {
        "verdict": answer["verdict"], "effects": [e["name"] for e in answer["effects"]],
        "alike": [e["indistinguishable_from"] for e in answer["effects"]], "inseparable": answer["inseparable"],
        "found": {n: p["value"] for n, p in found.items()}, "ci95": {n: p["ci95"] for n, p in found.items()},
        "inside": {n: p["ci95"][0] <= known[n] <= p["ci95"][1] for n, p in found.items()
                   if n in known and None not in p["ci95"]},
        "depends_on": (answer["unexplained"] or {}).get("depends_on"),
        "error": {k: answer["error"][k] for k in ("before", "after", "noise_floor")},
        "errors": {n: e["after"] / e["noise_floor"] for n, e in answer["errors"].items() if e["noise_floor"]},
        "diagnosis_s": answer["seconds"],
    }  # fmt: skip


def known_at(case: Case, fitted: Recording) -> dict[str, float]:
    """True values as a diagnosis means them: friction and its gradient in the middle of the stroke that it is given."""
    known = case.truth | case.values
    if "position_gradient" not in known:
        return known
    away = sum(ends(case.system, fitted)) / 2 - known["position_middle"]
    there = 1 + known["position_gradient"] * away
    known |= {name: known[name] * there for name in ("mu_c", "mu_s") if name in known}
    return known | {"position_gradient": known["position_gradient"] / there}


def _children_s() -> float:
    """Processor time of the programs that were run so far."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def score(
    mode: str, run: Callable[[Case], dict], drawn: Callable[[int], Case], seeds: range, label: str, minutes: float
) -> None:
    """Run the seeds that have no result yet, and write each as it comes."""
    path, began = RESULTS / f"wide_{mode}_{label}.json", time.monotonic()
    done = json.loads(path.read_text()) if path.exists() else []
    for seed in sorted(set(seeds) - {c["seed"] for c in done}):
        if time.monotonic() - began > 60 * minutes:
            break
        try:
            case = run(drawn(seed))
        except (UserError, ArithmeticError) as error:
            case = {"seed": seed, "failed": [str(error)]}
        done.append(case)
        path.write_text(json.dumps(done, indent=1))
        shown = ("system", "law", "outcome", "true_effects", "verdict", "effects", "alike", "failed", "seconds")
        print(seed, *(case[key] for key in shown if key in case), flush=True)
    print(report(mode, [label]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    mode = parser.add_mutually_exclusive_group()
    mode.add_argument("--identify", action="store_true")
    mode.add_argument("--diagnose", action="store_true")
    parser.add_argument("--seeds", type=int, nargs=2, default=(1000, 1040), help="first, and one beyond the last")
    parser.add_argument("--imposed", action="store_true", help="recordings whose motion is imposed")
    parser.add_argument("--label", default="now")
    parser.add_argument("--minutes", type=float, default=np.inf, help="no case is begun later")
    args = parser.parse_args()
    drawing, rest = wide_imposed.draw if args.imposed else draw, (range(*args.seeds), args.label, args.minutes)
    if not args.diagnose:
        score("identify", identify, lambda seed: drawing(seed, effects=False), *rest)
    if not args.identify:
        score("diagnose", diagnose, drawing, *rest)


if __name__ == "__main__":
    main()
