"""Time of a maximum-likelihood fit against the number of trials, samples and parameters, up to 100 times the data.

    python benchmarks/identify_scaling.py [--quick]

A 2 s pendulum-on-a-box trial with 5 % noise on all six signals, the swing unknown, noise levels estimated. Processor
time, since other work may share the machine. ``--quick`` stops at 10 times the data and writes nothing; otherwise
writes benchmarks/results/identify_scaling.txt (about three minutes).
"""

from __future__ import annotations

import argparse
import os
import platform
import time

import numpy as np
from identify_accuracy import LEVEL, ROOT, bounds_for, protocol

from frictionpinn.data.noise import GaussianNoise
from frictionpinn.data.recording import Recording, Trial
from frictionpinn.data.simulated import simulate_recording
from frictionpinn.identify import Problem, maximum_likelihood

RESULT = ROOT / "benchmarks" / "results" / "identify_scaling.txt"
TRIAL, RATE_HZ = 4, 200.0  # of the protocol: one that slides; samples in a second where trials are counted
COPIES = (1, 3, 10, 30, 100)
RATES_HZ = (100.0, 300.0, 1000.0, 3000.0, 10000.0)
FREE = ("mu_c", "sigma_2", "sigma_0", "sigma_1", "mu_s", "v_s")
REPEATS = 3  # of one evaluation with derivatives


def recording(copies: int, rate_hz: float) -> Recording:
    """The trial ``copies`` times, each with its own noise."""
    mechanism, truth, trials = protocol()
    clean = simulate_recording(mechanism.system, "lugre", truth, [trials[TRIAL]], rate_hz)
    copied = [Trial(f"{k}", t.t, t.signals) for k in range(copies) for t in clean.trials]
    return GaussianNoise(LEVEL)(Recording(tuple(copied), clean.units), 0)


def measure(data: Recording, free: tuple[str, ...] = FREE) -> tuple[float, float, int]:
    """Processor time of a fit and of one evaluation with derivatives, s, and the number of simulations."""
    mechanism, truth, _ = protocol()
    bounds = {name: pair for name, pair in bounds_for(truth, 0).items() if name in free}
    fixed = {name: value for name, value in truth.items() if name not in free}
    began = time.process_time()
    problem = Problem(mechanism, data, free=free, fixed=fixed, bounds=bounds)
    estimate = maximum_likelihood(problem)
    fit = time.process_time() - began
    assert estimate.minimum is not None
    state, models = estimate.minimum.state, estimate.minimum.models
    began = time.process_time()
    for _ in range(REPEATS):
        problem.evaluator(models)(state.u, state.locals, True)
    return fit, (time.process_time() - began) / REPEATS, estimate.n_simulations


def exponent(sizes: list[int], seconds: list[float]) -> float:
    """Slope of log time over log size."""
    return float(np.polyfit(np.log(sizes), np.log(seconds), 1)[0])


def table(title: str, cases: list[tuple[int, Recording, tuple[str, ...]]]) -> list[str]:
    """One line a case (size, recording, free parameters), and the exponents of time."""
    head = f"{title:>12s}{'samples':>10s}{'fit s':>10s}{'simulations':>13s}{'ms a simulation with derivatives':>34s}"
    lines, sizes, fits, single = ["", head], [], [], []
    print(head, flush=True)
    for size, data, free in cases:
        fit, one, simulations = measure(data, free)
        sizes, fits, single = [*sizes, size], [*fits, fit], [*single, one]
        lines.append(f"{size:12d}{len(data):10d}{fit:10.2f}{simulations:13d}{1e3 * one:34.2f}")
        print(lines[-1], flush=True)
    lines.append(f"time grows as {title} to the power {exponent(sizes, fits):.2f} (fit), "
                 f"{exponent(sizes, single):.2f} (simulation with derivatives)")  # fmt: skip
    print(lines[-1], flush=True)
    return lines


def study(copies: tuple[int, ...], rates_hz: tuple[float, ...]) -> list[str]:
    measure(recording(1, RATE_HZ))  # compiles
    lines = [
        "Processor time of maximum likelihood on a 2 s pendulum-on-a-box trial, 5 % noise on all six signals",
        f"Python {platform.python_version()}, {os.cpu_count()} cores (shared), load {os.getloadavg()[0]:.1f}",
        f"trials and parameters at {RATE_HZ:g} Hz; samples of one trial at {rates_hz[0]:g} to {rates_hz[-1]:g} Hz",
    ]
    lines += table("trials", [(n, recording(n, RATE_HZ), FREE) for n in copies])
    one_trial = [recording(1, rate) for rate in rates_hz]
    lines += table("samples", [(len(data), data, FREE) for data in one_trial])
    five = recording(5, RATE_HZ)
    return lines + table("parameters", [(n, five, FREE[:n]) for n in range(1, len(FREE) + 1)])


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="at most 10 times the data")
    quick = parser.parse_args().quick
    text = study(COPIES[:3], RATES_HZ[:3]) if quick else study(COPIES, RATES_HZ)
    if not quick:
        RESULT.parent.mkdir(parents=True, exist_ok=True)
        RESULT.write_text("\n".join(text) + "\n")
