"""How closely the exports reproduce the model that they came from, and our own simulation with it.

    python benchmarks/export.py [--epochs 400] [--seconds 4] [--folder /tmp/runs] [--models pe2]

Trains each variant (unless its run is in the folder already), exports it with evaluate.py, and simulates the
trajectories of conf/evaluate.yaml with the C program (compiled here) and in MuJoCo (box on a rail, and standing on a
plane with frictionless contact). Differences are root mean squares over the samples, relative to that of our own
simulation's force: bdf2 or dopri5 with the network, the compiled simulator with the law. Where MuJoCo differs by more
than 1 %, it is run again at half its timestep. Writes benchmarks/results/export.txt; rows of models that are not run
stay.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import mujoco
import numpy as np
from omegaconf import OmegaConf

from frictionpinn.data.excitation import parse_expression
from frictionpinn.evaluate.in_simulation import simulate_model
from frictionpinn.evaluate.mjcf import pob_mjcf
from frictionpinn.evaluate.yardsticks import simulated_law
from frictionpinn.numerics.paths import InputPath
from frictionpinn.physics import LAWS
from frictionpinn.physics.mechanism import Mechanism
from frictionpinn.workflow.load import load_run

ROOT = Path(__file__).resolve().parents[1]
STRIDES = {"law": 16, "network": 4}  # C: steps per sample
MUJOCO_STRIDES = (20, 40)  # steps per sample: as in the exported pob.xml, and where that is not enough
ENOUGH = 1.0  # %
VARIANTS = ("bb1", "bb2", "pe1", "pe2")


def swings(system, seconds: float) -> dict[str, InputPath]:
    """The trajectories of conf/evaluate.yaml, at most so long, sampled at 400 Hz."""
    mechanism, found = Mechanism(system, LAWS["coulomb"]()), {}
    for item in OmegaConf.to_container(OmegaConf.load(ROOT / "conf" / "evaluate.yaml"))["trajectories"]["pob"]:
        t = np.arange(round(min(item["duration"], seconds) * 400) + 1) / 400
        swing = parse_expression(item["theta"], "theta", item.get("constants", {}))
        found[item["name"]] = InputPath.from_expressions(mechanism, t, {"theta": swing})
    return found


def in_c(folder: Path, path: InputPath, kind: str) -> np.ndarray:
    """Friction force at the samples, by the exported C program."""
    stride = STRIDES[kind]
    flags = ["-std=c99", "-Wall", "-Werror", "-pedantic", "-O2", f"-DFRICTION_STRIDE={stride}"]
    subprocess.run(["cc", *flags, "-o", "simulate", "simulate.c", "friction.c", "-lm"], cwd=folder, check=True)
    times = np.arange((len(path.t) - 1) * stride + 1) / (400 * stride)
    given = "\n".join(",".join(repr(float(value)) for value in path(time)) for time in times)
    done = subprocess.run(["./simulate", kind], cwd=folder, input=given, capture_output=True, text=True, check=True)
    return np.loadtxt(done.stdout.splitlines(), delimiter=",")[::stride, -1]


def in_mujoco(folder: Path, values, path: InputPath, kind: str, support: str, stride: int) -> np.ndarray:
    """Friction force at the samples, in MuJoCo; nan at the first."""
    for name in ("friction_mujoco", "friction_model", "friction_law"):
        sys.modules.pop(name, None)
    sys.path.insert(0, str(folder))
    try:
        import friction_mujoco as exported
    finally:
        sys.path.pop(0)
    text = pob_mjcf(values, timestep=1 / 400 / stride, support=support)
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    where = {"joint": "x", "normal": exported.Reaction("box")} if support == "rail" else {"bodies": ("box", "world")}
    friction, theta = exported.Friction(model, kind, **where), data.joint("theta")
    theta.qpos[0], theta.qvel[0] = path(0.0)[:2]
    force = [np.nan]
    for k in range((len(path.t) - 1) * stride):
        angle, rate, acceleration = path(data.time)[:3]
        acceleration += 100.0 * (rate - theta.qvel[0]) + 2500.0 * (angle - theta.qpos[0])
        friction.step(data, {"theta": acceleration})
        if (k + 1) % stride == 0:
            force.append(friction.force)
    return np.array(force)


def difference(force: np.ndarray, own: np.ndarray) -> float:
    """Relative root mean square difference, %."""
    return 100 * float(np.sqrt(np.nanmean((force - own) ** 2) / np.mean(own**2)))


def rows(name: str, run: Path, seconds: float) -> list[str]:
    """Lines of the table for one model: its law where it has one, its network, every trajectory."""
    _, system, model = load_run(run)
    lines = []
    for kind in ["law"] * bool(model.physical()) + ["network"]:
        for label, path in swings(system, seconds).items():
            if kind == "law":
                own = simulated_law(system, "lugre", model.physical())(path, {}).F
            else:
                own = simulate_model(system, model, path, {}, 4).F
            c = difference(in_c(run / "export" / "c", path, kind), own)
            for stride in MUJOCO_STRIDES:
                rail, plane = (
                    difference(in_mujoco(run / "export" / "mujoco", system.values, path, kind, support, stride), own)
                    for support in ("rail", "plane")
                )
                step = 2.5 / stride
                lines.append(f"{name + ' ' + kind:16s}{label:12s}{c:8.3f}{step:14.4f}{rail:14.3f}{plane:14.3f}")
                print(lines[-1], flush=True)
                if max(rail, plane) < ENOUGH:
                    break
    return lines


def check(name: str, run: Path) -> str:
    """How far ONNX is from torch, as it was found at the export."""
    found = json.loads((run / "export" / "onnx" / "export.json").read_text())["check"]
    return f"{name}: {found['largest_difference']['value']:.1e} N, {100 * found['relative']:.1e} % of the force"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--epochs", type=int, default=400)
    parser.add_argument("--seconds", type=float, default=4.0)
    parser.add_argument("--folder", type=Path, default=None)
    parser.add_argument("--models", nargs="+", default=VARIANTS, choices=VARIANTS)
    options = parser.parse_args()
    folder, result = options.folder or Path(tempfile.mkdtemp()), ROOT / "benchmarks" / "results" / "export.txt"
    before = result.read_text().splitlines() if result.is_file() else []
    table = {name: [line for line in before if line.startswith(f"{name} ")] for name in VARIANTS}
    checks = {name: [line for line in before if line.startswith(f"{name}: ")] for name in VARIANTS}
    for name in options.models:
        run = folder / name
        if not (run / "result.json").is_file():
            train = [f"model={name}", f"trainer.max_epochs={options.epochs}", f"hydra.run.dir={run}"]
            subprocess.run([sys.executable, ROOT / "train.py", *train], check=True)
        export = [f"run={run}", "export=[onnx,c,mujoco]"]
        subprocess.run([sys.executable, ROOT / "evaluate.py", *export], check=True)
        checks[name], table[name] = [check(name, run)], rows(name, run, options.seconds)
    lines = [
        f"Exports against our own simulation with the same model, up to {options.seconds:g} s of each trajectory",
        f"C: {STRIDES['law']} (law) and {STRIDES['network']} (network) steps per sample of 2.5 ms; "
        f"MuJoCo {mujoco.__version__}",
        "differences of the friction force, root mean square, % of the force's own",
        "",
        f"{'model':16s}{'trajectory':12s}{'C':>8s}{'MuJoCo at, ms':>14s}{'rail':>14s}{'plane':>14s}",
        *(line for name in VARIANTS for line in table[name]),
        "",
        "ONNX (single precision) against torch (double), 1000 made-up histories, largest difference:",
        *(line for name in VARIANTS for line in checks[name]),
    ]
    text = "\n".join(lines) + "\n"
    print(text)
    result.write_text(text)


if __name__ == "__main__":
    main()
