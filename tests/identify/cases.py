"""Small recordings that the tests of identification share."""

from functools import lru_cache

import numpy as np
from omegaconf import OmegaConf

from frictionpinn.data.noise import GaussianNoise
from frictionpinn.data.simulated import simulate_recording
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.mechanism import Mechanism

NAMES = {
    "lugre": ("sigma_0", "sigma_1", "sigma_2", "mu_c", "mu_s", "v_s"),
    "dahl": ("sigma_0", "mu_c"),
    "stribeck": ("mu_c", "mu_s", "v_s", "sigma_2"),
    "coulomb_viscous": ("mu_c", "sigma_2"),
    "coulomb": ("mu_c",),
}


@lru_cache
def case(system: str, law: str, trials: tuple[int, ...] = (0, 3), rate_hz: float = 200.0, level: float = 0.05):
    """Mechanism, true parameters, clean and noisy recording, noise levels."""
    config = OmegaConf.to_container(OmegaConf.load(f"conf/system/{system}.yaml"), resolve=True)
    truth = {name: float(config["simulate"]["truth"][name]) for name in NAMES[law]}
    mechanism = Mechanism(SYSTEMS[system](**config["parameters"]), LAWS[law]())
    chosen = [config["simulate"]["trials"][k] | {"name": str(k)} for k in trials]
    clean = simulate_recording(mechanism.system, law, truth, chosen, rate_hz)
    noise = GaussianNoise(level)
    return mechanism, truth, clean, noise(clean, 0), noise.levels(clean)


def deviations(estimate, truth):
    """Error of each parameter in its own standard errors."""
    return {name: abs(estimate.values[name] - truth[name]) / estimate.std[name] for name in estimate.names}


def around(truth, factor=10.0):
    """Bounds a factor to either side, off centre."""
    shifts = np.random.default_rng(0).uniform(0.3, 3.0, len(truth))
    return {name: (v / factor * s, v * factor * s) for (name, v), s in zip(truth.items(), shifts, strict=True)}
