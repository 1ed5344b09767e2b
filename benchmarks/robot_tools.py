"""frictionpinn beside mujoco.sysid and FIGAROH on the same UR10e recordings: torque error, time, lines of a user.

    python -m venv /tmp/figaroh && /tmp/figaroh/bin/pip install figaroh
    python -m venv /tmp/mujoco && /tmp/mujoco/bin/pip install "mujoco[sysid]==3.8.1"
    python benchmarks/robot_tools.py --figaroh /tmp/figaroh/bin/python --mujoco /tmp/mujoco/bin/python

Each fits ``50sec`` and ``30sec`` and predicts the torques of ``40sec`` and ``ptp``, which it has not seen. All declare
the same: free inertias, motor inertia, Coulomb and viscous friction and an offset in each joint; frictionpinn says
beside that what it adds of itself (``diagnose``). The other two read arrays, so they get the recordings in even steps.
Both smooth positions by a zero-phase Butterworth low-pass at the same 8 Hz (FIGAROH's own; mujoco.sysid leaves
smoothing to its user). Torque error: norm of predicted less measured torque over the norm of the measured, both behind
the same low-pass, in %. A tool that is not there is told with its reason. Results go to results/robot_tools.txt.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from frictionpinn.data.public import fetch
from frictionpinn.data.sets import load_public
from frictionpinn.physics import LAWS
from frictionpinn.physics.robot import Base, Robot
from frictionpinn.robots.diagnose import diagnose
from frictionpinn.robots.identify import declare, identify, relative_errors
from frictionpinn.robots.motion import EDGE, _even, _lowpass, prepare, rate_of

HERE = Path(__file__).parent
FITTED, HELD_OUT = ("50sec", "30sec"), ("40sec", "ptp")
CUTOFF_HZ = 8.0  # customary for these recordings
ITERATIONS = 40  # of mujoco.sysid at most: the cost then falls by 0.1 % in one, a minute of processor goes by
BEGIN, END = "# what a user writes: begin", "# what a user writes: end"
INSTALLED = {"figaroh": "pip install figaroh", "mujoco": 'pip install "mujoco[sysid]==3.8.1"'}
COMMAND = """\
python diagnose.py system=robot robot.file=ur10e.urdf robot.torque=motor friction=coulomb_viscous
  'diagnose.declared=[constant_force]' robot.cutoff_hz=8
  data.path=logs.csv data.trial_column=run 'data.held_out=[40sec, ptp]'
  'data.columns={t: timestamp, q: actual_q_*, current: actual_current_*}'
  'robot.gains=[14.87, 13.26, 11.13, 10.62, 11.03, 11.47]'"""


@dataclass(frozen=True)
class Outcome:
    """What a tool reached: seconds of processor, lines that a user writes, motion -> errors of the joints."""

    tool: str
    seconds: float
    lines: int
    errors: dict[str, np.ndarray]
    note: str = ""


def ours(recording, robot: Robot) -> list[Outcome]:
    """frictionpinn: the declared model, and with what its diagnosis adds."""
    base, found = Base.of(robot), []
    began = time.process_time()
    trials = prepare(recording, robot, base, CUTOFF_HZ, recording.select(list(FITTED)))
    table = {trial.name: trial for trial in trials}
    fitted, held = ([table[name] for name in names] for names in (FITTED, HELD_OUT))
    model = declare(robot, base, LAWS["coulomb_viscous"](), ["constant_force"])
    prepared = time.process_time() - began
    began = time.process_time()
    solution = identify(model, fitted)
    lines = len(COMMAND.splitlines())
    seconds = prepared + time.process_time() - began
    found.append(Outcome("frictionpinn, declared", seconds, lines, relative_errors(solution.model, held)))
    began = time.process_time()
    d = diagnose(model, fitted, held)
    errors = {name: d.errors[name][1] for name in HELD_OUT}
    named = ", ".join(a.term.name for a in d.accepted)
    found.append(Outcome("frictionpinn, diagnosed", prepared + time.process_time() - began, lines, errors, named))
    return found


def another(tool: str, interpreter: str | None, recording, robot: Robot, limit: float) -> Outcome | str:
    """Another tool, run by its own interpreter on the motions as arrays; a reason where there is no outcome."""
    if interpreter is None or not shutil.which(interpreter):
        return f"{tool}: not run; {INSTALLED[tool]} in an environment of its own, and --{tool} its python"
    script = HERE / f"robot_tools_{tool}.py"
    rate = float(np.median([rate_of(trial) for trial in recording.trials]))
    with tempfile.TemporaryDirectory() as made:
        folder, arrays, measured = Path(made), {}, {}
        for trial in recording.trials:
            count = len(robot.joints)
            for kind, degree in (("q", 3), ("tau", 1)):
                names = [f"{kind}_{k + 1}" for k in range(count)]
                arrays[f"{trial.name}_{kind}"] = _even(trial, rate, names, degree)[1]
            measured[trial.name] = arrays[f"{trial.name}_tau"]
        np.savez(folder / "motions.npz", **arrays)
        (folder / "robot.urdf").write_text(_bare(Path(fetch("ur10e", ["urdf"])["urdf"])))
        task = {
            "joints": list(robot.joints), "fitted": FITTED, "predicted": HELD_OUT, "rate": rate, "cutoff_hz": CUTOFF_HZ,
            "edge_s": EDGE / CUTOFF_HZ, "thinned": int(rate / (2 * CUTOFF_HZ)),
            "iterations": ITERATIONS,
        }  # fmt: skip
        (folder / "task.json").write_text(json.dumps(task))
        try:
            run = subprocess.run([interpreter, str(script), made], capture_output=True, text=True, timeout=limit)
        except subprocess.TimeoutExpired:
            return f"{tool}: no answer in {limit / 60:g} minutes"
        if run.returncode:
            return f"{tool}: {(run.stderr.strip().splitlines() or ['ended without a word'])[-1]}"
        answer = np.load(folder / "predicted.npz")
        errors = {name: _error(answer[name], measured[name], rate) for name in HELD_OUT}
        written = script.read_text().partition(BEGIN)[2].partition(END)[0].splitlines()
        lines = sum(bool(line.strip()) and not line.strip().startswith("#") for line in written)
        return Outcome(tool, float(answer["seconds"]), lines, errors, f"{answer['parameters']} parameters")


def _bare(urdf: Path) -> str:
    """A URDF without shapes: both would look for the meshes, which the recordings' home does not hold."""
    tree = ElementTree.parse(urdf)
    for link in tree.getroot().iter("link"):
        for shape in [*link.findall("visual"), *link.findall("collision")]:
            link.remove(shape)
    return ElementTree.tostring(tree.getroot(), encoding="unicode")


def _error(predicted: np.ndarray, measured: np.ndarray, rate: float) -> np.ndarray:
    """Relative torque error of each joint, as ``relative_errors`` has it."""
    both = _lowpass(predicted, rate, CUTOFF_HZ), _lowpass(measured, rate, CUTOFF_HZ)
    edge = round(EDGE / CUTOFF_HZ * rate)
    made, true = (x[edge:-edge] for x in both)
    return np.linalg.norm(made - true, axis=0) / np.linalg.norm(true, axis=0)


def told(outcomes: list[Outcome | str]) -> str:
    """The table."""
    lines = ["torque error on held-out motions, % of the norm, joints 1 to 6 and mean", ""]
    lines.append(f"{'tool':26} {'held out':8} {'joints 1 to 6':36} {'mean':>6} {'cpu, s':>7} {'lines':>6}")
    for o in outcomes:
        if isinstance(o, str):
            lines.append(o)
            continue
        for name, errors in o.errors.items():
            each = " ".join(f"{100 * e:5.1f}" for e in errors)
            more = f" {o.seconds:7.1f} {o.lines:6d}" if name == HELD_OUT[0] else ""
            lines.append(f"{o.tool:26} {name:8} {each:36} {100 * np.mean(errors):6.1f}{more}")
        if o.note:
            lines.append(f"    {o.note}")
    return "\n".join([*lines, "", "lines of frictionpinn: the command for a log of one's own,", COMMAND])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--figaroh", help="python of an environment that has figaroh")
    parser.add_argument("--mujoco", help="python of an environment that has mujoco[sysid]")
    parser.add_argument("--minutes", type=float, default=20.0, help="that another tool may take")
    args = parser.parse_args()
    robot = Robot.read(fetch("ur10e", ["urdf"])["urdf"])
    recording = load_public("ur10e", trials=[*FITTED, *HELD_OUT])
    outcomes: list[Outcome | str] = [*ours(recording, robot)]
    for tool in ("figaroh", "mujoco"):
        outcomes.append(another(tool, getattr(args, tool), recording, robot, 60 * args.minutes))
        (HERE / "results" / "robot_tools.txt").write_text(told(outcomes) + "\n")
    print(told(outcomes))


if __name__ == "__main__":
    main()
