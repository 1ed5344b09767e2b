"""The exported friction, step by step, whatever simulator asks: the law with its bristle, and the trained network.

All give ``force(now)``, which keeps nothing, so that a solver may try states; ``keep(now)`` goes on to the next step.
``now`` holds v_slip, a_slip, normal_force and a_frictionless at the end of the step, in SI units.
Needs numpy alone.
"""

from __future__ import annotations

import importlib
import math
from typing import Any

import numpy as np

try:  # the law, generated from its equations; a black box has none
    friction_law: Any = importlib.import_module("friction_law")
except ImportError:
    friction_law = None


def law_of(description: dict) -> Any:
    """The module with the law's functions: one for each contact where there are several."""
    name = description.get("law_module")
    return importlib.import_module(name) if name else friction_law


_NORMAL_SHARE = np.vectorize(lambda u: (1 + math.erf(u / math.sqrt(2))) / 2)


def _sigmoid(u):
    return 1 / (1 + np.exp(-np.clip(u, -500, 500)))


ACTIVATIONS: dict[str, tuple[Any, Any]] = {  # value and slope
    "relu": (lambda u: np.maximum(u, 0), lambda u: (u > 0) * 1.0),
    "silu": (lambda u: u * _sigmoid(u), lambda u: _sigmoid(u) * (1 + u * (1 - _sigmoid(u)))),
    "tanh": (np.tanh, lambda u: 1 - np.tanh(u) ** 2),
    "gelu": (
        lambda u: u * _NORMAL_SHARE(u),
        lambda u: _NORMAL_SHARE(u) + u * np.exp(-(u**2) / 2) / math.sqrt(2 * math.pi),
    ),
    "softplus": (lambda u: np.logaddexp(u, 0), _sigmoid),
}


class Law:
    """The friction law with its identified parameters; the bristle state is advanced by the exponential update."""

    signals = ("v_slip", "normal_force")

    def __init__(self, description: dict, timestep: float):
        self.law = law_of(description)
        self.p = tuple(description["parameters"][name]["value"] for name in self.law.PARAMETERS)
        self.h = timestep
        self.reset()

    def reset(self) -> None:
        self.z, self.slip, self.normal = 0.0, None, None

    def _advance(self, v: float, N: float) -> float:
        middle = v if self.slip is None else (v + self.slip) / 2
        load = N if self.normal is None else (N + self.normal) / 2
        if load <= 0:  # without a load nothing bends, and nothing is carried
            return 0.0
        rate = self.law.bristle_rate(middle, load, self.z, *self.p)
        x = self.law.bristle_slope(middle, load, self.z, *self.p) * self.h
        return self.z + self.h * rate * (1 + x / 2 if abs(x) < 1e-8 else math.expm1(x) / x)

    def force(self, now: dict) -> float:
        v, N = now["v_slip"], now["normal_force"]
        if N <= 0:
            return 0.0
        z = self._advance(v, N)
        return self.law.force(v, N, z, self.law.bristle_rate(v, N, z, *self.p), *self.p)

    def keep(self, now: dict) -> None:
        self.z = self._advance(now["v_slip"], now["normal_force"])
        self.slip, self.normal = now["v_slip"], now["normal_force"]


class Bristles:
    """The trained network with memory: bristles in parallel, saturated by what its table says; any timestep."""

    signals = ("v_slip", "normal_force")

    def __init__(self, description: dict, timestep: float):
        self.table, self.grid = np.array(description["tables"]), description["grid"]
        self.stiffness, self.damping, self.gap, self.sharpness = np.array(description["elements"])
        self.h = timestep
        self.reset()

    def reset(self) -> None:
        self.z, self.slip, self.normal = np.zeros(len(self.stiffness)), None, None

    def _look(self, v: float, N: float) -> np.ndarray:
        """Reach over load of every bristle, then the viscous coefficient: bilinear, held at the ends."""
        v0, first, step, lowest, apart = self.grid
        _, velocities, loads = self.table.shape
        x = min(max((math.asinh(v / v0) - first) / step, 0.0), velocities - 1.0)
        y = min(max((N - lowest) / apart, 0.0), loads - 1.0)
        i, j = min(int(x), velocities - 2), min(int(y), loads - 2)
        x, y = x - i, y - j
        (a, b), (c, d) = self.table[:, i : i + 2, j : j + 2].transpose(1, 2, 0)
        return (1 - x) * ((1 - y) * a + y * b) + x * ((1 - y) * c + y * d)

    def _advance(self, v: float, N: float) -> np.ndarray:
        middle = v if self.slip is None else (v + self.slip) / 2
        load = N if self.normal is None else (N + self.normal) / 2
        reach = self.gap + load * self._look(middle, load)[:-1]
        bends, reach = reach > 0, np.where(reach > 0, reach, 1.0)  # without a load nothing does, and carries nothing
        bent = np.where(self.sharpness == 1, 1.0, (np.abs(self.z) / reach) ** (self.sharpness - 1))
        x = abs(middle) * self.h / reach * bent
        z = self.z * np.exp(-x) + middle * self.h * np.where(x < 1e-8, 1 - x / 2, -np.expm1(-x) / np.maximum(x, 1e-8))
        return np.where(bends, z, 0.0)

    def force(self, now: dict) -> float:
        v, N = now["v_slip"], now["normal_force"]
        z, seen = self._advance(v, N), self._look(v, N)
        reach = self.gap + N * seen[:-1]
        bends, reach = reach > 0, np.where(reach > 0, reach, 1.0)
        z = np.where(bends, z, 0.0)
        share = (np.abs(z) / reach) ** self.sharpness
        rate = np.where(bends, v - abs(v) * np.sign(z) * share, 0.0)
        spring = self.stiffness * np.maximum(np.abs(z) - self.gap, 0)
        damping, most = self.damping * rate, spring * share
        damping = np.where((rate * v < 0) & (np.abs(damping) > most), -np.sign(z) * most, damping)
        return float(v * seen[-1] + np.sum(np.sign(z) * spring + damping))

    def keep(self, now: dict) -> None:
        self.z = self._advance(now["v_slip"], now["normal_force"])
        self.slip, self.normal = now["v_slip"], now["normal_force"]


class Network:
    """The trained network: its windows look back over the simulated steps, spaced as in training."""

    def __init__(self, description: dict, timestep: float):
        self.d, self.signals = description, tuple(description["signals"])
        stride = description["interval"]["value"] / timestep
        if abs(stride - round(stride)) > 1e-6 * stride or round(stride) < 1:
            raise ValueError(f"timestep must be {description['interval']['value']} s divided by a whole number")
        self.estimator, self.h = description["law"] is not None, timestep
        self.weights = {name: np.array(rows) for name, rows in description["weights"].items()}
        self.layers = [(np.array(weight), np.array(bias)) for weight, bias in description["layers"]]
        self.mean, self.scale, self.signs = (np.array(description[key]) for key in ("mean", "scale", "signs"))
        self.act, self.slope = ACTIVATIONS[description["activation"]]
        self.settled = 2 if self.estimator else 1  # the first sample tells no rates
        self.back = np.arange(1, description["samples"]) * round(stride)
        if self.estimator:
            values = {name: entry["value"] for name, entry in description["network_parameters"].items()}
            self.law = law_of(description)
            self.p, self.stiffness = tuple(values[name] for name in self.law.PARAMETERS), values["sigma_0"]
        self.reset()

    def reset(self) -> None:
        self.count = 0
        self.past = np.zeros((int(self.back[-1]) if len(self.back) else 1, 2, len(self.signals)))
        self.of_past: np.ndarray | None = None

    def _features(self, row: np.ndarray) -> np.ndarray:
        """Features and their rates, shape (2, d); what the past gives to them is summed once a step."""
        if self.count < self.settled:  # before the first sample, every signal was what it is there
            return self._of_past(np.repeat(row[None], len(self.back), 0)) + self._newest(row)
        if self.of_past is None:
            self.of_past = self._of_past(self.past[np.maximum(self.count - self.back, 0) % len(self.past)])
        return self.of_past + self._newest(row)

    def _of_past(self, past: np.ndarray) -> np.ndarray:
        columns = [(past[:, :, self.signals.index(name)], self.weights[name][1:]) for name in self.d["inputs"]]
        return np.sum([np.einsum("kr,kd->rd", values, weights) for values, weights in columns], axis=0)

    def _newest(self, row: np.ndarray) -> np.ndarray:
        parts = [np.outer(row[:, self.signals.index(name)], self.weights[name][0]) for name in self.d["inputs"]]
        return np.sum(parts, axis=0)

    def _network(self, x: np.ndarray) -> tuple[float, float]:
        """Output, and its derivative along the trajectory, of features and rates (2, d)."""
        u = (x[0] - self.mean) / self.scale
        u, du = np.stack([u, u * self.signs]), np.stack([x[1] / self.scale, x[1] / self.scale * self.signs])
        for k, (weight, bias) in enumerate(self.layers):
            u, du = u @ weight.T + bias, du @ weight.T if self.estimator else du
            if k < len(self.layers) - 1:
                u, du = self.act(u), self.slope(u) * du if self.estimator else du
        out, rate = u[:, 0], du[:, 0]
        return ((out[0] - out[1]) / 2, (rate[0] - rate[1]) / 2) if self.d["odd"] else (out[0], rate[0])

    def _row(self, now: dict) -> np.ndarray:
        values, rates = [now[name] for name in self.signals], []
        for name, value in zip(self.signals, values, strict=True):
            before = self.past[(self.count - 1) % len(self.past), 0, self.signals.index(name)] if self.count else value
            rates.append(now["a_slip"] if name == "v_slip" else (value - before) / self.h)
        return np.array([values, rates])

    def force(self, now: dict) -> float:
        row = self._row(now)
        u, u_rate = self._network(self._features(row))
        if not self.estimator:
            return float(self.d["force_scale"]["value"] * u)
        (v, N), (v_rate, N_rate) = (row[i, [self.signals.index(n) for n in Law.signals]] for i in (0, 1))
        z, z_rate = u * self.d["z_scale"]["value"], u_rate * self.d["z_scale"]["value"]
        if self.d["bristle"] != "free":
            place = (0.0, N, 0.0, N_rate) if self.d["bristle"] == "load" else (v, N, v_rate, N_rate)
            g, g_rate = self.law.capacity(*place, *self.p)
            share = math.tanh(u)
            z, z_rate = share * g / self.stiffness, ((1 - share**2) * u_rate * g + share * g_rate) / self.stiffness
        return self.law.force(v, N, z, z_rate, *self.p)

    def keep(self, now: dict) -> None:
        row = self._row(now)
        if self.count == 1 and self.estimator:  # the first sample's rates were not known: history starts with these
            self.past[0] = row
        self.past[self.count % len(self.past)] = row
        self.count, self.of_past = self.count + 1, None
