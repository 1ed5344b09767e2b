"""A trained model as an ONNX graph: windows, normalisation, network and, for a parameter estimator, the law."""

from __future__ import annotations

import json
import logging
import warnings
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from .. import __version__
from ..errors import UserError
from ..models import FrictionModel, ParameterEstimator
from ..numerics.torch_functions import torch_function
from .extras import require
from .functions import ACTIVATIONS, U
from .histories import made_up_signals, reference, windows
from .portable import PortableModel

TOLERANCE = 1e-3  # of the force's root mean square: single precision
SIGNAL_TEXT = {
    "v_slip": "slip velocity",
    "normal_force": "normal force",
    "a_frictionless": "slip acceleration if the contact had no friction",
    "force": "friction force, against positive slip",
    "z": "bristle state",
    "z_rate": "rate of the bristle state",
}


class ExportedGraph(nn.Module):
    """The last ``length`` samples of every signal, each (batch, length), oldest first -> force (batch, 1), z, z'.

    The derivative along the trajectory is written out layer by layer, since ONNX knows no forward-mode derivative.
    """

    def __init__(self, model: FrictionModel, portable: PortableModel):
        super().__init__()
        self.portable, self.network = portable, model.network
        for name, weights in portable.weights.items():
            self.register_buffer(f"window_{name}", torch.tensor(weights[::-1].copy(), dtype=torch.float32))
        act = portable.activation
        self.slope = torch_function([U], ACTIVATIONS[act][1]) if act != "relu" else lambda u: (u > 0).to(u.dtype)
        if isinstance(model, ParameterEstimator) and portable.law is not None:
            self.functions = model.functions
            self.values = [float(portable.values[name]) for name in self.functions.names]

    def _layers(self, u: Tensor, du: Tensor) -> tuple[Tensor, Tensor]:
        for layer in self.network.layers:
            if isinstance(layer, nn.Linear):
                u, du = layer(u), du @ layer.weight.T
            else:
                u, du = layer(u), self.slope(u) * du
        return u, du

    def _network(self, x: Tensor, x_rate: Tensor) -> tuple[Tensor, Tensor]:
        """Output and its derivative along the trajectory."""
        u, du = (x - self.network.mean) / self.network.scale, x_rate / self.network.scale
        out, rate = self._layers(u, du)
        if not self.network.odd:
            return out, rate
        mirrored, mirrored_rate = self._layers(u * self.network.signs, du * self.network.signs)
        return (out - mirrored) / 2, (rate - mirrored_rate) / 2

    def _features(self, signals: dict[str, Tensor]) -> Tensor:
        parts = [signals[name] @ getattr(self, f"window_{name}") for name in self.portable.inputs]
        return torch.stack(parts).sum(0)

    def forward(self, *histories: Tensor) -> tuple[Tensor, ...]:
        names, p = self.portable.signals, self.portable
        signals = dict(zip(names, histories, strict=False))
        rates = dict(zip(names, histories[len(names) :], strict=False))
        if "normal_force" in signals:
            sign = signals["normal_force"].sign()
            signals["normal_force"] = signals["normal_force"].abs()
            rates = {name: rate * sign if name == "normal_force" else rate for name, rate in rates.items()}
        x = self._features(signals)
        if not p.estimator:
            return (p.force_scale * self._network(x, torch.zeros_like(x))[0],)
        v, N = signals["v_slip"][:, -1:], signals["normal_force"][:, -1:]
        u, u_rate = self._network(x, self._features(rates))
        z, z_rate = self._bristle(u, u_rate, v, N, rates["v_slip"][:, -1:], rates["normal_force"][:, -1:])
        return self.functions.force(v, N, z, z_rate, *self.values), z, z_rate

    def _bristle(self, u: Tensor, u_rate: Tensor, v: Tensor, N: Tensor, v_rate: Tensor, N_rate: Tensor):
        p = self.portable
        if p.bristle == "free":
            return u * p.z_scale, u_rate * p.z_scale
        stiffness = p.values["sigma_0"]
        if p.bristle == "load":
            v, v_rate = torch.zeros_like(v), torch.zeros_like(v_rate)
        share = torch.tanh(u)
        g = self.functions.capacity(v, N, *self.values)
        g_rate = self.functions.capacity_rate(v, N, v_rate, N_rate, *self.values)
        return share * g / stiffness, ((1 - share**2) * u_rate * g + share * g_rate) / stiffness


def write_onnx(folder: Path, model: FrictionModel, portable: PortableModel) -> dict[str, Any]:
    """Write ``friction.onnx`` and compare it with the model on made-up histories.

    Returns:
        files, inputs and outputs with units and shapes, and ``check``: the largest differences in force.

    Raises:
        UserError: onnx, onnxscript or onnxruntime is not installed.
    """
    require("export", "onnx", "onnxscript", "onnxruntime")
    path = folder / "friction.onnx"
    names = [*portable.signals, *(f"{name}_rate" for name in portable.signals if portable.estimator)]
    outputs = ["force", *(["z", "z_rate"] if portable.estimator else [])]
    described = _describe(portable, names, outputs)
    arguments = [torch.rand(3, portable.length) for _ in names]
    save_graph(path, ExportedGraph(model.eval(), portable), names, outputs, arguments)
    _annotate(path, portable, described)
    return {"files": [path.name], **described, "check": _check(path, model, portable, names)}


def save_graph(path: Path, graph: nn.Module, names: list[str], outputs: list[str], arguments: list[Tensor]) -> None:
    """Write a module as ONNX; the first axis of every input, of which ``arguments`` are examples, is a batch."""
    batch = torch.export.Dim("batch", min=1)
    told = {name: logging.getLogger(name).level for name in ("torch.onnx", "onnxscript", "onnx_ir")}
    with torch.no_grad(), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for name in told:
            logging.getLogger(name).setLevel(logging.ERROR)
        try:
            shapes = (tuple({0: batch} for _ in names),)
            program = torch.export.export(graph, tuple(arguments), dynamic_shapes=shapes, strict=False)
            # Not optimised: onnxscript drops the 1e-12 that keeps the Stribeck curve's derivative finite at v = 0.
            named = partial(torch.onnx.export, input_names=names, output_names=outputs)
            exported = named(program, tuple(arguments), dynamo=True, verbose=False, optimize=False)
        finally:
            for name, level in told.items():
                logging.getLogger(name).setLevel(level)
    assert exported is not None
    exported.save(path, external_data=False)


def _describe(portable: PortableModel, names: list[str], outputs: list[str]) -> dict[str, Any]:
    def entry(name: str, shape: list) -> dict[str, Any]:
        text = (
            SIGNAL_TEXT[name]
            if name in SIGNAL_TEXT
            else f"time derivative of {SIGNAL_TEXT[name.removesuffix('_rate')]}"
        )
        return {"unit": portable.units[name], "shape": shape, "text": text}

    return {
        "inputs": {name: entry(name, ["batch", portable.length]) for name in names},
        "outputs": {name: entry(name, ["batch", 1]) for name in outputs},
    }


def _annotate(path: Path, portable: PortableModel, described: dict[str, Any]) -> None:
    import onnx

    proto = onnx.load(path)
    proto.producer_name, proto.producer_version = "frictionpinn", __version__
    proto.doc_string = f"{portable.title}. Each input: the last samples of a signal, oldest first; before the first"
    proto.doc_string += " sample of a trial its first value."
    table = {
        "inputs": described["inputs"],
        "outputs": described["outputs"],
        "interval": {"value": portable.interval, "unit": "s"},
        "parameters": portable.values,
        "model": portable.name,
        "system": portable.system.name,
    }
    onnx.helper.set_model_props(proto, {key: json.dumps(value) for key, value in table.items()})
    for values, kind in ((proto.graph.input, "inputs"), (proto.graph.output, "outputs")):
        for value in values:
            entry = described[kind][value.name]
            value.doc_string = f"{entry['text']}, {entry['unit']}"
            value.type.tensor_type.shape.dim[0].dim_param = "batch"
    onnx.checker.check_model(proto, full_check=True)
    onnx.save(proto, path)


def _check(path: Path, model: FrictionModel, portable: PortableModel, names: list[str]) -> dict[str, Any]:
    """Made-up histories: the model in double precision, the graph in single."""
    signals = made_up_signals(portable.signals, portable.interval, model.scales, 1000, seed=0)
    feed = {name: windows(signals[name], portable.length).astype(np.float32) for name in names}
    return compare(path, feed, reference(model, portable, signals)["force"], portable.units["force"])


def compare(path: Path, feed: dict[str, np.ndarray], expected: np.ndarray, unit: str) -> dict[str, Any]:
    """The graph's force at many instants, as one batch and one of them by itself, beside the model's, shape (n,).

    Raises:
        UserError: they differ by more than single precision explains.
    """
    import onnxruntime

    session = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])
    middle = len(expected) // 2
    whole = session.run(["force"], feed)[0][:, 0]
    single = session.run(["force"], {name: values[middle : middle + 1] for name, values in feed.items()})[0][:, 0]
    difference = max(float(np.abs(whole - expected).max()), float(np.abs(single - expected[middle]).max()))
    relative = difference / float(np.sqrt(np.mean(expected**2)))
    if not relative < TOLERANCE:
        raise UserError(
            "the ONNX graph differs from the model",
            where=str(path),
            received=f"{100 * relative:.3g} % of the force",
            allowed=f"{100 * TOLERANCE:g} %",
            fix="try other versions of onnx, onnxscript and onnxruntime (constraints.txt names those that agree)",
        )
    return {
        "against": f"the model in double precision, {len(expected)} made-up instants",
        "largest_difference": {"value": difference, "unit": unit},
        "relative": relative,
    }
