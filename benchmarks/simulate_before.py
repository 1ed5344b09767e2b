"""Time of a simulation in this checkout beside another one: is a change of the integrator free?

    python benchmarks/simulate_before.py ../before

Both simulate the same mechanisms of one contact with one process each, a batch at a time in turns, so that what else
the machine does meets both; the ratio is the median over the turns of processor times. Written to
benchmarks/results/simulate_before.json.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
CASES = {"pob": "lugre", "sdob": "lugre", "drive": "stribeck"}
WORKER = """
import sys, time
sys.path.insert(0, "tests")
from short_paths import LAW_VALUES, PATHS
import numpy as np
from frictionpinn.numerics.paths import InputPath
from frictionpinn.numerics.simulate import Simulator
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.mechanism import Mechanism

t, made = np.arange(801) / 400, {}
for system, law in %r.items():
    sim = Simulator(Mechanism(SYSTEMS[system](), LAWS[law]()))
    p = sim.parameters({par.name: LAW_VALUES[par.name] for par in LAWS[law].parameters})
    path = InputPath.from_expressions(sim.mechanism, t, PATHS[system])
    names = ["mu_c", "sigma_2"]
    made[system] = {
        "plain": lambda sim=sim, p=p, path=path: sim.simulate(t, path, p),
        "sensitivities": lambda sim=sim, p=p, path=path: sim.simulate(t, path, p, sensitivities=names),
    }
    for run in made[system].values():
        run()
print("ready", flush=True)
for line in sys.stdin:
    system, kind, count = line.split()
    run, start = made[system][kind], time.process_time()
    for _ in range(int(count)):
        run()
    print((time.process_time() - start) / int(count), flush=True)
"""


class Worker:
    """A process that simulates with the code of a checkout."""

    def __init__(self, folder: Path):
        environment = os.environ | {"PYTHONPATH": str(folder), "OMP_NUM_THREADS": "1"}
        code = [sys.executable, "-c", WORKER % CASES]
        self.process = subprocess.Popen(
            code, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=folder, env=environment
        )
        assert self._line() == "ready"

    def _line(self) -> str:
        assert self.process.stdout is not None
        return self.process.stdout.readline().strip()

    def seconds(self, system: str, kind: str, count: int) -> float:
        """Processor time of one simulation, s."""
        assert self.process.stdin is not None
        self.process.stdin.write(f"{system} {kind} {count}\n")
        self.process.stdin.flush()
        return float(self._line())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("before", type=Path, help="folder of the other checkout")
    parser.add_argument("--turns", type=int, default=40)
    parser.add_argument("--count", type=int, default=50, help="simulations in a turn")
    args = parser.parse_args()
    now, before = Worker(ROOT), Worker(args.before.resolve())
    result = {}
    for system in CASES:
        for kind in ("plain", "sensitivities"):
            pairs = np.array(
                [
                    [worker.seconds(system, kind, args.count) for worker in (now, before)[:: 1 if k % 2 else -1]]
                    for k in range(args.turns)
                ]
            )
            pairs[::2] = pairs[::2, ::-1]
            ratio, (here, there) = float(np.median(pairs[:, 0] / pairs[:, 1])), np.median(pairs, axis=0)
            result[f"{system}, {kind}"] = {"ms": 1e3 * here, "ms_before": 1e3 * there, "ratio": ratio}
            print(f"{system:6s} {kind:14s} {1e3 * here:7.3f} ms, before {1e3 * there:7.3f} ms, ratio {ratio:.3f}")
    path = ROOT / "benchmarks" / "results" / "simulate_before.json"
    path.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
