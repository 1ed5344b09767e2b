"""A network with memory as an ONNX graph: one step from sample to sample, its state in and out."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from .. import __version__
from ..models import StateModel
from ..numerics.state_function import Drive
from ..numerics.state_recursions import forward
from .extras import require
from .histories import made_up_signals
from .onnx_model import SIGNAL_TEXT, compare, save_graph
from .portable_state import PortableState

INSTANTS = 1000  # at which graph and model are compared


class StateStep(nn.Module):
    """Signals at the sample before and now, each (batch, 2), time between them and state -> force now, state now.

    The state is z of every bristle, after the slip velocity where the model moves it itself. The same recursion as
    :func:`..numerics.state_recursions.forward`, for a batch of instants.
    """

    tables: Tensor
    elements: Tensor

    def __init__(self, portable: PortableState):
        super().__init__()
        numbers, self.p = portable.numbers, portable
        self.shape, self.K = numbers.tables.shape[1:], numbers.states
        self.grid = [float(value) for value in numbers.grid]
        self.register_buffer("tables", torch.tensor(numbers.tables.reshape(self.K + 1, -1), dtype=torch.float32))
        self.register_buffer("elements", torch.tensor(numbers.elements, dtype=torch.float32))

    def look(self, w: Tensor, N: Tensor) -> tuple[Tensor, Tensor]:
        """T of every bristle, (batch, K), and r, (batch, 1), at slip velocity and load, (batch, 1) each."""
        v0, first, step, lowest, apart = self.grid
        velocities, loads = self.shape
        asinh = w.sign() * torch.log(w.abs() / v0 + torch.sqrt((w / v0) ** 2 + 1))
        x = ((asinh - first) / step).clamp(0.0, velocities - 1.0)
        y = ((N - lowest) / apart).clamp(0.0, loads - 1.0)
        i, j = x.floor().clamp(max=velocities - 2.0), y.floor().clamp(max=loads - 2.0)
        x, y, corner = x - i, y - j, (i * loads + j).long()[:, 0]
        at = [self.tables[:, corner + k].T for k in (0, 1, loads, loads + 1)]
        seen = (1 - x) * ((1 - y) * at[0] + y * at[1]) + x * ((1 - y) * at[2] + y * at[3])
        return seen[:, : self.K], seen[:, self.K :]

    def force(self, w: Tensor, N: Tensor, z: Tensor) -> Tensor:
        """F, (batch, 1)."""
        T, r = self.look(w, N)
        kappa, c, gap, n = self.elements
        bn = self.power(z.abs() / (gap + N * T), n)
        rate = w - w.abs() * z.sign() * bn
        spring = kappa * (z.abs() - gap).clamp(min=0.0)
        most = spring * bn
        bound = (rate * w < 0) & ((c * rate).abs() > most)
        damping = torch.where(bound, -z.sign() * most, c * rate)
        return w * r + (z.sign() * spring + damping).sum(1, keepdim=True)

    def stretch(self, w: Tensor, N: Tensor, more: Tensor, z: Tensor, d: Tensor) -> Tensor:
        """States after a time d at slip velocity w, while the load goes from N to N + more."""
        T, _ = self.look(w, N)
        _, _, gap, n = self.elements
        X, E, mean = self.settling(w.abs() * d / (gap + N * T))
        short = X < 1e-2  # single precision
        share = torch.where(short, torch.full_like(X, 0.5), (1 - mean) / (1 - E).clamp(min=1e-6))
        s = gap + (N + more * share) * T
        X, E, mean = self.settling(w.abs() * d / s * self.power(z.abs() / s, n - 1))
        after, end = z * E + w * d * mean, w.sign() * s
        return torch.where(((after - end) * (z - end) < 0) & (n != 1), end, after)

    @staticmethod
    def settling(X: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """X, exp(-X) and its mean over [0, X]."""
        E = torch.exp(-X)
        return X, E, torch.where(X > 1e-2, (1 - E) / X.clamp(min=1e-6), 1 - X / 2 + X * X / 6)

    @staticmethod
    def power(b: Tensor, n: Tensor) -> Tensor:
        """b^n for b >= 0; 1 where n = 0, else 0 at b = 0."""
        return torch.where(b > 0, torch.exp(n * torch.log(b.clamp(min=1e-38))), (n == 0).to(b.dtype))

    def forward(self, *given: Tensor) -> tuple[Tensor, Tensor]:
        v_slip, normal_force, *a_frictionless, dt, state = given
        p, moves = self.p, bool(a_frictionless)
        before, now = v_slip[:, :1], v_slip[:, 1:]
        N, load = normal_force.abs()[:, :1], normal_force.abs()[:, 1:]
        w, z = (state[:, :1], state[:, 1:]) if moves else (before, state)
        if moves:
            w = w + p.gain * (before - w) / (1 + (p.noise / before.abs().clamp(min=1e-12)) ** 4)
        d, more = dt / p.steps, (load - N) / p.steps
        z = self.stretch(w, N, more / 2, z, d / 2)
        for m in range(p.steps):
            share, after = (m + 0.5) / p.steps, (m + 1.0) / p.steps
            middle_load = N + (m + 0.5) * more
            if moves:
                A = (1 - share) * a_frictionless[0][:, :1] + share * a_frictionless[0][:, 1:]
                middle = w + d / 2 * (A - p.mobility * self.force(w, middle_load, z))
                w = w + d * (A - p.mobility * self.force(middle, middle_load, z))
            else:
                w = before + after * (now - before)
            part = 1.0 if m + 1 < p.steps else 0.5
            z = self.stretch(w, middle_load, part * more, z, part * d)
        return self.force(w, load, z), torch.cat([w, z], 1) if moves else z


def write_state_onnx(folder: Path, model: StateModel, portable: PortableState) -> dict[str, Any]:
    """Write ``friction.onnx`` and compare one step of it with the model at made-up instants.

    Returns:
        files, inputs and outputs with units and shapes, and ``check``: the largest differences in force.

    Raises:
        UserError: onnx, onnxscript or onnxruntime is not installed; the graph differs from the model.
    """
    require("export", "onnx", "onnxscript", "onnxruntime")
    path, described = folder / "friction.onnx", _describe(portable)
    names, outputs = list(described["inputs"]), list(described["outputs"])
    sizes = [described["inputs"][name]["shape"][1] for name in names]
    save_graph(path, StateStep(portable).eval(), names, outputs, [0.1 * torch.rand(3, size) for size in sizes])
    text = ". One step: each signal at the sample before and now, time between them, and the state that the step before"
    text += " gave. At the start of a trial the sample before is the first, bristles are 0."
    table = {"model": portable.name, "system": portable.system.name, "parameters": portable.values, **described}
    _annotate(path, portable.title + text, table)
    feed, expected = _instants(portable, model)
    return {"files": [path.name], **described, "check": compare(path, feed, expected, portable.units["force"])}


def _describe(portable: PortableState) -> dict[str, Any]:
    units, K = portable.units, portable.numbers.states
    entries = {
        name: {"unit": units[name], "shape": ["batch", 2], "text": f"{SIGNAL_TEXT[name]}, at the sample before and now"}
        for name in portable.signals
    }
    told = "deflection of every bristle"
    told = f"slip velocity ({units['v_slip']}), then {told}" if portable.mobility else told
    state = {"unit": units["z"], "shape": ["batch", K + bool(portable.mobility)], "text": told}
    entries["dt"] = {"unit": "s", "shape": ["batch", 1], "text": "time between the two samples"}
    force = {"unit": units["force"], "shape": ["batch", 1], "text": f"{SIGNAL_TEXT['force']}, now"}
    return {
        "inputs": entries | {"state": state | {"text": f"{told}, at the sample before"}},
        "outputs": {"force": force, "state_now": state},
    }


def _annotate(path: Path, text: str, table: dict[str, Any]) -> None:
    import onnx

    proto = onnx.load(path)
    proto.producer_name, proto.producer_version, proto.doc_string = "frictionpinn", __version__, text
    onnx.helper.set_model_props(proto, {key: json.dumps(value) for key, value in table.items()})
    onnx.checker.check_model(proto, full_check=True)
    onnx.save(proto, path)


def _instants(portable: PortableState, model: StateModel) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Inputs at made-up instants, and the force there: the model's own recursion along one made-up trial."""
    n, numbers = INSTANTS + 1, portable.numbers
    seen = made_up_signals(portable.signals, portable.interval, model.scales, n, seed=0)
    v, N = seen["v_slip"], np.abs(seen["normal_force"])
    A, h = seen.get("a_frictionless", np.zeros(n)), np.full(n, portable.interval)
    gate = 1 / (1 + (portable.noise / np.maximum(np.abs(v), 1e-12)) ** 4)
    path, z0 = np.empty((n * portable.steps, 2 + numbers.states)), np.zeros((1, numbers.states))
    moving = portable.mobility > 0
    rest = (numbers.elements, portable.gain, portable.mobility, portable.steps, moving, path)
    along = Drive(v, N, h, np.eye(n)[0], gate, portable.mobility, portable.steps).along(A)
    force, slip, states, *_ = forward(along, z0, np.zeros((1, 2)), numbers.tables, numbers.grid, *rest)
    state = np.column_stack([slip, states]) if moving else states
    feed = {name: np.column_stack([seen[name][:-1], seen[name][1:]]) for name in portable.signals}
    feed |= {"dt": h[1:, None], "state": state[:-1]}
    return {name: values.astype(np.float32) for name, values in feed.items()}, force[1:]
