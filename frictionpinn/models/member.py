"""One model with another's tensors and numbers in its place: how the members of an ensemble share a program."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import torch
from torch import Tensor, nn

from .base import Batch, FrictionModel
from .parameter_estimator import ParameterEstimator


class Applied(nn.Module):
    """A model and what to do with it as one module, so that ``functional_call`` can swap its tensors."""

    def __init__(self, model: FrictionModel, what: Callable):
        super().__init__()
        self.model, self.what = model, what

    def forward(self, batch: Batch) -> Any:
        return self.what(self.model, batch)


def numbers_of(members: list[FrictionModel], dtype: torch.dtype = torch.float32) -> dict[str, Tensor]:
    """Plain numbers in which members may differ, stacked: scales, bounds and the unbounded bristle's scale."""
    tables = [number_table(member) for member in members]
    return {key: torch.tensor([table[key] for table in tables], dtype=dtype) for key in tables[0]}


def number_table(model: FrictionModel) -> dict[str, Any]:
    table = {f"scales.{name}": value for name, value in model.scales.items()}
    if isinstance(model, ParameterEstimator):
        table["z_scale"] = model.z_scale
    if (law := getattr(model, "law_parameters", None)) is not None:
        for name, (low, high) in law.bounds.items():
            table |= {f"bounds.{name}.low": low, f"bounds.{name}.high": high}
    return table


def set_numbers(model: FrictionModel, numbers: Mapping[str, Any]) -> dict[str, Any]:
    """Put one member's numbers in their places; returns what was there."""
    before = number_table(model)
    model.scales = {name: numbers[f"scales.{name}"] for name in model.scales}
    if isinstance(model, ParameterEstimator):
        model.z_scale = numbers["z_scale"]
    if (law := getattr(model, "law_parameters", None)) is not None:
        law.bounds = {n: (numbers[f"bounds.{n}.low"], numbers[f"bounds.{n}.high"]) for n in law.bounds}
    return before
