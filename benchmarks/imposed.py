"""Maximum likelihood where the motion is imposed and the force measured: does it end where a fit from the truth does?

    python benchmarks/imposed.py [--seeds 0 60] [--label now]

Joints, drives, dampers and pendulums with a measured force, 3 to 6 trials of random multisines at 100 to 500 Hz, 0.5 to
6 % noise on every signal; friction laws and their parameters drawn at random. The data come from equations of the
benchmark's own. Where a law has no memory its force jumps as the motion turns round, by up to a hundred standard
deviations, and the velocity's noise hides on which side of that a sample is.

Writes benchmarks/results/imposed_<label>.txt.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from wide import cost_from_truth

from frictionpinn.data.recording import Recording, Trial
from frictionpinn.identify import Problem, maximum_likelihood
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.mechanism import Mechanism
from frictionpinn.workflow.provenance import commit

RESULTS = Path(__file__).resolve().parent / "results"
KINDS, LAW_NAMES = ("joint", "drive", "damper", "pendulum"), ("coulomb_viscous", "stribeck", "stribeck", "lugre")
BEHIND = 2.0  # log-likelihood
FINE = 40  # steps of a bristle to a sample


@dataclass(frozen=True)
class Case:
    """A recording with noise and without, and all that is true of it."""

    mechanism: Mechanism
    truth: dict[str, float]
    noisy: Recording
    clean: Recording
    about: str


def draw(seed: int) -> Case:
    """The case of a seed."""
    rng, kind, name = np.random.default_rng([20, seed]), KINDS[seed % 4], LAW_NAMES[seed // 4 % 4]
    size = 1.0 if kind in ("joint", "pendulum") else 0.05  # of the stroke, rad or m
    given = {
        "joint": {"J": rng.uniform(0.05, 0.5), "W_cos": rng.uniform(1, 10), "W_sin": rng.uniform(-3, 3)},
        "drive": {"M": rng.uniform(1, 20)},
        "damper": {},
        "pendulum": {"m": rng.uniform(0.2, 2), "l": rng.uniform(0.1, 0.5), "J": rng.uniform(1e-3, 0.1)},
    }[kind]
    dry = rng.uniform(1, 5)
    truth = {"mu_c": dry, "sigma_2": dry * rng.uniform(0.02, 0.2) / size / 3}
    if name != "coulomb_viscous":
        truth |= {"mu_s": dry * rng.uniform(1.2, 1.8), "v_s": size * 10 ** rng.uniform(-2, -0.7)}
    if name == "lugre":
        truth["sigma_0"] = dry / (size * 10 ** rng.uniform(-4, -2))
        truth["sigma_1"] = truth["sigma_0"] * 10 ** rng.uniform(-4, -2.5)
    system = SYSTEMS[kind](**given) if kind == "damper" else SYSTEMS[kind](imposed=True, **given)
    mechanism = Mechanism(system, LAWS[name]())
    (moving,), (force,) = system.moving, system.inputs
    rate, level = float(rng.choice([100, 200, 500])), rng.uniform(0.005, 0.06)
    clean = []
    for number in range(1, int(rng.integers(4, 8))):
        t = np.arange(int(rng.uniform(2, 6) * rate)) / rate
        w, c = rng.uniform(1, 8, 3), size * rng.uniform(0.1, 0.7, 3) * np.exp(2j * np.pi * rng.uniform(size=3))

        def motion(order: int, t: np.ndarray, w: np.ndarray = w, c: np.ndarray = c) -> np.ndarray:
            return np.real(((1j * w) ** order * c) @ np.exp(1j * np.outer(w, t)))

        q, v, a = (motion(k, t) for k in range(3))
        rubbing, z = friction(name, truth, t, partial(motion, 1))
        signals = (q, v, a, load(kind, given, q, a) + rubbing)
        named = dict(zip((*moving.signals, force.name), signals, strict=True))
        clean.append(Trial(str(number), t, named, {"z": z}))
    sigmas = {n: level * np.concatenate([trial.signals[n] for trial in clean]).std() for n in clean[0].signals}
    noisy = [
        replace(own, signals={n: y + sigmas[n] * rng.standard_normal(len(y)) for n, y in own.signals.items()})
        for own in clean
    ]
    units = dict.fromkeys(clean[0].signals, "1")
    about = f"{kind:9s} {name:16s} {rate:4.0f} Hz {len(clean)} trials {100 * level:4.1f} %"
    return Case(mechanism, truth, Recording(tuple(noisy), units), Recording(tuple(clean), units), about)


def load(kind: str, p: dict[str, float], q: np.ndarray, a: np.ndarray) -> np.ndarray:
    """Force of inertia and gravity."""
    match kind:
        case "joint":
            return p["J"] * a + p["W_cos"] * np.cos(q) + p["W_sin"] * np.sin(q)
        case "drive":
            return p["M"] * a
        case "pendulum":
            return (p["J"] + p["m"] * p["l"] ** 2) * a - p["m"] * 9.81 * p["l"] * np.sin(q)  # from upright
    return np.zeros_like(q)


def friction(name: str, p: dict[str, float], t: np.ndarray, velocity: Callable) -> tuple[np.ndarray, np.ndarray]:
    """Friction force and the bristle's state along a velocity, a function of time, at the times t, shape (n,) each."""
    v = velocity(t)
    dry = np.full_like(v, p["mu_c"])
    if name != "coulomb_viscous":
        dry = p["mu_c"] + (p["mu_s"] - p["mu_c"]) * np.exp(-((v / p["v_s"]) ** 2))
    if name != "lugre":
        return dry * np.sign(v) + p["sigma_2"] * v, np.zeros_like(v)

    z = np.full_like(v, dry[0] / p["sigma_0"] * np.sign(v[0]))  # exact at a velocity that is held for a fine step
    h = (t[1] - t[0]) / FINE
    for k in range(1, len(t)):
        here = z[k - 1]
        for u in velocity(t[k - 1] + h * (np.arange(FINE) + 0.5)):
            level = p["mu_c"] + (p["mu_s"] - p["mu_c"]) * np.exp(-((u / p["v_s"]) ** 2))
            end = np.sign(u) * level / p["sigma_0"]
            here = end + (here - end) * np.exp(-p["sigma_0"] * abs(u) / level * h)
        z[k] = here
    return p["sigma_0"] * z + p["sigma_1"] * (v - p["sigma_0"] * np.abs(v) / dry * z) + p["sigma_2"] * v, z


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, nargs=2, default=(0, 60), help="first, and one beyond the last")
    parser.add_argument("--label", default="now")
    args = parser.parse_args()
    lines, behind, inside, seconds = [], [], {}, []
    for seed in range(*args.seeds):
        case, began = draw(seed), time.process_time()
        problem = Problem(case.mechanism, case.noisy)
        found = maximum_likelihood(problem)
        seconds.append(time.process_time() - began)
        behind.append(found.cost - cost_from_truth(problem, case, found.sigmas)[1])
        ends = {n: found.ci95[n] for n in case.truth}
        missed = [n for n, (low, high) in ends.items() if not low <= case.truth[n] <= high]
        for name in case.truth:
            inside.setdefault(name, []).append(name not in missed)
        told = "; ".join(f"{n} {case.truth[n]:.4g} not in [{ends[n][0]:.4g}, {ends[n][1]:.4g}]" for n in missed)
        lines.append(f"{seed:4d} {case.about} behind {behind[-1]:7.2f} {seconds[-1]:5.1f} s  {told}")
        print(lines[-1], flush=True)
    every = [x for own in inside.values() for x in own]
    head = [
        f"python benchmarks/imposed.py --seeds {args.seeds[0]} {args.seeds[1]} --label {args.label}; commit {commit()}",
        f"behind a fit from the truth by more than {BEHIND:g} in log-likelihood: "
        f"{sum(x > BEHIND for x in behind)} of {len(behind)}",
        f"truth inside 95 % intervals: {sum(every)} of {len(every)} ({100 * np.mean(every):.0f} %): "
        + ", ".join(f"{n} {sum(own)} of {len(own)}" for n, own in inside.items()),
        f"processor s: median {np.median(seconds):.1f}, longest {max(seconds):.1f}",
        "",
    ]  # fmt: skip
    (RESULTS / f"imposed_{args.label}.txt").write_text("\n".join(head + lines) + "\n")
    print("\n".join(head))


if __name__ == "__main__":
    main()
