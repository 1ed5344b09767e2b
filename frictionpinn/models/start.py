"""Start values and bounds of a friction law from the scale of the training data, where the configuration gives none."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..data.contact import ContactTrial
from ..errors import UserError
from ..physics import FrictionLaw
from ..physics.scan import DECADES

# Of what the scale of the data suggests: an identified parameter that is smaller is none, up to where a search stops.
NEXT_TO_NONE = 1e-3


def data_scales(trials: Sequence[ContactTrial]) -> dict[str, float]:
    """Robust scales of the training data: force, normal force, slip velocity, slip acceleration, friction ratio.

    ``ratio`` and ``viscous`` are mu_c and sigma_2 of F = mu_c F_N sign(v) + sigma_2 v, by least squares over the
    sliding samples: those faster than ten times the velocity's noise and a fifth of its root mean square.
    ``breakaway`` is the share |F| / F_N that one sample in a hundred exceeds.
    """
    stack = {
        name: np.concatenate([trial.offline[name] for trial in trials])
        for name in ("friction_force", "normal_force", "v_slip", "a_slip")
    }

    def rms(values: np.ndarray) -> float:
        return float(np.sqrt(np.mean(values**2))) or 1.0

    noise = np.concatenate([trial.online["v_slip"] - trial.offline["v_slip"] for trial in trials])
    scales = {
        "force": rms(stack["friction_force"]),
        "velocity": rms(stack["v_slip"]),
        "acceleration": rms(stack["a_slip"]),
        "velocity_noise": max(float(np.sqrt(np.mean(noise**2))), 1e-3 * rms(stack["v_slip"])),
    }
    scales["ratio"], scales["viscous"] = _sliding(stack, scales)
    share = np.abs(stack["friction_force"]) / np.maximum(np.abs(stack["normal_force"]), 1e-12)
    scales["breakaway"] = max(float(np.quantile(share, 0.99)), 1.1 * scales["ratio"])
    return scales


def _sliding(stack: Mapping[str, np.ndarray], scales: Mapping[str, float]) -> tuple[float, float]:
    v, force, normal = stack["v_slip"], stack["friction_force"], np.abs(stack["normal_force"])
    slides = np.abs(v) > max(10 * scales["velocity_noise"], 0.2 * scales["velocity"])
    if slides.sum() < 10:
        return float(np.median(np.abs(force) / np.maximum(normal, 1e-12))) or 1.0, 0.1 * scales["force"] / scales[
            "velocity"
        ]
    design = np.stack([normal * np.sign(v), v], axis=1)[slides]
    (ratio, viscous), *_ = np.linalg.lstsq(design, force[slides], rcond=None)
    typical = float(np.median(np.abs(force[slides]) / np.maximum(normal[slides], 1e-12))) or 1.0
    # A falling branch (Stribeck) can make the viscous share negative: it must start positive all the same.
    least = 1e-2 * scales["force"] / scales["velocity"]
    return max(float(ratio), 0.1 * typical), max(float(viscous), least)


def default_start(law: FrictionLaw, scales: Mapping[str, float]) -> dict[str, float]:
    """Start values, SI units, of the parameters that have no default: orders of magnitude, not estimates.

    The bristle stiffness takes the whole force over a hundredth of the distance slid in a characteristic time
    (velocity over acceleration); its damping is critical for the mass that force over acceleration suggests.
    """
    force, velocity, acceleration = scales["force"], scales["velocity"], scales["acceleration"]
    stiffness = force / (1e-2 * velocity**2 / acceleration)
    table = {
        "mu_c": scales["ratio"],
        "mu_s": scales["breakaway"],
        "v_s": 0.05 * velocity,
        "sigma_0": stiffness,
        "sigma_1": 2 * np.sqrt(stiffness * force / acceleration),
        "sigma_2": scales["viscous"],
    }
    return {par.name: float(table[par.name]) for par in law.parameters if par.value is None}


def known_start(law: FrictionLaw, known: Mapping[str, float], scales: Mapping[str, float]) -> dict[str, float]:
    """Of an identified model's values, SI units, those to start from: one that is next to none has no logarithm to tell
    from where, nor bounds around it that hold anything else."""
    usual = default_start(law, scales)
    return {name: value for name, value in known.items() if value > NEXT_TO_NONE * usual.get(name, 0.0)}


def _number(value: object, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise UserError("not a number", where=where, received=repr(value), allowed="a number in SI units, or null")
    return float(value)


def _pair(value: object, where: str) -> tuple[float, float] | None:
    if value is None:
        return None
    if not isinstance(value, Sequence) or isinstance(value, str) or len(value) != 2:
        raise UserError("impossible bounds", where=where, received=repr(value), allowed="[low, high], or null")
    return _number(value[0], where), _number(value[1], where)


def complete(
    law: FrictionLaw, given: Mapping[str, float | None], bounds: Mapping[str, Sequence[float] | None], scales: Mapping
) -> tuple[dict[str, float], dict[str, tuple[float, float]]]:
    """Merge configured start values and bounds (None: from the data) with the defaults."""
    start = default_start(law, scales)
    unknown = {name: value for name, value in given.items() if name not in start}
    start |= {name: _number(value, f"friction.start.{name}") for name, value in given.items() if value is not None}
    limits: dict[str, tuple[float, float]] = {}
    for par in law.parameters:
        if par.name not in start:
            continue
        chosen = _pair(bounds.get(par.name), f"friction.bounds.{par.name}")
        around = (start[par.name] / 10**DECADES, start[par.name] * 10**DECADES)
        if par.name in ("mu_c", "mu_s"):  # friction coefficients are known within a decade
            around = (start[par.name] / 10, start[par.name] * 10)
        limits[par.name] = chosen or around
    limits |= {name: (float(pair[0]), float(pair[1])) for name, pair in bounds.items() if pair and name not in limits}
    return {**start, **{name: value for name, value in unknown.items() if value is not None}}, limits
