"""Several networks of one variant trained and evaluated as one batched program."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from typing import Any

import lightning as L
import numpy as np
import torch
from torch import Tensor, nn
from torch.func import functional_call, grad_and_value, stack_module_state, vmap

from ..errors import UserError
from .base import Batch, FrictionModel
from .optimizers import build_optimizer
from .parameter_estimator import ParameterEstimator

_ALONE = ("adam_plateau", "adam_lbfgs")  # their steps depend on the loss of one training
# On a CPU, members go through vmap a few at a time where their activations (samples times width) are small: there the
# cost of an operation's call counts. Larger ones go one by one through plain autograd, whose matrix products are the
# faster ones and whose activations stay in the cache (benchmarks/ensemble.py).
_SMALL, _CHUNK = 32_000, 4


class FrictionEnsemble(FrictionModel):
    """N members with stacked weights; member k takes exactly the steps that it would take alone.

    The loss of the program is the sum of the members' losses: no gradient crosses from one to another, and the
    optimizers allowed here work element by element. Each member's best weights and early stopping are its own too.
    Its prediction is the members' mean; ``force_std`` is their spread (sample standard deviation).

    Args:
        members: models of the same variant, network, law and optimizer; start weights, standardisation, scales and
            bounds may differ.
    """

    best_loss: Tensor
    stop_loss: Tensor
    waited: Tensor
    template: FrictionModel

    def __init__(self, members: list[FrictionModel]):
        L.LightningModule.__init__(self)  # the networks are the members'
        first = members[0]
        name = first.optimizer_config["name"]
        if name in _ALONE:
            raise UserError(
                "an optimizer that follows a single loss cannot train an ensemble",
                where="optimizer",
                received=name,
                allowed="adam, adam_onecycle",
            )
        options = {**first.hparams, "members": [dict(member.hparams) for member in members]}
        self.save_hyperparameters(options, logger=False)
        self.size, self.optimizer_config = len(members), first.optimizer_config
        self.features, self.scales = first.features, first.scales
        self.sees_rates = first.sees_rates
        weights, buffers = stack_module_state(members)  # type: ignore[arg-type]
        self.names: dict[str, list[str]] = {}
        for kind, table in (("weight", weights), ("buffer", buffers), ("number", _numbers(members))):
            self.names[kind] = list(table)
            for key, value in table.items():
                self._register(kind, key, value.detach().clone())
        for key in self.names["weight"]:
            self._register("best", key, weights[key].detach().clone())
        self.register_buffer("best_loss", torch.full((self.size,), torch.inf))
        self.register_buffer("stop_loss", torch.full((self.size,), torch.inf))
        self.register_buffer("waited", torch.zeros(self.size, dtype=torch.long))
        self.__dict__["template"] = copy.deepcopy(first).requires_grad_(False)  # a shape without weights of its own
        self.parts: dict[str, Tensor] = {}
        self.member_parts: dict[str, Tensor] = {}
        self._gradients: dict[str, Tensor] = {}

    @classmethod
    def from_hparams(cls, hparams: Mapping[str, Any]) -> FrictionEnsemble:
        """Rebuild from the hyper-parameters of a checkpoint; its state is loaded afterwards."""
        from . import MODELS

        return cls([MODELS[item["name"]](**item) for item in hparams["members"]])

    def _register(self, kind: str, key: str, value: Tensor) -> None:
        place = f"{kind}:{key.replace('.', '/')}"
        if kind == "weight":
            self.register_parameter(place, nn.Parameter(value))
        else:
            self.register_buffer(place, value)

    def _table(self, kind: str) -> dict[str, Tensor]:
        """name -> tensor whose first axis counts the members; kind is weight, buffer, number or best."""
        names = self.names["weight" if kind == "best" else kind]
        return {key: getattr(self, f"{kind}:{key.replace('.', '/')}") for key in names}

    def _call(self, what: Callable, weights: dict, rest: dict, numbers: dict, batch: Batch) -> Any:
        """``what(template, batch)`` with the tensors of one member."""
        tensors = {f"model.{key}": value for key, value in {**weights, **rest}.items()}
        plain = _set_numbers(self.template, numbers)
        try:
            return functional_call(_Applied(self.template, what), tensors, (batch,))
        finally:
            _set_numbers(self.template, plain)

    # training ------------------------------------------------------------------------------------------------
    def training_step(self, batch: Batch, batch_idx: int) -> Tensor:
        """Losses and gradients of all members; the gradients wait for :meth:`backward`."""
        step = self.chunk(batch)
        weights, rest, numbers = self._table("weight"), self._table("buffer"), self._table("number")
        shared = batch["x"].dim() == 2
        found = []
        for k in range(0, self.size, step):
            part = slice(k, k + step)
            own, fixed, given = (
                {key: value[part].detach() for key, value in table.items()} for table in (weights, rest, numbers)
            )
            data = batch if shared else {key: value[part] for key, value in batch.items()}
            found.append((self._alone if step == 1 else self._gradient)(own, fixed, given, data))
        self._gradients = {key: torch.cat([item[0][key] for item in found]) for key in weights}
        self.member_parts = {key: torch.cat([item[1][key] for item in found]) for key in found[0][1]}
        self.parts = {key: value.mean() for key, value in self.member_parts.items()}
        if self._logs_now():
            self.log("loss/training", self.parts["loss"], on_step=False, on_epoch=True, batch_size=batch["v"].shape[-2])
        return self.parts["loss"].clone().requires_grad_()

    def _gradient(self, weights: dict, rest: dict, numbers: dict, batch: Batch) -> tuple[dict, dict]:
        def loss(own: dict, rest: dict, numbers: dict, batch: Batch) -> tuple[Tensor, dict[str, Tensor]]:
            parts = self._call(FrictionModel.losses, own, rest, numbers, batch)
            return parts["loss"], parts

        one = grad_and_value(loss, has_aux=True)
        dims = (0, 0, 0, None if batch["x"].dim() == 2 else 0)
        gradients, (_, parts) = vmap(one, in_dims=dims)(weights, rest, numbers, batch)
        return gradients, parts

    def _alone(self, weights: dict, rest: dict, numbers: dict, batch: Batch) -> tuple[dict, dict]:
        """As :meth:`_gradient`, of tables of one member, by plain autograd."""
        own, fixed, given = ({key: value[0] for key, value in table.items()} for table in (weights, rest, numbers))
        data = batch if batch["x"].dim() == 2 else {key: value[0] for key, value in batch.items()}
        leaves = {key: value.requires_grad_() for key, value in own.items()}
        with torch.enable_grad():
            parts = self._call(FrictionModel.losses, leaves, fixed, given, data)
            gradients = torch.autograd.grad(parts["loss"], list(leaves.values()))
        table = {key: value[None] for key, value in zip(leaves, gradients, strict=True)}
        return table, {key: value.detach()[None] for key, value in parts.items()}

    def backward(self, loss: Tensor, *args: Any, **kwargs: Any) -> None:
        """The gradients are known already."""
        for key, parameter in self._table("weight").items():
            parameter.grad = self._gradients[key]

    def chunk(self, batch: Batch) -> int:
        """Members that go through the program at once."""
        if batch["x"].device.type != "cpu":
            return self.size
        activations = batch["x"].shape[-2] * int(self.hparams["network"]["width"])
        return min(_CHUNK, self.size) if activations <= _SMALL else 1

    def validation_step(self, batch: Batch, batch_idx: int) -> None:
        losses = self.each(FrictionModel.losses, batch)["loss"]
        self.validation_losses = losses.detach()
        self.log("loss/validation", losses.mean().detach(), batch_size=batch["v"].shape[-2])

    def configure_optimizers(self):
        steps = int(self.trainer.estimated_stepping_batches) if self._trainer is not None else 1000
        table = self._table("weight")
        physical = [p for name, p in table.items() if name.startswith("law_parameters")]
        return build_optimizer(
            self.optimizer_config, [p for p in table.values() if all(p is not q for q in physical)], physical, steps
        )

    @torch.no_grad()
    def keep_best(self, losses: Tensor, patience: int | None = None, min_delta: float = 0.0) -> bool:
        """Keep the weights of members whose loss is their lowest so far; False once all have stopped.

        Args:
            losses: shape (N,), at a checkpoint.
            patience: checkpoints without improvement after which a member has stopped; None: never.
            min_delta: what counts as an improvement there.
        """
        active = self.waited < (patience if patience is not None else torch.iinfo(torch.long).max)
        better, improved = active & (losses < self.best_loss), active & (losses < self.stop_loss - min_delta)
        self.best_loss.copy_(torch.where(better, losses, self.best_loss))
        self.stop_loss.copy_(torch.where(improved, losses, self.stop_loss))
        self.waited.copy_(torch.where(improved, torch.zeros_like(self.waited), self.waited + active.long()))
        best = self._table("best")
        for key, value in self._table("weight").items():
            best[key][better] = value[better]
        return patience is None or bool((self.waited < patience).any())

    @torch.no_grad()
    def restore_best(self) -> None:
        """Give every member its best weights."""
        kept = torch.isfinite(self.best_loss)
        best = self._table("best")
        for key, value in self._table("weight").items():
            value[kept] = best[key][kept]

    # use -----------------------------------------------------------------------------------------------------
    def each(self, what: Callable[[FrictionModel, Batch], Any], batch: Batch) -> Any:
        """``what(member, batch)`` of all members, stacked along the first axis."""
        shared = batch["x"].dim() == 2

        def one(weights: dict, rest: dict, numbers: dict, batch: Batch) -> Any:
            return self._call(what, weights, rest, numbers, batch)

        dims = (0, 0, 0, None if shared else 0)
        return vmap(one, in_dims=dims)(self._table("weight"), self._table("buffer"), self._table("number"), batch)

    def predict(self, batch: Batch) -> dict[str, Tensor]:
        """Means over the members of what a member predicts, and ``force_std``, each of shape (n, 1)."""
        found = self.each(lambda model, data: model.predict(data), batch)
        return {name: value.mean(0) for name, value in found.items()} | {"force_std": found["force"].std(0)}

    def physical(self) -> dict[str, float]:
        """Means over the members of the physical parameters, SI units."""
        return {name: float(np.mean(values)) for name, values in self.physical_of_members().items()}

    @torch.no_grad()
    def physical_of_members(self) -> dict[str, list[float]]:
        """name -> the parameter's value in every member; empty for black boxes."""
        if not isinstance(self.template, ParameterEstimator):
            return {}

        def values(model: Any, _: Batch) -> dict[str, Tensor]:
            return model.law_parameters()

        found = self.each(values, {"x": torch.zeros(1, 1)})
        return {name: value.tolist() for name, value in found.items()}

    @property
    def law_parameters(self) -> Any:
        """Which of the law's parameters are trained and which fixed; their values are the members'."""
        return self.template.law_parameters

    def members(self) -> list[FrictionModel]:
        """The members as models of their own, with their present weights."""
        from . import MODELS

        made = []
        for k, hparams in enumerate(self.hparams["members"]):
            model = MODELS[hparams["name"]](**hparams)
            state = {**self._table("weight"), **self._table("buffer")}
            model.load_state_dict({key: value[k] for key, value in state.items()})
            made.append(model.to(next(iter(self.parameters())).device).eval())
        return made


class _Applied(nn.Module):
    """A model and what to do with it as one module, so that ``functional_call`` can swap its tensors."""

    def __init__(self, model: FrictionModel, what: Callable):
        super().__init__()
        self.model, self.what = model, what

    def forward(self, batch: Batch) -> Any:
        return self.what(self.model, batch)


def _numbers(members: list[FrictionModel]) -> dict[str, Tensor]:
    """Plain numbers in which members may differ, stacked: scales, bounds and the unbounded bristle's scale."""
    tables = [_number_table(member) for member in members]
    return {key: torch.tensor([table[key] for table in tables], dtype=torch.float32) for key in tables[0]}


def _number_table(model: FrictionModel) -> dict[str, Any]:
    table = {f"scales.{name}": value for name, value in model.scales.items()}
    if isinstance(model, ParameterEstimator):
        table["z_scale"] = model.z_scale
        for name, (low, high) in model.law_parameters.bounds.items():
            table |= {f"bounds.{name}.low": low, f"bounds.{name}.high": high}
    return table


def _set_numbers(model: FrictionModel, numbers: Mapping[str, Any]) -> dict[str, Any]:
    """Put one member's numbers in their places; returns what was there."""
    before = _number_table(model)
    model.scales = {name: numbers[f"scales.{name}"] for name in model.scales}
    if isinstance(model, ParameterEstimator):
        model.z_scale = numbers["z_scale"]
        names = model.law_parameters.bounds
        model.law_parameters.bounds = {n: (numbers[f"bounds.{n}.low"], numbers[f"bounds.{n}.high"]) for n in names}
    return before
