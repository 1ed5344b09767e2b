"""Maximum likelihood on three measured mechanisms, beside published values.

    FRICTIONPINN_DATA=... python benchmarks/identify_real.py [--sets emps brfd multiarm_pendulum]

Fitted on the trials of ``frictionpinn.data.sets.FIT``, scored on all; nothing is chosen on the held-out trials. EMPS (a
ball-screw drive) and pendulum in windows of 4 s with free initial states, the damper over whole runs. Writes
benchmarks/results/identify_real.txt.
"""

from __future__ import annotations

import argparse
import os
import platform
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from omegaconf import OmegaConf
from scipy.optimize import minimize_scalar

from frictionpinn.data.recording import Recording, Trial
from frictionpinn.data.sets import FIT, HELD_OUT, load_public
from frictionpinn.identify import Estimate, maximum_likelihood
from frictionpinn.identify.result import FAILED
from frictionpinn.numerics.simulate import Simulator
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.mechanism import Mechanism

ROOT = Path(__file__).resolve().parents[1]
RESULT = ROOT / "benchmarks" / "results" / "identify_real.txt"
ROLLOUT_S = 4.0


@dataclass(frozen=True)
class Model:
    """One model of a set: friction law, effects, free parameters, those held, and published scores by group."""

    title: str
    law: str
    effects: tuple[str, ...]
    free: tuple[str, ...]
    fixed: Mapping[str, float]
    published: str = ""


NONE = 1e-9  # a friction coefficient that must be positive and is left out
DRIVE = ("M", "mu_c", "sigma_2", "constant_force")
LUGRE = ("sigma_0", "sigma_1", "sigma_2", "mu_c", "mu_s", "v_s")
SLIP = ("mu_c", "presliding", "presliding_length")
MODELS: dict[str, tuple[Model, ...]] = {
    "emps": (
        Model("Coulomb, viscous, constant force", "coulomb_viscous", ("constant_force",), DRIVE, {},
              "4.08 / 5.98 (regression)"),
        Model("+ viscous friction by direction", "coulomb_viscous", ("constant_force", "asymmetric_viscous"),
              (*DRIVE, "asymmetric_viscous"), {}, "3.11 / 5.34"),
        Model("LuGre, constant force", "lugre", ("constant_force",), ("M", *LUGRE, "constant_force"), {}),
    ),
    "brfd": (
        Model("Coulomb, viscous", "coulomb_viscous", (), ("mu_c", "sigma_2"), {}, "- / 86.5"),
        Model("presliding", "coulomb_viscous", ("presliding",), SLIP, {"sigma_2": 0.0}, "- / 26.4"),
        Model("presliding, asymmetry, backlash", "coulomb_viscous", ("presliding", "asymmetry", "backlash"),
              (*SLIP, "asymmetry", "backlash_gap"), {"sigma_2": 0.0}, "- / 14.1"),
        Model("LuGre", "lugre", (), LUGRE, {}),
    ),
    "multiarm_pendulum": (
        Model("viscous", "coulomb_viscous", (), ("l", "sigma_2"), {"mu_c": NONE}, "4.33 / 10.85 / 8.84"),
        Model("Coulomb, viscous", "coulomb_viscous", (), ("l", "mu_c", "sigma_2"), {}, "Coulomb fits to zero"),
        Model("viscous, drag", "coulomb_viscous", ("drag",), ("l", "sigma_2", "drag"), {"mu_c": NONE},
              "3.33 / 12.54 / 9.01"),
        Model("Coulomb, viscous, drag", "coulomb_viscous", ("drag",), ("l", "mu_c", "sigma_2", "drag"), {},
              "3.37 / 5.38 / 1.29 (no viscous)"),
        Model("LuGre, drag", "lugre", ("drag",), ("l", *LUGRE, "drag"), {}),
    ),
}  # fmt: skip
SYSTEM = {"emps": "drive", "brfd": "damper", "multiarm_pendulum": "pendulum"}
WINDOWS = {"emps": 4.0, "brfd": None, "multiarm_pendulum": 4.0}
# Janot, Gautier and Brunot (2019), by regression of the force on filtered and differentiated position.
PUBLISHED = {"emps": {"M": 95.11, "mu_c": 20.39, "sigma_2": 203.5, "constant_force": -3.16}}
GROUPS = {
    "emps": {"fit": FIT["emps"], "held out": HELD_OUT["emps"]},
    "brfd": {"fit": FIT["brfd"], "held out": HELD_OUT["brfd"]},
    "multiarm_pendulum": {"fit": FIT["multiarm_pendulum"], "36.7 to 55 s": ("vad_1", "vad_2"), "raw tail": ("raw",)},
}
SCORE = {
    "emps": "relative error of the force that the measured motion needs, %",
    "brfd": "relative force error, %",
    "multiarm_pendulum": f"root-mean-square error of {ROLLOUT_S:g} s rollouts from the measured state, mrad",
}


def mechanism_of(name: str, model: Model) -> Mechanism:
    """The set's system, with its configured parameters, and the model's friction."""
    config: Any = OmegaConf.to_container(OmegaConf.load(ROOT / "conf" / "data" / f"{name}.yaml"))
    own = config.get("system", {}).get("parameters", {})
    return Mechanism(SYSTEMS[SYSTEM[name]](**own), LAWS[model.law](), model.effects)


def force_error(mechanism: Mechanism, p: Mapping[str, float], trials: Sequence[Trial]) -> float:
    """||measured - model|| / ||measured||, the motion imposed as it was measured: M a + F_f against the force.

    Only the bristle's initial state is fitted to each run.
    """
    system = mechanism.system
    moved = mechanism if system.massless else Mechanism(
        type(system)(system.equations, tuple(c.name for c in system.moving), **system.values), mechanism.law,
        mechanism.effects)  # fmt: skip
    simulator, off, size = Simulator(moved), 0.0, 0.0
    for trial in trials:

        def squares(z0: float | str, trial: Trial = trial) -> float:
            run = simulator.simulate(trial.t, trial.signals, p, z0=z0)
            force = run.F + p.get("M", 0.0) * trial.signals["a"]
            return float(np.sum((force - trial.signals["force"]) ** 2))

        steady = simulator.simulate(trial.t, trial.signals, p, z0="steady")
        reach = 2 * float(np.abs(steady.z).max())  # where the bristle starts is no parameter: what fits the run best
        own = minimize_scalar(squares, bounds=(-reach, reach), method="bounded").fun if reach else np.inf
        off += min(float(own), squares("steady"))
        size += float(np.sum(trial.signals["force"] ** 2))
    return 100 * (off / size) ** 0.5


def rollout_error(mechanism: Mechanism, p: Mapping[str, float], trials: Sequence[Trial]) -> float:
    """Root-mean-square error of the angle, mrad, over consecutive free runs of 4 s."""
    simulator, errors = Simulator(mechanism), []
    for trial in trials:
        count = round(ROLLOUT_S / float(np.median(np.diff(trial.t))))
        for k in range(0, len(trial.t) - count + 1, count):
            part = slice(k, k + count)
            start = {name: float(trial.signals[name][k]) for name in ("theta", "omega")}
            run = simulator.simulate(np.ascontiguousarray(trial.t[part]), {}, p, start, z0="steady")
            errors.append(run.signals["theta"] - trial.signals["theta"][part])
    return 1e3 * float(np.sqrt(np.mean(np.concatenate(errors) ** 2)))


SCORER: dict[str, Callable[[Mechanism, Mapping[str, float], Sequence[Trial]], float]] = {
    "emps": force_error, "brfd": force_error, "multiarm_pendulum": rollout_error,
}  # fmt: skip


def regression(recording: Recording) -> list[str]:
    """The published kind of estimate on the same samples: force on acceleration, velocity, its sign, and 1.

    Its 95 % intervals allow for residuals that stay correlated (Newey and West, Econometrica 55 (1987), with a window
    of a twentieth of the samples).
    """
    signals = recording.select(FIT["emps"]).trials[0].signals
    columns = {"M": signals["a"], "mu_c": np.sign(signals["v"]), "sigma_2": signals["v"]}
    design = np.stack([*columns.values(), np.ones(len(signals["v"]))], axis=1)
    found = np.linalg.lstsq(design, signals["force"], rcond=None)[0]
    residual = signals["force"] - design @ found
    error = np.linalg.norm(residual) / np.linalg.norm(signals["force"])
    scores, lags = design * residual[:, None], len(residual) // 20
    spread = scores.T @ scores
    for lag in range(1, lags + 1):
        product = scores[lag:].T @ scores[:-lag]
        spread += (1 - lag / (lags + 1)) * (product + product.T)
    bread = np.linalg.inv(design.T @ design)
    reach = 1.96 * np.sqrt(np.diag(bread @ spread @ bread))
    rows = zip((*columns, "constant_force"), found, reach, strict=True)
    text = ", ".join(f"{name} {x:.5g} [{x - r:.4g}, {x + r:.4g}]" for name, x, r in rows)
    return [f"regression on these samples, as published: {text}; {100 * error:.2f} % of the force"]


def report(name: str, model: Model, recording: Recording) -> list[str]:
    """Fit one model; its parameters and scores."""
    mechanism = mechanism_of(name, model)
    estimate = maximum_likelihood(
        mechanism, recording.select(FIT[name]), free=model.free, fixed=model.fixed, windows=WINDOWS[name]
    )
    lines = ["", f"{model.title}: {estimate.outcome}, {estimate.n_simulations} simulations, {estimate.seconds:.1f} s"]
    for parameter in estimate.names:
        low, high = estimate.ci95[parameter]
        line = f"  {parameter:<18}{estimate.values[parameter]:>12.5g}  [{low:.4g}, {high:.4g}]"
        known = PUBLISHED.get(name, {}).get(parameter)
        if known is not None and low == low:
            line = f"{line:<60} published {known:g}" + ("" if low <= known <= high else " (outside)")
        lines.append(line)
    if estimate.outcome != FAILED:
        scores = " / ".join(f"{value:.2f}" for value in scored(name, mechanism, model, estimate, recording))
        lines.append(f"  {SCORE[name]}: {' / '.join(GROUPS[name])}: {scores}"
                     + (f"   published {model.published}" if model.published else ""))  # fmt: skip
    return [*lines, *("  " + sentence for sentence in estimate.advice)]


def scored(name: str, mechanism: Mechanism, model: Model, estimate: Estimate, recording: Recording) -> list[float]:
    """The score of each group of trials; what the data do not tell takes its value where the search ended."""
    p = model.fixed | estimate.values
    return [SCORER[name](mechanism, p, recording.select(trials).trials) for trials in GROUPS[name].values()]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sets", nargs="*", default=list(MODELS), choices=list(MODELS))
    chosen = parser.parse_args().sets
    lines = [
        "Maximum likelihood on measured mechanisms: value and 95 % interval, SI units; a preload of 1 N (1 N m)",
        "makes mu_c the Coulomb force (torque)",
        f"Python {platform.python_version()}, {os.cpu_count()} cores (shared), load {os.getloadavg()[0]:.1f}",
    ]
    for name in chosen:
        recording = load_public(name)
        lines += ["", f"=== {name}: fitted on {', '.join(FIT[name])}"]
        lines += regression(recording) if name == "emps" else []
        for model in MODELS[name]:
            lines += report(name, model, recording)
            print("\n".join(lines), flush=True)
            lines_written = "\n".join(lines) + "\n"
    if set(chosen) == set(MODELS):
        RESULT.write_text(lines_written)


if __name__ == "__main__":
    main()
