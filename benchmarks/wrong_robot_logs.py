"""Some thirty ways to get the log of a robot wrong: which are caught by the check before any fit, which pass silently.

    python benchmarks/wrong_robot_logs.py

A simulated UR10e in closed loop (``robot_arms``), 20 s at 1 kHz, once as it is and once for every way. "refused": a
grave finding or an error in a line; "told": a finding that names it, the fit goes on. What a diagnosis would say of
those that pass is not asked here.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
from robot_arms import recorded
from robots import RESULTS, SPEEDS, made

from frictionpinn.errors import UserError
from frictionpinn.robots.check import inspect_robot
from frictionpinn.robots.recording import read_robot

Table = dict[str, np.ndarray]
SEED = 18  # a clean arm
OPTIONS = {
    "gravity declared upside down": {"gravity": [0, 0, 9.81]},
    "gravity declared sideways": {"gravity": [0, -9.81, 0]},
    "torques behind the gear declared": {"motor": False},
    "joints in another order": {"order": [0, 2, 1, 3, 4, 5]},
}


def columns(table: Table, kind: str, change: Callable[[np.ndarray, int], np.ndarray], joints=range(1, 7)) -> Table:
    return table | {f"{kind}_{k}": change(table[f"{kind}_{k}"], k) for k in joints}


def swap(table: Table, one: str, other: str) -> Table:
    return table | {one: table[other], other: table[one]}


def rows(table: Table, keep) -> Table:
    return {name: values[keep] for name, values in table.items()}


def clip(y: np.ndarray, share: float) -> np.ndarray:
    return np.clip(y, *np.quantile(y, [share, 1 - share]))


def steps(y: np.ndarray, count: int) -> np.ndarray:
    return np.round(count * y / np.ptp(y)) * np.ptp(y) / count


def ways(rng: np.random.Generator) -> dict[str, Callable[[Table], Table]]:
    """Name -> what becomes of the table."""
    n = 20000
    return {
        "positions in degrees": lambda t: columns(t, "q", lambda y, k: np.degrees(y)),
        "one position in degrees": lambda t: columns(t, "q", lambda y, k: np.degrees(y), [3]),
        "positions of the motors (gear 100)": lambda t: columns(t, "q", lambda y, k: 100 * y),
        "positions in turns": lambda t: columns(t, "q", lambda y, k: y / 2 / np.pi),
        "torques in N mm": lambda t: columns(t, "tau", lambda y, k: 1000 * y),
        "torques in kN m": lambda t: columns(t, "tau", lambda y, k: y / 1000),
        "currents for torques (gains 10)": lambda t: columns(t, "tau", lambda y, k: y / 10),
        "torques at the motors' shafts (gear 100)": lambda t: columns(t, "tau", lambda y, k: y / 100),
        "gear ratio of one joint twice too large": lambda t: columns(t, "tau", lambda y, k: 2 * y, [3]),
        "gear ratio of one joint ten times too small": lambda t: columns(t, "tau", lambda y, k: y / 10, [2]),
        "every torque's sign turned": lambda t: columns(t, "tau", lambda y, k: -y),
        "one torque's sign turned": lambda t: columns(t, "tau", lambda y, k: -y, [3]),
        "one position's sign turned": lambda t: columns(t, "q", lambda y, k: -y, [2]),
        "torques of joints 2 and 3 swapped": lambda t: swap(t, "tau_2", "tau_3"),
        "positions of joints 2 and 3 swapped": lambda t: swap(t, "q_2", "q_3"),
        "torques and positions of joints 2 and 3 swapped": lambda t: swap(swap(t, "tau_2", "tau_3"), "q_2", "q_3"),
        "one torque twice": lambda t: t | {"tau_3": t["tau_2"]},
        "torques late by 50 ms": lambda t: columns(t, "tau", lambda y, k: np.roll(y, 50)),
        "torques late by one sample": lambda t: columns(t, "tau", lambda y, k: np.roll(y, 1)),
        "torques early by 20 ms": lambda t: columns(t, "tau", lambda y, k: np.roll(y, -20)),
        "one torque clipped at its upper tenth": lambda t: columns(t, "tau", lambda y, k: clip(y, 0.1), [2]),
        "one torque in 16 steps": lambda t: columns(t, "tau", lambda y, k: steps(y, 16), [3]),
        "one torque constant": lambda t: columns(t, "tau", lambda y, k: np.full(n, 3.0), [3]),
        "one torque noise alone": lambda t: columns(t, "tau", lambda y, k: y.std() * rng.standard_normal(n), [3]),
        "a joint that stands still": lambda t: columns(t, "q", lambda y, k: np.full(n, y[0]), [5]),
        "zero of one position off by 40 degrees": lambda t: columns(t, "q", lambda y, k: y + 0.7, [2]),
        "time in milliseconds": lambda t: t | {"t": 1000 * t["t"]},
        "time that runs 10 % fast": lambda t: t | {"t": 1.1 * t["t"]},
        "a missing value": lambda t: columns(t, "q", lambda y, k: np.where(np.arange(n) == 50, np.nan, y), [1]),
        "joint commands for measured torques": lambda t: columns(t, "tau", lambda y, k: 1e-3 * y, [1, 2, 3]),
    } | dict.fromkeys(OPTIONS, lambda t: t)  # fmt: skip


def main() -> None:
    lines, silent = [], 0
    usual: set[str] = set()  # what is said of the log as it is, too, tells nothing
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        arm, _, _, rng = made(SEED, folder)
        (trial,) = recorded(arm, rng, (20.0,), SPEEDS).trials
        table = {"t": trial.t, **trial.signals}
        for name, change in ({"as it is": lambda t: t} | ways(rng)).items():
            path = folder / "log.csv"
            pd.DataFrame(change(dict(table))).to_csv(path, index=False, float_format="%.7g")
            options, robot = OPTIONS.get(name, {}), arm.robot
            if "order" in options:
                robot = type(robot).read(_file(), joints=[robot.joints[k] for k in options["order"]])
            elif "gravity" in options:
                robot = type(robot).read(_file(), gravity=options["gravity"])
            try:
                findings = inspect_robot(robot, read_robot(path, robot), options.get("motor", True))
            except UserError as error:
                findings = [replace(_finding(), what=str(error))]
            if name == "as it is":
                usual = {kind(f.what) for f in findings}
            told = [f for f in findings if kind(f.what) not in usual or name == "as it is"]
            grave = [f for f in told if f.grave]
            verdict = "refused" if grave else "told" if told else "passes"
            silent += verdict == "passes" and name != "as it is"
            lines.append(f"{verdict:8} {name:48} {str((grave or told or [''])[0])[:150]}")
            print(lines[-1], flush=True)
    total = len(lines) - 1
    lines.append(f"{silent} of {total} ways pass silently")
    print(lines[-1])
    (RESULTS / "wrong_robot_logs.txt").write_text("\n".join(lines) + "\n")


def kind(what: str) -> str:
    """A finding without its figures."""
    return re.sub(r"[-+\d.e_]+", "", what)[:40]


def _file() -> Path:
    from frictionpinn.data.public import fetch

    return fetch("ur10e", ["urdf"])["urdf"]


def _finding():
    from frictionpinn.data.findings import Finding

    return Finding("", grave=True)


if __name__ == "__main__":
    main()
