"""Start values and bounds of a friction law from the scale of the training data, where the configuration gives none."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..data.contact import ContactTrial
from ..physics import FrictionLaw

DECADES = 2.0  # half-width of a default search range: two decades to either side of the start


def data_scales(trials: Sequence[ContactTrial]) -> dict[str, float]:
    """Robust scales of the training data: force, normal force, slip velocity, slip acceleration, friction ratio.

    The ratio |F| / F_N is the median over the fastest third of the samples, where the contact slides if it ever does.
    """
    stack = {
        name: np.concatenate([trial.offline[name] for trial in trials])
        for name in ("friction_force", "normal_force", "v_slip", "a_slip")
    }
    speed = np.abs(stack["v_slip"])
    fast = speed >= np.quantile(speed, 0.67)
    normal = np.maximum(np.abs(stack["normal_force"]), 1e-12)

    def rms(values: np.ndarray) -> float:
        return float(np.sqrt(np.mean(values**2))) or 1.0

    noise = np.concatenate([trial.online["v_slip"] - trial.offline["v_slip"] for trial in trials])
    return {
        "force": rms(stack["friction_force"]),
        "velocity": rms(stack["v_slip"]),
        "acceleration": rms(stack["a_slip"]),
        "ratio": float(np.median(np.abs(stack["friction_force"])[fast] / normal[fast])) or 1.0,
        "velocity_noise": max(float(np.sqrt(np.mean(noise**2))), 1e-3 * rms(stack["v_slip"])),
    }


def default_start(law: FrictionLaw, scales: Mapping[str, float]) -> dict[str, float]:
    """Start values, SI units, of the parameters that have no default: orders of magnitude, not estimates.

    The bristle stiffness takes the whole force over a hundredth of the distance slid in a characteristic time
    (velocity over acceleration); its damping is critical for the mass that force over acceleration suggests.
    """
    force, velocity, acceleration = scales["force"], scales["velocity"], scales["acceleration"]
    stiffness = force / (1e-2 * velocity**2 / acceleration)
    table = {
        "mu_c": scales["ratio"],
        "mu_s": 1.5 * scales["ratio"],
        "v_s": 0.05 * velocity,
        "sigma_0": stiffness,
        "sigma_1": 2 * np.sqrt(stiffness * force / acceleration),
        "sigma_2": 0.1 * force / velocity,
    }
    return {par.name: float(table[par.name]) for par in law.parameters if par.value is None}


def complete(
    law: FrictionLaw, given: Mapping[str, float | None], bounds: Mapping[str, Sequence[float] | None], scales: Mapping
) -> tuple[dict[str, float], dict[str, tuple[float, float]]]:
    """Merge configured start values and bounds (None: from the data) with the defaults."""
    start = default_start(law, scales)
    unknown = {name: value for name, value in given.items() if name not in start}
    start |= {name: float(value) for name, value in given.items() if value is not None}
    limits: dict[str, tuple[float, float]] = {}
    for par in law.parameters:
        if par.name not in start:
            continue
        chosen = bounds.get(par.name)
        around = (start[par.name] / 10**DECADES, start[par.name] * 10**DECADES)
        if par.name in ("mu_c", "mu_s"):  # friction coefficients are known within a decade
            around = (start[par.name] / 10, start[par.name] * 10)
        limits[par.name] = (float(chosen[0]), float(chosen[1])) if chosen is not None else around
    limits |= {name: (float(pair[0]), float(pair[1])) for name, pair in bounds.items() if pair and name not in limits}
    return {**start, **{name: value for name, value in unknown.items() if value is not None}}, limits
