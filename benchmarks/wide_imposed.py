"""Imposed motions of benchmarks/wide.py (--imposed): motion and force both measured, as in the log of a servo.

Joints, drives, dampers and pendulums, 3 to 6 trials of random multisines at 100 to 500 Hz, 0.5 to 6 % noise on every
signal; friction laws and their parameters drawn at random, two thirds with an effect that nobody declared, 3 to 6 % of
the friction force. The data come from equations of the benchmark's own. Where a law has no memory its force jumps as
the motion turns round, by up to a hundred standard deviations, and the velocity's noise hides on which side of that a
sample is.

Seeds below 1000 are for development; nothing may ever be tuned on those from 1000 on.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from wide_draw import Case
from wide_effects import CLEAN, MASSES, NAMED, SHARE, SLIP, Undeclared

from frictionpinn.data.recording import Recording, Trial

KINDS, LAW_NAMES = ("joint", "drive", "damper", "pendulum"), ("coulomb_viscous", "stribeck", "stribeck", "lugre")
FINE = 40  # steps of a bristle to a sample
EFFECTS = (
    "constant_force", "spring_force", "drag", "asymmetry", "asymmetric_viscous", "position_friction", "drift",
    "payload", "inertia", "vibration", "delay", "sensor_scale",
)  # fmt: skip


def effects_on(kind: str) -> list[str]:
    """Effects that can act: without inertia a factor of the force is one of the friction."""
    without = {"payload"} if kind == "joint" else {"payload", "sensor_scale"} if kind == "damper" else set()
    return [name for name in EFFECTS if name not in without]


def force_of(kind: str) -> str:
    """The measured force's signal."""
    return "tau" if kind in SLIP else "force"


@dataclass(frozen=True)
class Path:
    """A multisine q(t) = sum Re c exp(i w t) of a trial, which begins at ``begun`` s of the session."""

    w: np.ndarray
    c: np.ndarray
    t: np.ndarray
    begun: float

    def __call__(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """q, v and a at times t."""
        return tuple(np.real(((1j * self.w) ** k * self.c) @ np.exp(1j * np.outer(self.w, t))) for k in range(3))  # type: ignore[return-value]


@dataclass(frozen=True)
class Mover:
    """A mechanism whose motion is imposed: its kind, parameters and law by its own parameters."""

    kind: str
    parameters: dict[str, float]
    law: dict[str, float]

    def required(self, path: Path, acting: dict[str, float]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Force that the motion requires, the part that friction and what acts beside have in it, and the bristle's
        state, at the samples, shape (n,) each."""
        late = sum(value for name, value in acting.items() if name.startswith("delay_"))
        t = path.t + late  # the recorded input acts as much later
        q, v, a = path(t)
        rubbing, z = self._friction(path, t, acting)
        rubbing = rubbing + acting.get("constant_force", 0.0) + acting.get("spring_stiffness", 0.0) * q
        rubbing += acting.get("drag", 0.0) * v * np.abs(v) + acting.get("asymmetric_viscous", 0.0) * np.abs(v)
        rubbing += acting.get("inertia", 0.0) * a
        rubbing += acting.get("vibration_sin", 0.0) * np.sin(2 * np.pi * acting.get("vibration_frequency", 0.0) * t)
        return self._load(q, a, acting) + rubbing, rubbing, z

    def _load(self, q: np.ndarray, a: np.ndarray, acting: dict[str, float]) -> np.ndarray:
        """Force of inertia and gravity."""
        p = {name: value + acting.get(f"payload_{name}", 0.0) for name, value in self.parameters.items()}
        match self.kind:
            case "joint":
                return p["J"] * a + p["W_cos"] * np.cos(q) + p["W_sin"] * np.sin(q)
            case "drive":
                return p["M"] * a
            case "pendulum":
                return (p["J"] + p["m"] * p["l"] ** 2) * a - p["m"] * 9.81 * p["l"] * np.sin(q)  # from upright
        return np.zeros_like(q)

    def _friction(self, path: Path, t: np.ndarray, acting: dict[str, float]) -> tuple[np.ndarray, np.ndarray]:
        """Friction force, the effects of dry friction in it, and the bristle's state."""
        p = self.law

        def dry(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            q, v, _ = path(t)
            load = 1 + acting.get("asymmetry", 0.0) * np.sign(v) + acting.get("drift", 0.0) * (path.begun + t)
            load += acting.get("position_gradient", 0.0) * (q - acting.get("position_middle", 0.0))
            rise = (p["mu_s"] - p["mu_c"]) * np.exp(-((v / p["v_s"]) ** 2)) if "mu_s" in p else 0.0
            return v, (p["mu_c"] + rise) * load

        v, level = dry(t)
        if "sigma_0" not in p:
            return level * np.sign(v) + p["sigma_2"] * v, np.zeros_like(v)
        z = np.full_like(v, level[0] / p["sigma_0"] * np.sign(v[0]))  # exact at what is held for a fine step
        h = (t[1] - t[0]) / FINE
        for k in range(1, len(t)):
            here = z[k - 1]
            for u, g in zip(*dry(t[k - 1] + h * (np.arange(FINE) + 0.5)), strict=True):
                end = np.sign(u) * g / p["sigma_0"]
                here = end + (here - end) * np.exp(-p["sigma_0"] * abs(u) / g * h)
            z[k] = here
        return p["sigma_0"] * z + p["sigma_1"] * (v - p["sigma_0"] * np.abs(v) / level * z) + p["sigma_2"] * v, z


def draw(seed: int, effects: bool = True) -> Case:
    """The case of a seed; without effects the same mechanism, motion and noise level."""
    rng, kind, name = np.random.default_rng([20, seed]), KINDS[seed % 4], LAW_NAMES[seed // 4 % 4]
    size = 1.0 if kind in SLIP else 0.05  # of the stroke, rad or m
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
    rate, level, paths = float(rng.choice([100, 200, 500])), rng.uniform(0.005, 0.06), list[Path]()
    for _ in range(int(rng.integers(3, 7))):
        t = np.arange(int(rng.uniform(2, 6) * rate)) / rate
        w, c = rng.uniform(1, 8, 3), size * rng.uniform(0.1, 0.7, 3) * np.exp(2j * np.pi * rng.uniform(size=3))
        paths.append(Path(w, c, t, paths[-1].begun + paths[-1].t[-1] if paths else 0.0))
    mover, chance = Mover(kind, given, truth), np.random.default_rng([21, seed])
    acting, last = Undeclared((), {}), int(chance.integers(1, 3))
    if effects and chance.random() > CLEAN:
        acting = _drawn(chance, mover, paths)
    clean = _recorded(mover, paths, acting.values)
    sigmas = {n: level * np.concatenate([trial.signals[n] for trial in clean.trials]).std() for n in clean.units}
    noisy = [
        replace(own, signals={n: y + sigmas[n] * rng.standard_normal(len(y)) for n, y in own.signals.items()})
        for own in clean.trials
    ]
    held_out = clean.names[-min(last, len(clean.names) - 2) :]
    return Case(
        seed, kind, given, name, truth, replace(clean, trials=tuple(noisy)), clean, sigmas, level, False, rate,
        acting.names, acting.values, tuple(held_out), (), imposed=True,
    )  # fmt: skip


def _recorded(mover: Mover, paths: list[Path], acting: dict[str, float]) -> Recording:
    """What sensors without noise show."""
    names = (*SLIP.get(mover.kind, ("x", "v", "a")), force_of(mover.kind))
    trials = []
    for number, path in enumerate(paths, 1):
        force, _, z = mover.required(path, acting)
        force = force * (1 + acting.get(f"scale_{names[3]}", 0.0))
        trials.append(Trial(str(number), path.t, dict(zip(names, (*path(path.t), force), strict=True)), {"z": z}))
    return Recording(tuple(trials), dict.fromkeys(names, "1"))


def _drawn(rng: np.random.Generator, mover: Mover, paths: list[Path]) -> Undeclared:
    """An effect: the rms change of the force that it makes is a share of the rms friction force."""
    name = str(rng.choice(effects_on(mover.kind)))
    parameter, signed = NAMED.get(name, ("delay_", True))
    force = force_of(mover.kind)
    parameter += {"payload": MASSES.get(mover.kind, ("",))[0], "delay": force, "sensor_scale": force}.get(name, "")
    share, values = rng.uniform(*SHARE), dict[str, float]()
    if name == "vibration":
        values["vibration_frequency"] = float(rng.uniform(4.0, 20.0))
    if name == "spring_force":
        values["spring_rest"] = 0.0
    if name == "position_friction":
        positions = np.concatenate([path(path.t)[0] for path in paths])
        values["position_middle"] = float(positions.min() + positions.max()) / 2
    probe = 1e-4 if name == "delay" else 1e-3

    def every(get: Callable[[Path], np.ndarray]) -> np.ndarray:
        return np.concatenate([get(path) for path in paths])

    before, friction = (every(lambda path: mover.required(path, {})[k]) for k in (0, 1))  # noqa: B023
    after = every(lambda path: mover.required(path, values | {parameter: probe})[0])
    change = after - before if name != "sensor_scale" else probe * before
    if name == "spring_force":
        change = change - change.mean()
    made = np.sqrt(np.mean(change**2) / np.mean(friction**2))
    strength = share * probe / made * (rng.choice([-1, 1]) if signed else 1)
    return Undeclared((name,), values | {parameter: float(f"{strength:.6g}")})
