"""Recordings that the tests of online estimation share."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from omegaconf import OmegaConf

from frictionpinn.data.excitation import parse_expression
from frictionpinn.data.noise import GaussianNoise
from frictionpinn.data.recording import Recording, Trial
from frictionpinn.data.simulated import simulate_recording
from frictionpinn.numerics.paths import InputPath
from frictionpinn.numerics.simulate import Simulator
from frictionpinn.online import OnlineEstimator
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.mechanism import Mechanism

LUGRE = ("sigma_0", "sigma_1", "sigma_2", "mu_c", "mu_s", "v_s")
NAMES = {"lugre": LUGRE, "dahl": ("sigma_0", "mu_c"), "stribeck": ("mu_c", "mu_s", "v_s", "sigma_2")}


@lru_cache
def case(system: str, law: str = "lugre", trials: tuple[int, ...] = (0, 3), level: float = 0.05):
    """Mechanism, true parameters, clean and noisy recording at 400 Hz."""
    config = OmegaConf.to_container(OmegaConf.load(f"conf/system/{system}.yaml"), resolve=True)
    truth = {name: float(config["simulate"]["truth"][name]) for name in NAMES[law]}
    mechanism = Mechanism(SYSTEMS[system](**config["parameters"]), LAWS[law]())
    chosen = [config["simulate"]["trials"][k] | {"name": str(k)} for k in trials]
    clean = simulate_recording(mechanism.system, law, truth, chosen, 400.0)
    return mechanism, truth, clean, GaussianNoise(level)(clean, 0)


@lru_cache
def fitted(system: str, law: str = "lugre") -> OnlineEstimator:
    """Estimator with the true parameters, tuned on both trials of the case."""
    mechanism, truth, _, noisy = case(system, law)
    return OnlineEstimator.fit(mechanism, truth, noisy)


def changing_surface(factor: float, seconds: float = 3.0, seed: int = 0) -> tuple[Trial, int]:
    """A swing of the pendulum on a box whose mu_c is multiplied by ``factor`` midway; the sample of the change."""
    mechanism, truth, _, noisy = case("pob")
    count = int(400 * seconds)
    t, half = np.arange(count) / 400, count // 2
    path = InputPath.from_expressions(mechanism, t, {"theta": parse_expression("57.5*deg*sin(2*pi*t)", "theta", {})})
    simulator = Simulator(mechanism)
    driven = {name: path.signals[name] for name in ("theta", "omega", "alpha")}
    before = {name: values[: half + 1] for name, values in driven.items()}
    first = simulator.simulate(t[: half + 1], before, truth, z0="steady")
    y0 = {"x": first.q[-1, 0], "v": first.v[-1, 0], "z": first.z[-1]}
    after = {name: values[half:] for name, values in driven.items()}
    second = simulator.simulate(t[half:], after, truth | {"mu_c": factor * truth["mu_c"]}, y0)
    signals = {name: np.append(first.signals[name][:-1], second.signals[name]) for name in first.signals}
    signals.pop("tau", None)
    told = {
        "friction_force": np.append(first.F[:-1], second.F),
        "v_slip": np.append(first.v_slip[:-1], second.v_slip),
    }
    clean = Recording((Trial("changing", t, signals, told),), dict(noisy.units))
    return GaussianNoise(0.05)(clean, seed).trials[0], half
