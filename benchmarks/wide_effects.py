"""Undeclared effects of benchmarks/wide.py: which, how large, and what sensors make of a recording."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from wide_simulate import Model

from frictionpinn.data.recording import Recording, Trial

SHARE = (0.03, 0.06)
CLEAN, SINGLE = 1 / 3, 0.9  # of the recordings: clean, and up to there with one effect, the others with a pair
NAMED = {  # effect -> parameter that carries its size, whether either sign occurs
    "constant_force": ("constant_force", True),
    "spring_force": ("spring_stiffness", True),
    "drag": ("drag", False),
    "asymmetry": ("asymmetry", True),
    "asymmetric_viscous": ("asymmetric_viscous", True),
    "position_friction": ("position_gradient", True),
    "drift": ("drift", True),
    "payload": ("payload_", False),
    "inertia": ("inertia", True),
    "sensor_bias": ("bias_", True),
    "sensor_scale": ("scale_", True),
    "sensor_delay": ("sensor_delay_", True),
    "load_exponent": ("load_exponent", True),
    "vibration": ("vibration_sin", True),
}
MASSES = {"pob": ("m_b", "m_L"), "sdob": ("m_1", "m_2"), "drive": ("M",), "pendulum": ("m",)}
SLIP = dict.fromkeys(("pendulum", "joint"), ("theta", "omega", "alpha"))  # of the others x, v, a
BIASED = {"pob": ("v", "a", "theta", "alpha"), "sdob": ("v", "a"), "drive": ("v", "a"),
          "pendulum": ("theta", "omega", "alpha")}  # fmt: skip
# One encoder's signals, as the package names them together (it has no use for a_y).
TOGETHER = {"x_v_a": ("x", "v", "a"), "theta_omega_alpha": ("theta", "omega", "alpha"), "y_v_y": ("y", "v_y", "a_y")}
ENCODERS = {"pob": ("x_v_a", "theta_omega_alpha"), "sdob": ("x_v_a", "y_v_y"), "drive": ("x_v_a",),
            "pendulum": ("theta_omega_alpha",)}  # fmt: skip


@dataclass(frozen=True)
class Undeclared:
    """Effects of one case.

    Attributes:
        names: of the effects, as the package calls them.
        values: their parameters, named as the package's.
    """

    names: tuple[str, ...]
    values: dict[str, float]

    def scaled(self, factor: float) -> Undeclared:
        """With all sizes times a number; shapes stay."""
        return replace(self, values={k: v if k in SHAPES else factor * v for k, v in self.values.items()})

    def acting(self, model: Model) -> Model:
        """The mechanism that is simulated: its true masses, and what acts on it."""
        masses = {k.removeprefix("payload_"): v for k, v in self.values.items() if k.startswith("payload_")}
        system = {k: v + masses.get(k, 0.0) for k, v in model.system.items()}
        return replace(model, system=system, effects={k: v for k, v in self.values.items() if k not in masses})

    def delays(self) -> dict[str, float]:
        """Signal -> s by which its sensor is late."""
        return dict(_per_signal(self.values, "sensor_delay_"))


SHAPES = ("spring_rest", "vibration_frequency", "load_reference", "position_middle")


def _per_signal(values: dict[str, float], prefix: str):
    """Signals that a sensor's parameter names, one or all of a coordinate."""
    for name, value in values.items():
        if name.startswith(prefix):
            key = name.removeprefix(prefix)
            for signal in TOGETHER.get(key, (key,)):
                yield signal, value


def effects_on(kind: str) -> tuple[str, ...]:
    """Effects that can act on a system: an exponent of the load only where that varies."""
    return tuple(name for name in NAMED if name != "load_exponent" or kind in ("pob", "sdob"))


def draw_effects(rng: np.random.Generator, kind: str, chosen: tuple[str, ...] | None = None) -> Undeclared:
    """Names (unless chosen), signs and shapes; each size is the share that :func:`sized` turns into a value."""
    chance = rng.random()
    count = 0 if chance < CLEAN else 1 if chance < SINGLE else 2
    drawn = tuple(str(n) for n in rng.choice(effects_on(kind), count, replace=False))
    chosen = drawn if chosen is None else chosen
    values: dict[str, float] = {}
    for name in chosen:
        parameter, signed = NAMED[name]
        slip = SLIP.get(kind, ("x", "v", "a"))
        parameter += {
            "payload": rng.choice(MASSES[kind]),
            "sensor_bias": rng.choice(BIASED[kind]),
            "sensor_scale": rng.choice([*slip[1:], *ENCODERS[kind]]),
            "sensor_delay": rng.choice(ENCODERS[kind]),
        }.get(name, "")  # fmt: skip
        values[parameter] = rng.uniform(*SHARE) * (rng.choice([-1, 1]) if signed else 1)
        if name == "vibration":
            values["vibration_frequency"] = float(rng.uniform(4.0, 20.0))
        if name == "spring_force":
            values["spring_rest"] = np.pi if kind == "pendulum" else 0.0
    return Undeclared(chosen, {k: float(v) for k, v in values.items()})


def sized(undeclared: Undeclared, model: Model, clean: Recording) -> Undeclared:
    """Turn shares into sizes, along the undisturbed motion.

    A share is that of the rms force that an effect makes in the rms friction force, less what is constant of a spring,
    a gradient or an exponent; for a sensor of what is predicted, that of the rms change in the spread of its signal.
    """
    values = dict(undeclared.values)
    if "load_exponent" in values:
        values["load_reference"] = reference(model)
    if "position_gradient" in values:
        values["position_middle"] = sum(ends(model.kind, clean)) / 2
    shapes = {k: v for k, v in values.items() if k in SHAPES}
    for name, share in undeclared.values.items():
        if name not in SHAPES:
            probe = 1e-3 if not name.startswith("sensor_delay_") else 1e-4
            values[name] = float(f"{share * probe / _share(name, probe, shapes, model, clean):.6g}")
    return replace(undeclared, values=values)


def ends(kind: str, clean: Recording) -> tuple[float, float]:
    """Lowest and highest slip position."""
    positions = np.concatenate([trial.signals[SLIP.get(kind, ("x",))[0]] for trial in clean.trials])
    return float(positions.min()), float(positions.max())


def reference(model: Model) -> float:
    """Load with every coordinate at zero: where a load exponent changes nothing."""
    p = model.system
    return (p["m_b"] + p["m_L"]) * p["g"] if model.kind == "pob" else p["m_1"] * p["g"] + p["k"] * p["rest"]


def _share(name: str, probe: float, shapes: dict[str, float], model: Model, clean: Recording) -> float:
    one = Undeclared((), {name: probe} | shapes)
    sensed = {y for y, _ in _sensed(one)}
    predicted = [y for y in SLIP.get(model.kind, ("x", "v", "a")) if y in sensed]
    if predicted:
        y = predicted[-1]
        change = [_shown(one, trial.t, trial.signals)[y] - trial.signals[y] for trial in clean.trials]
        return float(_rms(np.concatenate(change)) / np.std(np.concatenate([t.signals[y] for t in clean.trials])))
    made = np.concatenate([_force(one, name, model, trial, clean) for trial in clean.trials])
    return float(_rms(made) / _rms(np.concatenate([trial.truth["friction_force"] for trial in clean.trials])))


def _rms(x: np.ndarray) -> float:
    return np.sqrt(np.mean(x**2))


def _force(one: Undeclared, name: str, model: Model, trial: Trial, clean: Recording) -> np.ndarray:
    """Force that one effect makes along a motion."""
    y, F, N = trial.signals, trial.truth["friction_force"], trial.truth["normal_force"]
    slip = SLIP.get(model.kind, ("x", "v", "a"))
    v, a = y[slip[1]], y[slip[2]]
    away = y[slip[0]] - np.mean(np.concatenate([t.signals[slip[0]] for t in clean.trials]))
    simple = {
        "constant_force": 1.0, "drag": v * np.abs(v), "asymmetric_viscous": np.abs(v), "inertia": a,
        "spring_stiffness": away, "asymmetry": F * np.sign(v), "position_gradient": F * away,
        "drift": F * (trial.session.offset + trial.t),
        "vibration_sin": np.sin(2 * np.pi * one.values.get("vibration_frequency", 1.0) * trial.t),
        "load_exponent": F * np.log(N / np.mean(np.concatenate([t.truth["normal_force"] for t in clean.trials]))),
    }  # fmt: skip
    if name in simple:
        return one.values[name] * simple[name] * np.ones_like(v)
    before = _balance(model, y)
    after = _balance(one.acting(model), _shown(one, trial.t, y))
    return F * (after[1] / before[1] - 1) - (after[0] - before[0])


def _balance(model: Model, y: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    paths = {"pob": ("theta", "omega", "alpha"), "sdob": ("y", "v_y", "force")}.get(model.kind)
    inputs = (
        [y[n] for n in paths]
        if paths
        else [y["force" if model.kind == "drive" else "tau"]] + [0 * y[next(iter(y))]] * 2
    )
    s, _, a = (y[n] for n in SLIP.get(model.kind, ("x", "v", "a")))
    return model.balance(s, a, *inputs)


def _sensed(undeclared: Undeclared) -> list[tuple[str, float]]:
    return [pair for prefix in ("bias_", "scale_", "sensor_delay_") for pair in _per_signal(undeclared.values, prefix)]


def _shown(one: Undeclared, t: np.ndarray, y: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Signals as the sensors show them; a delay to first order."""
    y = dict(y)
    for signal, late in _per_signal(one.values, "sensor_delay_"):
        y[signal] = y[signal] - late * np.gradient(y[signal], t)
    for signal, scale in _per_signal(one.values, "scale_"):
        y[signal] = y[signal] * (1 + scale)
    for signal, bias in _per_signal(one.values, "bias_"):
        y[signal] = y[signal] + bias
    return y


def distort(recording: Recording, undeclared: Undeclared) -> Recording:
    """What biased and wrongly scaled sensors make of a recording; delays are simulated."""
    rest = Undeclared((), {k: v for k, v in undeclared.values.items() if not k.startswith("sensor_delay_")})
    trials = tuple(replace(trial, signals=_shown(rest, trial.t, trial.signals)) for trial in recording.trials)
    return replace(recording, trials=trials)
