"""Compiled simulations: kept on disk, shared by processes, and fast."""

import os
import pickle
import subprocess
import sys
import time

import numpy as np
from motions import path, simulator, values
from short_paths import T

_SCRIPT = """
import time
from frictionpinn.numerics.simulate import Simulator
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.mechanism import Mechanism
import numpy as np
import frictionpinn.numerics.integrator
sim = Simulator(Mechanism(SYSTEMS["drive"](), LAWS["dahl"]()))
start = time.perf_counter()
sim.simulate(np.arange(10) / 400, {}, {"sigma_0": 1e4, "mu_c": 0.3}, sensitivities=["mu_c"])
print(time.perf_counter() - start)
"""


def run_script(**environment):
    return subprocess.run(
        [sys.executable, "-c", _SCRIPT], capture_output=True, text=True, env=os.environ | environment, check=True
    )


def test_a_second_process_starts_warm():
    run_script()
    assert float(run_script().stdout) < 1.0


def test_a_simulator_can_be_sent_to_another_process():
    sim = simulator("drive", "lugre")
    expected = sim.simulate(T, path(sim), values("lugre"))
    copy = pickle.loads(pickle.dumps(sim))
    np.testing.assert_array_equal(copy.simulate(T, path(sim), values("lugre")).v, expected.v)


def test_an_unwritable_cache_falls_back_to_a_temporary_folder(tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("")
    process = run_script(FRICTIONPINN_CACHE=str(blocked))
    assert float(process.stdout) > 0
    assert "cannot be written" in process.stderr


def test_processes_may_compile_the_same_mechanism_at_once(tmp_path):
    environment = os.environ | {"FRICTIONPINN_CACHE": str(tmp_path)}
    processes = [
        subprocess.Popen(
            [sys.executable, "-c", _SCRIPT], env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE
        )
        for _ in range(3)
    ]
    outcomes = [process.communicate(timeout=60) for process in processes]
    assert all(process.returncode == 0 for process in processes), outcomes
    assert not list(tmp_path.rglob("*.tmp"))


def test_a_simulation_takes_microseconds_per_sample():
    sim, t = simulator("pob", "lugre"), np.arange(801) / 400
    inputs = path(sim, t)
    spent = []
    for _ in range(5):
        start = time.perf_counter()
        sim.simulate(t, inputs, values("lugre"))
        spent.append(time.perf_counter() - start)
    assert min(spent) / len(t) < 50e-6
