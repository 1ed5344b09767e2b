"""How long an arm's recording takes: identification and diagnosis of all joints, by samples and by joints.

    python benchmarks/robot_time.py            60 s at 1 kHz of six joints: 360,000 samples; its half; and seven joints

Arms as in robot_arms.py, LuGre at every joint, all inertias free, nothing undeclared: every term is tried and refused.
Processor seconds of one core stand beside those of the clock. Results go to results/robot_time.txt.
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

from frictionpinn.physics import LAWS
from frictionpinn.physics.robot import Base
from frictionpinn.robots.diagnose import diagnose
from frictionpinn.robots.identify import declare, identify
from frictionpinn.robots.motion import prepare

RESULTS = Path(__file__).parent / "results" / "robot_time.txt"


def timed(work: Callable) -> tuple[object, float, float]:
    """What a call gives, its seconds by the clock and of the processor."""
    clock, processor = time.perf_counter(), time.process_time()
    made = work()
    return made, time.perf_counter() - clock, time.process_time() - processor


def one(seed: int, duration: float, folder: Path) -> str:
    """A line of the table."""
    robot, rng = robot_of(seed, folder), np.random.default_rng(seed)
    n = len(robot.joints)
    effort = np.maximum(np.sqrt(np.mean(robot.inverse_dynamics(*rng.uniform(-0.8, 0.8, (3, 200, n))) ** 2, axis=0)), 4)
    recording, base = recorded(draw(robot, rng, effort), rng, (duration,)), Base.of(robot)
    model = declare(robot, base, LAWS["lugre"]())
    trials, *prepared = timed(lambda: prepare(recording, robot, base))
    _, *identified = timed(lambda: identify(model, trials))
    found, *diagnosed = timed(lambda: diagnose(model, trials))
    named = ", ".join(a.term.name for a in found.accepted) or "nothing"
    parts = "".join(f"{c:9.1f} ({p:5.1f})" for c, p in (prepared, identified, diagnosed))
    samples = len(recording.trials[0].t)
    return f"{robot.name[:6]:6} {n:6} {duration:6.0f} {n * samples:9d} {parts}   {named}"


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
    with tempfile.TemporaryDirectory() as folder:
        for seed, durations in ((0, args.seconds), (1, args.seconds[-1:])):
            for duration in durations:
                lines.append(one(seed, duration, Path(folder)))
                print(lines[-1], flush=True)
    RESULTS.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
