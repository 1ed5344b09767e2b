"""Wrong logs: does each end in a right answer, a warning that names the fault, or one line of error?

    python benchmarks/wrong_logs.py [--only gap] [--clean 200]

Each kind of benchmarks/wrong_log_kinds.py is written to a file and handed to the check that every run does before a
fit, with the options that a user would give. What is not refused is fitted (Coulomb + viscous friction, maximum
likelihood): the answer is right where mu_c is within ``NEAR`` of the truth, for measured logs of the fit to the log as
it is. A wrong answer that no warning came before is silent: their number must be 0. Then clean recordings of every
system at 1 to 10 % noise and 100 to 2000 Hz: none may raise a finding. Writes benchmarks/results/wrong_logs.txt.
"""

from __future__ import annotations

import argparse
import io
import re
import sys
import tempfile
import time
import traceback
import warnings
from contextlib import redirect_stdout
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf
from wrong_log_kinds import KINDS, OPTIONS, RIGHT, TRUTH, Kind, log, measured_folder

from frictionpinn.data.inspect import inspect
from frictionpinn.data.noise import GaussianNoise
from frictionpinn.data.recording import Recording
from frictionpinn.data.simulated import simulate_recording
from frictionpinn.errors import UserError
from frictionpinn.identify import maximum_likelihood
from frictionpinn.physics import LAWS, SYSTEMS, System
from frictionpinn.physics.mechanism import Mechanism
from frictionpinn.workflow.build import build_recording, build_system
from frictionpinn.workflow.check import check
from frictionpinn.workflow.vet import measured_well

ROOT = Path(__file__).resolve().parents[1]
RESULT = ROOT / "benchmarks" / "results" / "wrong_logs.txt"
NEAR = 0.1  # of mu_c: an answer as near is right
MEASURED = ("emps", "ur10e")


@dataclass(frozen=True)
class End:
    """How a wrong log ended: right; named, warned or refused (of something else) by a line; silent; or a trace."""

    how: str
    line: str
    seconds: float


def write(kind: Kind, folder: Path) -> Path:
    """The log as a file, or as files in a folder."""
    table = kind.change(log(kind.base))
    if kind.files is not None:
        for name, part in kind.files(table).items():
            part.to_csv(folder / name, index=False)
        return folder
    table.to_csv(folder / "run.csv", index=False, header=kind.header)
    return folder / "run.csv"


def configured(kind: Kind, path: Path) -> dict:
    system = [] if any(item.startswith("system=") for item in (*kind.options, *OPTIONS.get(kind.base, ()))) else [
        f"system={kind.base}"
    ]  # fmt: skip
    overrides = [*system, *OPTIONS.get(kind.base, ()), *kind.options, f"data.path='{path}'"]
    with initialize_config_dir(str(ROOT / "conf"), version_base="1.3"):
        return OmegaConf.to_container(compose("check", overrides=overrides), resolve=True)


def fitted(cfg: dict) -> float:
    """mu_c of Coulomb + viscous friction."""
    system = build_system(cfg["system"])
    recording = build_recording(cfg["data"], system)
    if measured_well(system, recording):  # as the check says
        system = type(system)(imposed=True, **dict(system.values))
    own = ("J", "W_cos", "W_sin") if system.name == "joint" and system.massless else ()
    free = (*own, "mu_c", "sigma_2")
    found = maximum_likelihood(
        Mechanism(system, LAWS["coulomb_viscous"]()), recording, free=free, thorough=False, profiles=False
    )
    return float(found.values["mu_c"])


@cache
def truth(base: str) -> float:
    """mu_c of the log as it is."""
    if base not in MEASURED:
        return TRUTH[base]["mu_c"]
    with tempfile.TemporaryDirectory() as folder:
        kind = Kind(base, lambda d: d, RIGHT)
        return fitted(configured(kind, write(kind, Path(folder))))


def ended(kind: Kind) -> End:
    """Check the log, fit it where it is not refused, and judge."""
    began, said = time.perf_counter(), io.StringIO()
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        path = write(kind, Path(folder))
        try:
            with redirect_stdout(said):
                cfg = configured(kind, path)
                check(cfg)
            refused = ""
        except UserError as error:
            refused = str(error)
        except Exception:
            return End("trace", traceback.format_exc().splitlines()[-1], time.perf_counter() - began)
        lines = [line for line in said.getvalue().splitlines() if line.startswith(("wrong", "odd"))]
        lines += [line for line in said.getvalue().splitlines() if line.startswith("not recorded")]
        told = " | ".join([*lines, refused]).replace(str(folder), "")
        if kind.expect != RIGHT and re.search(kind.expect, told):
            return End("named", told, time.perf_counter() - began)
        if refused:
            return End("refused", told, time.perf_counter() - began)
        try:
            value = fitted(cfg)
        except UserError as error:
            return End("refused", str(error), time.perf_counter() - began)
        except Exception:
            return End("trace", traceback.format_exc().splitlines()[-1], time.perf_counter() - began)
    near = abs(value / truth(kind.base) - 1) < NEAR
    what = f"mu_c {value:.4g}, is {truth(kind.base):.4g}"
    how = "right" if near else "warned" if told else "silent"
    return End(how, " | ".join(filter(None, [what, told])), time.perf_counter() - began)


def positions_alone(recording: Recording, system: System) -> Recording:
    """The recording without velocities and accelerations."""
    kept = {*(c.signals[0] for c in system.moving), *(item.name for item in system.inputs)}
    trials = [replace(t, signals={n: y for n, y in t.signals.items() if n in kept}) for t in recording.trials]
    return replace(recording, trials=tuple(trials))


def clean(count: int) -> list[str]:
    """Findings of clean simulated recordings; parameters, trials, rate and noise are drawn, every second one has
    positions and inputs alone. There should be none.

    But where nothing broke loose in truth, that must be found.
    """
    rng, found = np.random.default_rng(11), []
    names = [name for name, kind in SYSTEMS.items() if len(kind().contacts) == 1]
    for k in range(count):
        name = names[k % len(names)]
        conf = OmegaConf.to_container(OmegaConf.load(ROOT / "conf" / "system" / f"{name}.yaml"))
        rate, noise = 100.0 * 20 ** rng.uniform(), 0.01 * 10 ** rng.uniform()
        system, own = SYSTEMS[name](**conf["parameters"]), conf["simulate"]
        chosen = rng.permutation(len(own["trials"]))[: rng.integers(2, len(own["trials"]) + 1)]
        trials = [own["trials"][i] for i in sorted(chosen)]
        truth = {n: v * float(np.exp(rng.uniform(-0.3, 0.3))) for n, v in own["truth"].items()}
        truth["mu_s"] = max(truth["mu_s"], 1.05 * truth["mu_c"])
        recording = GaussianNoise(noise)(simulate_recording(system, own["friction"], truth, trials, rate), k)
        if k // len(names) % 2:  # an encoder's log
            recording = positions_alone(recording, system)
        told = [str(f) for f in inspect(recording, system)]
        if max(float(np.abs(t.truth["v_slip"]).max()) for t in recording.trials) < truth["v_s"]:
            told = [] if any("nothing slips" in line for line in told) else ["nothing slips, and that was not found"]
        found += [f"{name}, {rate:.0f} Hz, noise {100 * noise:.1f} %: {line}" for line in told]
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default="", help="kinds whose name holds this")
    parser.add_argument("--clean", type=int, default=200, help="clean recordings")
    arguments = parser.parse_args()
    there = measured_folder() is not None
    kinds = {n: k for n, k in KINDS.items() if arguments.only in n and (there or k.base not in MEASURED)}
    lines, counts = [], dict.fromkeys(("right", "named", "refused", "warned", "silent", "trace"), 0)
    for name, kind in kinds.items():
        end = ended(kind)
        counts[end.how] += 1
        lines.append(f"{end.how:<8} {name:<52} {end.seconds:5.1f} s  {end.line[:230]}")
        print(lines[-1], flush=True)
    total = f"{len(kinds)} kinds: " + ", ".join(f"{count} {how}" for how, count in counts.items())
    total += f"\nsilent wrong answers: {counts['silent']}; tracebacks: {counts['trace']}"
    false = clean(arguments.clean)
    total += f"\nclean recordings with a finding: {len(false)} of {arguments.clean}"
    print("\n".join([*false, total]))
    if not arguments.only:
        head = "How wrong logs end, and whether clean ones raise a finding: python benchmarks/wrong_logs.py\n"
        RESULT.write_text("\n".join([head, *lines, "", *false, total, ""]), encoding="utf-8")
    sys.exit(counts["silent"] + counts["trace"] > 0)


if __name__ == "__main__":
    main()
