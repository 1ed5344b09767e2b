"""Several networks of one variant trained and evaluated as one batched program."""

from __future__ import annotations

import copy
from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache, partial
from typing import Any

import lightning as L
import numpy as np
import torch
from torch import Tensor, nn
from torch.func import functional_call, grad_and_value, stack_module_state, vmap

from ..errors import UserError
from .base import Batch, FrictionModel
from .member import Applied, numbers_of, set_numbers
from .network_gradient import Pass, rows

ALONE = ("adam_plateau", "adam_lbfgs")  # their steps depend on the loss of one training


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
    numbers = torch.float32  # type of the plain numbers in which members differ

    def __init__(self, members: list[FrictionModel]):
        L.LightningModule.__init__(self)  # the networks are the members'
        first = members[0]
        name = first.optimizer_config["name"]
        if name in ALONE:
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
        for kind, table in (("weight", weights), ("buffer", buffers), ("number", numbers_of(members, self.numbers))):
            self.names[kind] = list(table)
            for key, value in table.items():
                self._register(kind, key, value.detach().clone())
        for key in self.names["weight"]:
            self._register("best", key, weights[key].detach().clone())
        self.register_buffer("best_loss", torch.full((self.size,), torch.inf))
        self.register_buffer("stop_loss", torch.full((self.size,), torch.inf))
        self.register_buffer("waited", torch.zeros(self.size, dtype=torch.long))
        self.__dict__["template"] = copy.deepcopy(first).requires_grad_(False)  # a shape without weights of its own
        self._spare: deque[FrictionModel] = deque()
        self.parts: dict[str, Tensor] = {}
        self.member_parts: dict[str, Tensor] = {}
        self._gradients: dict[str, Tensor] = {}

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
        try:
            template = self._spare.pop()  # its tensors are swapped while it is used: each thread takes one
        except IndexError:
            template = copy.deepcopy(self.template)
        plain = set_numbers(template, numbers)
        try:
            return functional_call(Applied(template, what), tensors, (batch,))
        finally:
            set_numbers(template, plain)
            self._spare.append(template)

    # training ------------------------------------------------------------------------------------------------
    def training_step(self, batch: Batch, batch_idx: int) -> Tensor:
        """Losses and gradients of all members; the gradients wait for :meth:`backward`."""
        weights, rest, numbers = (
            {key: value.detach() for key, value in self._table(kind).items()} for kind in ("weight", "buffer", "number")
        )
        self._gradients, self.member_parts = self._gradients_of(weights, rest, numbers, batch)
        self.parts = {key: value.mean() for key, value in self.member_parts.items()}
        if self._logs_now():
            self.log("loss/training", self.parts["loss"], on_step=False, on_epoch=True, batch_size=batch["v"].shape[-2])
        return self.parts["loss"].clone().requires_grad_()

    def _gradients_of(self, weights: dict, rest: dict, numbers: dict, batch: Batch) -> tuple[dict, dict]:
        """Gradients and losses of all members, stacked."""
        way = self._one_by_one if batch["x"].device.type == "cpu" else self._together
        return way(weights, rest, numbers, batch)

    def _together(self, weights: dict, rest: dict, numbers: dict, batch: Batch) -> tuple[dict, dict]:
        """As one program: each operation runs once for all."""

        def loss(own: dict, rest: dict, numbers: dict, batch: Batch) -> tuple[Tensor, dict[str, Tensor]]:
            parts = self._call(losses_of, own, rest, numbers, batch)
            return parts["loss"], parts

        one = grad_and_value(loss, has_aux=True)
        dims = (0, 0, 0, None if batch["x"].dim() == 2 else 0)
        gradients, (_, parts) = vmap(one, in_dims=dims)(weights, rest, numbers, batch)
        return gradients, parts

    def _one_by_one(self, weights: dict, rest: dict, numbers: dict, batch: Batch) -> tuple[dict, dict]:
        """As :meth:`_together`, on a CPU faster: each thread of torch takes a member at a time, in its cache.

        What the members see is standardised once where they share it; the network's derivatives are taken by hand, the
        law's by autograd. The result does not depend on the number of threads.
        """
        data_shared = batch["x"].dim() == 2
        scales = [rest[f"network.{name}"] for name in ("mean", "scale")]
        same = data_shared and all(bool((values == values[0]).all()) for values in scales)
        seen = self._rows(batch, *(values[0] for values in scales)) if same else None

        def one(k: int) -> tuple[dict, dict]:
            own, fixed, given = self._of_member(k, weights, rest, numbers)
            data = batch if data_shared else {key: value[k] for key, value in batch.items()}
            x = seen if seen is not None else self._rows(data, *(values[k] for values in scales))
            return self._by_hand(own, fixed, given, data, x)

        found = self._in_turn(one)
        return stacked([item[0] for item in found]), stacked([item[1] for item in found])

    @staticmethod
    def _of_member(k: int, *tables: dict) -> tuple[dict, ...]:
        """One member's tensors."""
        return tuple({key: value[k] for key, value in table.items()} for table in tables)

    def _in_turn(self, one: Callable[[int], Any]) -> list:
        """``one`` of every member, on as many threads as torch has."""
        threads = torch.get_num_threads()
        return list((map if threads == 1 else _workers(threads).map)(one, range(self.size)))

    def _rows(self, batch: Batch, mean: Tensor, scale: Tensor) -> Tensor:
        return rows(self.template.network, mean, scale, batch["x"], batch["x_rate"] if self.sees_rates else None)

    def _by_hand(self, own: dict, fixed: dict, given: dict, batch: Batch, x: Tensor) -> tuple[dict, dict]:
        """Gradients and losses of one member."""
        through = Pass(self.hparams["network"]["activation"], own, x, self.template.network.odd, self.sees_rates)
        leaves = {key: value.requires_grad_() for key, value in own.items() if not key.startswith("network.")}
        outputs = tuple(output.requires_grad_() for output in through.outputs)
        with torch.enable_grad():
            parts = self._call(partial(losses_of, outputs=outputs), leaves, fixed, given, batch)
            slopes = torch.autograd.grad(parts["loss"], [*outputs, *leaves.values()])
        found = dict(zip(leaves, slopes[len(outputs) :], strict=True))
        found |= through.gradients(*slopes[: len(outputs)])
        return found, {key: value.detach() for key, value in parts.items()}

    def backward(self, loss: Tensor, *args: Any, **kwargs: Any) -> None:
        """The gradients are known already."""
        for key, parameter in self._table("weight").items():
            parameter.grad = self._gradients[key]

    def validation_step(self, batch: Batch, batch_idx: int) -> None:
        losses = self.each(losses_of, batch)["loss"]
        self.validation_losses = losses.detach()
        self.log("loss/validation", losses.mean().detach(), batch_size=batch["v"].shape[-2])

    def configure_optimizers(self):
        return self._optimizer_of(self._table("weight").items(), self.template.own)  # type: ignore[arg-type]

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
        if getattr(self.template, "law_parameters", None) is None:
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
        from . import rebuilt

        made = []
        for k, hparams in enumerate(self.hparams["members"]):
            model = rebuilt(hparams)
            state = {**self._table("weight"), **self._table("buffer")}
            model.load_state_dict({key: state[key][k] for key in model.state_dict()})
            made.append(model.to(next(iter(self.parameters())).device).eval())
        return made


@lru_cache(maxsize=1)
def _workers(count: int) -> ThreadPoolExecutor:
    """So many threads, each computing alone."""
    return ThreadPoolExecutor(count, initializer=torch.set_num_threads, initargs=(1,))


def losses_of(model: FrictionModel, batch: Batch, **known: Any) -> dict[str, Tensor]:
    """Terms of a member's loss."""
    return model.losses(batch, **known)


def stacked(tables: list[dict[str, Tensor]]) -> dict[str, Tensor]:
    return {key: torch.stack([table[key] for table in tables]) for key in tables[0]}
