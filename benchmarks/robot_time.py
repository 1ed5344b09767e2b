"""How long an arm's recording takes, by samples and by joints, and how long a sample takes online.

    python benchmarks/robot_time.py            60 s at 1 kHz of six joints: 360,000 samples; its half; and seven joints

Arms as in robot_arms.py, LuGre at every joint, all inertias free, nothing undeclared: every term is tried and refused.
Processor seconds of one core stand beside those of the clock. Then the model that was identified is used online on
another run: time of a sample, and error of the friction torque over the true one, from encoder positions and their
differences through the controller's filter alone. Results go to results/robot_time.txt.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from robot_arms import draw, recorded
from robots import robot_of

from frictionpinn.data.recording import Trial
from frictionpinn.physics import LAWS
from frictionpinn.physics.robot import Base
from frictionpinn.robots import Arm, Observer
from frictionpinn.robots.diagnose import diagnose
from frictionpinn.robots.identify import declare, identify
from frictionpinn.robots.motion import prepare

LATER, BEGUN = 10.0, 0.5  # s: of the run that is used online, and from when it counts
FILTER = 0.2  # of the controller's velocities, a sample
RESULTS = Path(__file__).parent / "results" / "robot_time.txt"


def timed(work: Callable) -> tuple[object, float, float]:
    """What a call gives, its seconds by the clock and of the processor."""
    clock, processor = time.perf_counter(), time.process_time()
    made = work()
    return made, time.perf_counter() - clock, time.process_time() - processor


def one(seed: int, duration: float, folder: Path) -> tuple[str, str]:
    """A line of the table, and one of what it is worth online."""
    robot, rng = robot_of(seed, folder), np.random.default_rng(seed)
    n = len(robot.joints)
    effort = np.maximum(np.sqrt(np.mean(robot.inverse_dynamics(*rng.uniform(-0.8, 0.8, (3, 200, n))) ** 2, axis=0)), 4)
    arm = draw(robot, rng, effort)
    recording, base = recorded(arm, rng, (duration, LATER)), Base.of(robot)
    model, samples = declare(robot, base, LAWS["lugre"]()), len(recording.trials[0].t)
    trials, *prepared = timed(lambda: prepare(recording.select([recording.names[0]]), robot, base))
    fit, *identified = timed(lambda: identify(model, trials))
    found, *diagnosed = timed(lambda: diagnose(model, trials))
    named = ", ".join(a.term.name for a in found.accepted) or "nothing"
    parts = "".join(f"{c:9.1f} ({p:5.1f})" for c, p in (prepared, identified, diagnosed))
    line = f"{robot.name[:6]:6} {n:6} {duration:6.0f} {n * samples:9d} {parts}   {named}"
    return line, f"{robot.name[:6]:6} {n:6} {duration:6.0f} {online(Arm.identified(fit.model), recording.trials[1])}"


def online(arm: Arm, trial: Trial) -> str:
    """Microseconds of a sample, median and 99 of 100, and error of the friction torque of each joint, %."""
    q, F = (np.stack([table[f"{kind}_{k + 1}"] for k in range(len(arm.names))], axis=1)
            for kind, table in (("q", trial.signals), ("F", trial.truth)))  # fmt: skip
    observer, v, said, spent = Observer(arm), np.zeros(q.shape[1]), [], []
    for k, t in enumerate(trial.t):
        v = v + FILTER * ((q[k] - q[k - 1]) / (t - trial.t[k - 1]) - v) if k else v
        began = time.perf_counter()
        said.append(observer.step(float(t), q[k], v).friction)
        spent.append(time.perf_counter() - began)
    later = trial.t > BEGUN
    off = np.sqrt(np.mean((np.array(said) - F)[later] ** 2, axis=0) / np.mean(F[later] ** 2, axis=0))
    each = " ".join(f"{100 * x:4.1f}" for x in off)
    return f"{1e6 * np.median(spent):8.0f} {1e6 * np.quantile(spent, 0.99):8.0f}   {each}, mean {100 * off.mean():.1f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, nargs="+", default=(30.0, 60.0))
    args = parser.parse_args()
    head = (
        f"{'robot':6} {'joints':>6} {'s':>6} {'samples':>9}"
        f"{'preparing':>18}{'identifying':>17}{'diagnosing':>17}   named"
    )
    lines = ["seconds by the clock (of one processor), diagnosis with its own identification", head]
    print("\n".join(lines), flush=True)
    used = ["", "online: microseconds of a sample, median and 99 of 100; error of each joint's friction torque, %"]
    with tempfile.TemporaryDirectory() as folder:
        for seed, durations in ((0, args.seconds), (1, args.seconds[-1:])):
            for duration in durations:
                line, own = one(seed, duration, Path(folder))
                lines.append(line)
                used.append(own)
                print(line, own, sep="\n", flush=True)
    lines += used
    RESULTS.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
