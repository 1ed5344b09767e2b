"""Recordings off the beaten path, drawn by seed: see benchmarks/wide.py.

``draw(seed)`` takes any seed from 0; seeds below 1000 are for development, those from 1000 on are the unseen ones:
nothing may ever be tuned on them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from omegaconf import OmegaConf
from wide_effects import Undeclared, distort, draw_effects, sized
from wide_simulate import KINDS, RADIUS, Excitation, Model, without_memory

from frictionpinn.data.noise import GaussianNoise, QuantisedNoise
from frictionpinn.data.recording import Recording, Trial

ROOT = Path(__file__).resolve().parents[1]
LENGTHS_AND_MASSES = {
    "pob": ("m_b", "m_L", "d", "J_L"), "sdob": ("m_1", "m_2", "k", "c"), "drive": ("M",), "pendulum": ("m", "l", "J"),
}  # fmt: skip
RATES_HZ = (100, 200, 400, 500, 1000, 2000)
MOST_SAMPLES, FEWEST_TRIALS = 20_000, 3
SLIDES, STOPS, REST_S = 0.2, 0.8, 0.015  # share of the time; share of trials that must rest, and for how long
CREEP = 2e-4  # slip per second below which a contact rests
FASTEST, FARTHEST = 1.5, 1.5  # m/s, m of slip; of a pendulum ten times as fast, and not over the top
SIGNALS = {
    "pob": {"x": "m", "v": "m/s", "a": "m/s^2", "theta": "rad", "omega": "rad/s", "alpha": "rad/s^2"},
    "sdob": {"x": "m", "v": "m/s", "a": "m/s^2", "y": "m", "v_y": "m/s", "a_y": "m/s^2", "force": "N"},
    "drive": {"x": "m", "v": "m/s", "a": "m/s^2", "force": "N"},
    "pendulum": {"theta": "rad", "omega": "rad/s", "alpha": "rad/s^2", "tau": "N*m"},
}
TRIES, CASES = 40, 20  # draws of a trial, and of a whole case


@dataclass(frozen=True)
class Case:
    """One drawn recording and all that is true of it.

    Attributes:
        seed: that drew it.
        system: name; ``parameters`` its declared values, SI units.
        law: declared friction law; ``truth`` its parameters.
        recording: with noise; ``clean`` without, friction force and load in its trials' ``truth``.
        sigmas: signal -> noise standard deviation, of the rounding too.
        level: noise over each signal's standard deviation.
        quantised: whether signals are rounded to steps of about the noise.
        rate_hz: samples per second.
        effects: names of undeclared effects; ``values`` their parameters, named as the package's.
        held_out: names of the trials at the end that a diagnosis keeps for proof.
        runs: how each trial was excited and begun.
        imposed: whether the motion is taken as measured, and the force predicted (wide_imposed.py).
    """

    seed: int
    system: str
    parameters: dict[str, float]
    law: str
    truth: dict[str, float]
    recording: Recording
    clean: Recording
    sigmas: dict[str, float]
    level: float
    quantised: bool
    rate_hz: float
    effects: tuple[str, ...]
    values: dict[str, float]
    held_out: tuple[str, ...]
    runs: tuple[Run, ...]
    imposed: bool = False


@dataclass(frozen=True)
class Run:
    """How a trial was excited: what is imposed or applied, samples, and the time before the first sample, s."""

    excitations: tuple[Excitation, ...]
    samples: int
    before: float
    offset: float

    def grid(self, rate_hz: float) -> np.ndarray:
        """Times of the samples, from 0, s."""
        return np.arange(self.samples) / rate_hz


def draw(seed: int, effects: bool | tuple[str, ...] = True) -> Case:
    """Draw a case.

    Args:
        seed: below 1000 for development; those from 1000 on are never to be tuned on.
        effects: False: the same mechanism, excitation and noise level without undeclared effects; names: with these.
    """
    for attempt in range(CASES):
        rng = np.random.default_rng([seed, attempt])
        drawn = _mechanism(rng)
        runs = _trials(rng, *drawn)
        if runs is not None:
            break
    else:
        raise RuntimeError(f"seed {seed}: no motion slides enough in {CASES} draws")
    kind, parameters, law, truth, rate_hz = drawn
    level = float(np.exp(rng.uniform(np.log(0.01), np.log(0.1))))
    quantised, last = bool(rng.random() < 0.2), int(rng.integers(1, 3))
    model = _model(kind, parameters, truth)
    clean = record(model, runs, rate_hz)
    undeclared = Undeclared((), {})
    if effects:
        chosen = None if effects is True else effects
        undeclared = draw_effects(np.random.default_rng([seed, CASES]), kind, chosen)
        undeclared = sized(undeclared, model, clean)
        clean, undeclared = _with(undeclared, model, runs, rate_hz)
    noise = GaussianNoise(level)
    if quantised:
        noise = QuantisedNoise(level, step={name: s for name, s in noise.levels(clean).items() if s > 0})
    names = clean.names
    held_out = tuple(names[-min(last, len(names) - 2) :])
    return Case(
        seed, kind, parameters, law, truth, noise(clean, seed), clean, noise.levels(clean), level, quantised, rate_hz,
        undeclared.names, undeclared.values, held_out, runs,
    )  # fmt: skip


def record(model: Model, runs: tuple[Run, ...], rate_hz: float, delays: dict[str, float] | None = None) -> Recording:
    """Simulate without noise; ``delays``: signal -> s by which it is shown late."""
    begun = np.cumsum([0.0, *((run.samples - 1) / rate_hz for run in runs)])
    models = [replace(model, effects=model.effects | {"begun": float(at)}) for at in begun]
    trials = [_trial(models[k], run, rate_hz, str(k + 1), delays or {}) for k, run in enumerate(runs)]
    return Recording(tuple(trials), SIGNALS[model.kind], f"wide {model.kind}")


def _trial(model: Model, run: Run, rate_hz: float, name: str, delays: dict[str, float]) -> Trial:
    t = run.grid(rate_hz)
    signals, motion = _signals(model, run, t)
    for late in set(delays.values()):
        shifted, _ = _signals(model, run, t - late)
        signals |= {key: shifted[key] for key, own in delays.items() if own == late}
    keys = ("friction_force", "normal_force", "z", "z_rate")
    return Trial(name, t, signals, {key: motion[key] for key in keys} | {"s": motion["s"], "v_slip": motion["v"]})


def _signals(model: Model, run: Run, t: np.ndarray) -> tuple[dict, dict]:
    """Measured signals at times t, and the motion."""
    rest = np.pi if model.kind == "pendulum" else 0.0
    start = np.array([rest + run.offset, 0.0, 0.0])
    motion = model.run(run.excitations, start, np.concatenate([[-run.before], t]))
    motion = {name: values[1:] for name, values in motion.items()}
    slip = (motion["s"], motion["v"], motion["a"])
    other = [values for excitation in run.excitations for values in excitation(t)]
    columns = {"pob": (*slip, *other), "sdob": (*slip, *other[:4]), "drive": (*slip, other[0]),
               "pendulum": (*slip, other[0])}  # fmt: skip
    return dict(zip(SIGNALS[model.kind], columns[model.kind], strict=True)), motion


def _with(undeclared: Undeclared, model: Model, runs: tuple[Run, ...], rate_hz: float) -> tuple[Recording, Undeclared]:
    """The recording with the effects; where the load would vanish, or the contact always rest, with half of them."""
    for _ in range(5):
        made = record(undeclared.acting(model), runs, rate_hz, undeclared.delays())
        moves = any(np.abs(trial.truth["v_slip"]).max() > _creep(model.kind) for trial in made.trials)
        if moves and all(trial.truth["normal_force"].min() > 0 for trial in made.trials):
            break
        undeclared = undeclared.scaled(0.5)
    return distort(made, undeclared), undeclared


def _mechanism(rng: np.random.Generator) -> tuple[str, dict, str, dict, float]:
    """System, its parameters, law, its parameters, sampling rate."""
    kind = str(rng.choice(KINDS))
    config = OmegaConf.to_container(OmegaConf.load(ROOT / "conf" / "system" / f"{kind}.yaml"), resolve=True)
    parameters = {k: float(v) for k, v in config["parameters"].items()}
    for name in LENGTHS_AND_MASSES[kind]:
        parameters[name] = float(f"{parameters[name] * 2 ** rng.uniform(-1, 1):.6g}")
    law = str(rng.choice(["lugre", "stribeck", "coulomb_viscous"], p=[0.6, 0.2, 0.2]))
    load = {  # of a typical load: where the preload is 1, a coefficient is a force or a torque
        "drive": 9.81 * parameters.get("M", 0), "pendulum": 9.81 * parameters.get("m", 0) * parameters.get("l", 0),
    }  # fmt: skip
    mu_c = rng.uniform(0.1, 0.4) * load.get(kind, 1.0)
    weight = {"pob": ("m_b", "m_L"), "sdob": ("m_1", "m_2")}.get(kind)
    normal = 9.81 * sum(parameters[m] for m in weight) if weight else 1.0
    slip = 1 / RADIUS if kind == "pendulum" else 1.0
    fast = 8.0 if kind == "pendulum" else 1.0  # slip speed that is typical at the top
    truth = {
        "sigma_0": np.exp(rng.uniform(np.log(1e4), np.log(2e5))) / slip**2,
        "sigma_1": rng.uniform(0.4, 1.2),
        "sigma_2": np.exp(rng.uniform(np.log(0.02), np.log(0.3))) * mu_c * normal / fast,
        "mu_c": mu_c,
        "mu_s": mu_c * rng.uniform(1.2, 2.0),
        "v_s": np.exp(rng.uniform(np.log(1e-3), np.log(1e-2))) * slip,
    }
    own = {"stribeck": ("sigma_2", "mu_c", "mu_s", "v_s"), "coulomb_viscous": ("sigma_2", "mu_c")}.get(law, truth)
    inertia = Model(kind, parameters, {}, {}).inertia
    truth["sigma_1"] *= 2 * (truth["sigma_0"] * inertia) ** 0.5
    truth = {name: float(truth[name]) for name in truth if name in own}
    return kind, parameters, law, truth, float(rng.choice(RATES_HZ))


def _model(kind: str, parameters: dict, truth: dict) -> Model:
    bare = Model(kind, parameters, truth, {})
    return bare if "sigma_0" in truth else replace(bare, law=without_memory(truth))


def _trials(rng: np.random.Generator, kind: str, parameters: dict, law: str, truth: dict, rate_hz: float):
    """Runs that slide, and mostly stop; None where none are found."""
    durations = rng.uniform(1.0, 4.0, rng.integers(FEWEST_TRIALS, 11))
    while durations.sum() * rate_hz > MOST_SAMPLES and len(durations) > FEWEST_TRIALS:
        durations = durations[:-1]
    durations *= min(1.0, MOST_SAMPLES / rate_hz / durations.sum())
    model, runs = _model(kind, parameters, truth), []
    for duration in durations:
        stops = rng.random() < STOPS
        for _ in range(TRIES):
            run = _run(rng, model, duration, rate_hz)
            if run is not None and _fits(model, run, rate_hz, stops):
                runs.append(run)
                break
        else:
            return None
    return tuple(runs)


def _run(rng: np.random.Generator, model: Model, duration: float, rate_hz: float) -> Run | None:
    """A run whose push reaches 1.05 to 3 times breakaway; None where no amplitude does."""
    p, before = model.system, rng.uniform(0.2, 0.8)
    reach = np.exp(rng.uniform(np.log(1.05), np.log(3.0))) * model.law["mu_s"]
    t = np.arange(-before, duration, 2e-3)
    shape = _shape(rng, duration, t)
    offset = float(rng.uniform(-0.02, 0.02))
    samples = round(duration * rate_hz)
    if model.kind == "pob":
        arm, weight = p["m_L"] * p["d"], (p["m_b"] + p["m_L"]) * p["g"]
        for amplitude in np.radians(np.arange(4.0, 81.0)):
            angle, omega, alpha = shape.scaled(amplitude)(t)
            N = weight - arm * (alpha * np.sin(angle) + omega**2 * np.cos(angle))
            if N.min() <= 0.02 * weight:
                return None
            if np.max(np.abs(arm * (alpha * np.cos(angle) - omega**2 * np.sin(angle))) / N) >= reach:
                return Run((shape.scaled(amplitude),), samples, before, offset)
        return None
    normal = 1.0
    paths: tuple[Excitation, ...] = ()
    if model.kind == "sdob":
        normal = (p["m_1"] + p["m_2"]) * p["g"]
        height = _decay(rng, p) if rng.random() < 0.3 else _shape(rng, duration, t)
        height = replace(height, offset=p["rest"] - p["m_2"] * p["g"] / p["k"])
        paths = (height.scaled(np.exp(rng.uniform(np.log(0.05), np.log(0.5))) * normal / p["k"]),)
    return Run((*paths, shape.scaled(reach * normal)), samples, before, offset)


def _shape(rng: np.random.Generator, duration: float, t: np.ndarray) -> Excitation:
    """Multisine, chirp or skewed sine between 0.3 and 3 Hz, its largest value 1."""
    what, row = rng.integers(3), np.zeros(6)
    low, high = 2 * np.pi * np.sort(np.exp(rng.uniform(np.log(0.3), np.log(3.0), 2)))
    row[:3] = 1.0, rng.uniform(0, 2 * np.pi), low
    if what == 0:
        n = rng.integers(3, 7)
        tones = np.tile(row, (n, 1))
        tones[:, 0] = rng.uniform(0.3, 1.0, n)
        tones[:, 1] = rng.uniform(0, 2 * np.pi, n)
        tones[:, 2] = 2 * np.pi * np.exp(rng.uniform(np.log(0.3), np.log(3.0), n))
    else:
        row[2] = rng.choice([low, high])
        if what == 1:
            row[3] = (low + high - 2 * row[2]) / 2 / duration
        else:
            row[4] = rng.uniform(0.2, 0.6)
        tones = row[None]
    shape = Excitation(tones)
    return shape.scaled(1 / np.abs(shape(t)[0]).max())


def _decay(rng: np.random.Generator, p: dict[str, float]) -> Excitation:
    """Height of the upper mass left to itself."""
    rate = p["c"] / p["m_2"] / 2
    return Excitation(np.array([[1.0, rng.uniform(0, 2 * np.pi), (p["k"] / p["m_2"] - rate**2) ** 0.5, 0, 0, rate]]))


def _creep(kind: str) -> float:
    """Slip velocity below which a contact rests, m/s or rad/s."""
    return CREEP / RADIUS if kind == "pendulum" else CREEP


def _fits(model: Model, run: Run, rate_hz: float, stops: bool) -> bool:
    """Whether it keeps contact, slides, stays within bounds and, where asked, rests."""
    try:
        _, motion = _signals(model, run, run.grid(rate_hz))
    except ArithmeticError:
        return False
    turns = model.kind == "pendulum"
    v = np.abs(motion["v"])
    fast, far = (10 * FASTEST, np.pi - 0.3) if turns else (FASTEST, FARTHEST)
    inside = v.max() < fast and np.abs(motion["s"] - np.pi * turns).max() < far and motion["normal_force"].min() > 0
    slides = v > max(
        model.law["v_s"] if "v_s" in model.law and model.law["mu_s"] > model.law["mu_c"] else 0, 0.02 * v.max()
    )
    if not inside or slides.mean() < SLIDES or v.max() < fast / 100:
        return False
    if not stops:
        return True
    rests = np.concatenate([[0], (v < _creep(model.kind)).astype(int), [0]])
    edges = np.flatnonzero(np.diff(rests))
    return bool(len(edges)) and (edges[1::2] - edges[::2]).max() >= max(REST_S * rate_hz, 3)
