"""Made-up histories of the contact's signals, to compare an export with the model that it came from."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence

import numpy as np
import torch

from ..models import FrictionModel
from .portable import PortableModel

Signals = dict[str, np.ndarray]


def made_up_signals(
    names: Sequence[str], interval: float, scales: Mapping[str, float], count: int, seed: int
) -> Signals:
    """Smooth signals over time, each of shape (count,), as large as in training, with their rates ``<name>_rate``.

    Each is a sum of sines from 0.3 to 30 Hz around a mean (of the normal force; the others swing about 0).
    """
    random = np.random.default_rng(seed)
    t = np.arange(count) * interval
    load = scales["force"] / max(scales["ratio"], 1e-12)
    typical = {"v_slip": scales["velocity"], "normal_force": load, "a_frictionless": scales["acceleration"]}
    signals: Signals = {}
    for name in names:
        frequency, phase = 2 * np.pi * 0.3 * 100 ** random.random(8), 2 * np.pi * random.random(8)
        share = random.random(8) / frequency
        share *= typical[name] / share.sum()
        angle = np.outer(t, frequency) + phase
        mean = 1.5 * load if name == "normal_force" else 0.0
        signals[name] = mean + np.sin(angle) @ share
        signals[f"{name}_rate"] = np.cos(angle) @ (share * frequency)
    return signals


def windows(values: np.ndarray, length: int) -> np.ndarray:
    """The last ``length`` samples at every instant, shape (n, length), oldest first; before the first its value."""
    index = np.arange(len(values))[:, None] - np.arange(length)[::-1]
    return values[np.maximum(index, 0)]


def reference(model: FrictionModel, portable: PortableModel, signals: Signals) -> Signals:
    """``force``, and for a parameter estimator ``z`` and ``z_rate``, of the model itself in double precision."""
    precise = copy.deepcopy(model).double().eval().requires_grad_(False)
    parts = {
        kind: sum(
            windows(signals[name + kind], portable.length)[:, ::-1] @ portable.weights[name] for name in portable.inputs
        )
        for kind in ("", "_rate")
    }
    table = {"x": parts[""], "x_rate": parts["_rate"], "v": signals["v_slip"][:, None]}
    table |= {"v_rate": signals["v_slip_rate"][:, None]}
    if "normal_force" in signals:
        table |= {"N": signals["normal_force"][:, None], "N_rate": signals["normal_force_rate"][:, None]}
    batch = {name: torch.as_tensor(np.ascontiguousarray(values)) for name, values in table.items()}
    with torch.no_grad():
        found = precise.predict(batch)
    names = ("force", "z", "z_rate") if portable.estimator else ("force",)
    return {name: found[name].squeeze(-1).numpy() for name in names}
