"""Noise reduction of the smoothers on a swing angle and on a stick-slip coordinate, with 5 % noise on every signal.

The reduction factor is the root mean square error of the noisy signal over that of the smoothed one. Run as
``python benchmarks/smoothing.py``; the table also goes to ``benchmarks/results/smoothing.txt``.
"""

from __future__ import annotations

import time
from pathlib import Path

import numba
import numpy as np

from frictionpinn.data.noise import GaussianNoise
from frictionpinn.data.recording import Recording, Trial
from frictionpinn.numerics.kalman import KalmanFilter, KalmanSmoother
from frictionpinn.numerics.smoothing import NoSmoothing, SavitzkyGolay, SmoothingSpline

RATE, DURATION, SEEDS = 400.0, 2.4175, range(5)
SMOOTHERS = {
    "none": NoSmoothing(),
    "Savitzky-Golay 0.05 s": SavitzkyGolay(0.05, 3),
    "Savitzky-Golay 0.2 s": SavitzkyGolay(0.2, 3),
    "smoothing spline": SmoothingSpline(),
    "Kalman smoother, 3 states": KalmanSmoother(3),
    "Kalman smoother, 4 states": KalmanSmoother(4),
    "Kalman smoother, 5 states": KalmanSmoother(5),
    "  4 states, no jumps sought": KalmanSmoother(4, jump_threshold=None),
    "Kalman filter, 3 states": KalmanFilter(3),
    "Kalman filter, 4 states": KalmanFilter(4),
    "Kalman filter, 5 states": KalmanFilter(5),
}


@numba.njit
def stick_slip(amplitude: float, frequency: float, n: int, every: int, step: float):
    """Box of 1.5 kg on a tilting plate with a spring (60 N/m) and Coulomb friction (0.3) under the plate's reaction."""
    mass, stiffness, friction, g = 1.5, 60.0, 0.3, 9.81
    states = np.zeros((3, n))
    x, v, a = 0.0, 0.0, 0.0
    w = 2 * np.pi * frequency
    for k in range(n * every):
        s, c = np.sin(w * k * step), np.cos(w * k * step)
        angle, rate, turn = amplitude * s, amplitude * w * c, -amplitude * w * w * s
        drive = mass * (x * rate**2 - g * np.sin(angle)) - stiffness * x
        limit = friction * mass * max(g * np.cos(angle) + x * turn + 2 * rate * v, 0.0)
        if v == 0.0 and abs(drive) <= limit:
            a = 0.0
        else:
            sense = np.sign(v) if v != 0.0 else np.sign(drive)
            a = (drive - sense * limit) / mass
        if k % every == 0:
            states[0, k // every], states[1, k // every], states[2, k // every] = x, v, a
        new = v + step * a
        v = 0.0 if new * v < 0.0 else new
        x += step * v
    return states


def simulated() -> Recording:
    """Return six trials of swing angle and sliding box, noise-free."""
    n, every = round(RATE * DURATION), 250
    t, trials = np.arange(n) / RATE, []
    for k in range(6):
        amplitude, frequency = np.radians(46 + 2 * k), 0.9 + 0.04 * k
        w = 2 * np.pi * frequency
        swing = {
            "theta": amplitude * np.sin(w * t),
            "omega": amplitude * w * np.cos(w * t),
            "alpha": -amplitude * w**2 * np.sin(w * t),
        }
        box = stick_slip(amplitude, frequency, n, every, 1 / RATE / every)
        trials.append(Trial(str(k), t, swing | dict(zip("xva", box, strict=True))))
    units = {"theta": "rad", "omega": "rad/s", "alpha": "rad/s^2", "x": "m", "v": "m/s", "a": "m/s^2"}
    return Recording(tuple(trials), units)


def measure(smoother, recording: Recording, noisy: Recording, names: tuple[str, ...]) -> tuple[list[float], float]:
    """Return the reduction factor of each signal and the seconds for fit and smoothing of all trials."""
    data = [(trial.t, *(trial.signals[name] for name in names)) for trial in noisy.trials]
    begin = time.perf_counter()
    fitted = smoother.fit(data)
    results = [fitted(*trial) for trial in data]
    seconds = time.perf_counter() - begin
    factors = []
    for k, name in enumerate(names):
        truth = np.concatenate([trial.signals[name] for trial in recording.trials])
        before = np.concatenate([trial[k + 1] for trial in data]) - truth
        after = np.concatenate([result[k] for result in results]) - truth
        factors.append(float(np.sqrt(np.mean(before**2) / np.mean(after**2))))
    return factors, seconds


def main() -> None:
    """Print the table and write it to the results folder."""
    recording = simulated()
    groups = (("theta", "omega", "alpha"), ("x", "v", "a"))
    head = f"{'noise reduction factor':28s}" + "".join(f"{name:>8s}" for names in groups for name in names)
    lines = [f"{len(recording)} samples, 6 trials, 5 % noise, mean of {len(SEEDS)} seeds", head + f"{'s/coord':>9s}"]
    for label, smoother in SMOOTHERS.items():
        rows, seconds = [], []
        for seed in SEEDS:
            noisy = GaussianNoise(0.05)(recording, seed)
            measured = [measure(smoother, recording, noisy, names) for names in groups]
            rows.append([factor for factors, _ in measured for factor in factors])
            seconds.append(np.mean([duration for _, duration in measured]))
        means = np.mean(rows, axis=0)
        lines.append(f"{label:28s}" + "".join(f"{m:8.2f}" for m in means) + f"{np.median(seconds):9.3f}")
    text = "\n".join(lines)
    print(text)
    target = Path(__file__).parent / "results" / "smoothing.txt"
    target.parent.mkdir(exist_ok=True)
    target.write_text(text + "\n")


if __name__ == "__main__":
    main()
