"""A fleet of simulated arms diagnosed by one command, stopped half way and resumed: who lacks what, who stands out.

    python benchmarks/fleet.py --arms 200

Arms of seven joints with Coulomb and viscous friction, some per cent apart; 40 % have friction that grows with the load
in joint 2, every tenth an offset in joint 4, and the last has twice the friction of the others in joint 3. Torques of
given motions, 20 s at 200 Hz, 2 % of noise, encoder noise. Results go to results/fleet.txt.
"""

from __future__ import annotations

import argparse
import csv
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from robot_arms import reference, seven

from frictionpinn.physics.robot import Robot

ROOT = Path(__file__).resolve().parents[1]
RESULTS = Path(__file__).parent / "results" / "fleet.txt"
EVERY = 10  # of the reference's steps: 200 Hz


def logs(folder: Path, count: int) -> dict[str, set[str]]:
    """Write the logs; what each arm lacks."""
    robot, truth = Robot.read(seven(folder / "seven.urdf")), {}
    rng = np.random.default_rng(0)
    usual = np.array([2.0, 8.0, 2.0, 5.0, 1.0, 1.5, 0.6])
    (folder / "logs").mkdir()
    for k in range(count):
        t, q, v, a = (x[::EVERY] for x in reference(rng, 7, 20.0))
        mu, viscous = usual * (1 + 0.05 * rng.standard_normal((2, 7)))
        share, offset = 0.06 * (rng.random() < 0.4), 0.6 * (k % 10 == 4)
        mu[2] *= 2.0 if k == count - 1 else 1.0
        load = robot.inverse_dynamics(q, v, a)
        tau = load + mu * np.sign(v) + 0.5 * viscous * v
        tau[:, 1] += share * np.abs(load[:, 1]) * np.sign(v[:, 1])
        tau[:, 3] += offset
        tau += 0.02 * np.sqrt(np.mean(tau**2, axis=0)) * rng.standard_normal(tau.shape)
        table = np.column_stack([t, q + 1e-5 * rng.standard_normal(q.shape), tau])
        names = ["t", *(f"q_{j}" for j in range(1, 8)), *(f"tau_{j}" for j in range(1, 8))]
        np.savetxt(folder / "logs" / f"arm_{k:03d}.csv", table, "%.8g", ",", header=",".join(names), comments="")
        truth[f"arm_{k:03d}.csv"] = {*(["load_friction@joint_2"] if share else []),
                                     *(["constant_force@joint_4"] if offset else [])}  # fmt: skip
    return truth


def run(folder: Path, *options: str, until: int | None = None) -> tuple[str, float]:
    """What ``diagnose.py`` says and its seconds; stopped by Ctrl-C when ``until`` recordings have a result."""
    began, said = time.perf_counter(), folder / "said.txt"
    with said.open("w", encoding="utf-8") as file:
        command = [sys.executable, str(ROOT / "diagnose.py"), *options]
        process = subprocess.Popen(command, cwd=folder, stdout=file, stderr=subprocess.STDOUT)
        while process.poll() is None:
            if until is not None and results(folder) >= until:
                process.send_signal(signal.SIGINT)
                until = None
            time.sleep(1.0)
    return said.read_text(encoding="utf-8"), time.perf_counter() - began


def results(folder: Path) -> int:
    """Recordings that are diagnosed."""
    return len(list((folder / "fleet").glob("*/result.json")))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--arms", type=int, default=200)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        truth = logs(folder, args.arms)
        first = ["-m", "system=robot", "robot.file=seven.urdf", "robot.torque=motor", "friction=coulomb_viscous",
                 "data.path=glob(logs/*.csv)", "hydra.sweep.dir=fleet"]  # fmt: skip
        _, before = run(folder, *first, until=args.arms // 2)
        stopped = results(folder)
        kept = {path: path.stat().st_mtime_ns for path in (folder / "fleet").glob("*/result.json")}
        said, after = run(folder, "resume=fleet")
        again = sum(path.stat().st_mtime_ns != time_ for path, time_ in kept.items())
        with (folder / "fleet" / "fleet.csv").open(encoding="utf-8") as file:
            rows = {row["recording"]: row for row in csv.DictReader(file)}
        (RESULTS.parent / "fleet.html").write_text((folder / "fleet" / "fleet.html").read_text(encoding="utf-8"))
    found = {name: set(row["effects"].split()) for name, row in rows.items()}
    # An offset and dry friction that differs by direction are one where the joint always moves.
    alike = {name: {e.replace("asymmetry@", "constant_force@") for e in own} for name, own in found.items()}
    right = sum(alike[name] == own for name, own in truth.items())
    odd = [name for name, row in rows.items() if "joint_3.mu_c" in row["stands_out"]]
    lines = [
        said[said.rfind(f"[{args.arms}/{args.arms}]") :].rstrip(),
        f"stopped after {stopped} recordings, resumed: {len(rows)} diagnosed in all, {again} of them twice",
        f"exactly what it lacks: {right} of {len(truth)}; missed: "
        f"{sum(len(own - alike[n]) for n, own in truth.items())} effects, "
        f"too many: {sum(len(alike[n] - own) for n, own in truth.items())}",
        f"twice the friction in joint 3: arm_{args.arms - 1:03d}.csv; stands out by it: {', '.join(odd) or 'none'}",
        f"{(before + after) / len(truth):.1f} s a recording, one after another",
    ]
    text = "\n".join(lines)
    RESULTS.write_text(text + "\n", encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
