"""Optimizers of the networks, from plain configuration values."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import torch
from torch import nn

from ..errors import UserError, choose


class AdamThenLBFGS(torch.optim.LBFGS):
    """Adam for the first ``adam_steps`` steps, then L-BFGS with a strong Wolfe line search.

    Each call of :meth:`step` is one step of the method whose turn it is; the state of both is saved.
    """

    def __init__(self, groups: list[dict[str, Any]], adam_steps: int, history_size: int = 20, max_iter: int = 5):
        flat = [p for group in groups for p in group["params"]]
        super().__init__(flat, lr=1.0, max_iter=max_iter, history_size=history_size, line_search_fn="strong_wolfe")
        self.adam = torch.optim.Adam(groups)
        self.adam_steps, self.count = adam_steps, 0

    @property
    def active(self) -> torch.optim.Optimizer:
        """The method that made the last step."""
        return self.adam if self.count <= self.adam_steps else self

    def step(self, closure):  # type: ignore[override]
        self.count += 1
        if self.count <= self.adam_steps:
            return self.adam.step(closure)
        return super().step(closure)

    def zero_grad(self, set_to_none: bool = True) -> None:
        super().zero_grad(set_to_none)

    def state_dict(self) -> dict[str, Any]:
        return {**super().state_dict(), "adam": self.adam.state_dict(), "count": self.count}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        state = dict(state_dict)
        self.adam.load_state_dict(state.pop("adam"))
        self.count = int(state.pop("count"))
        super().load_state_dict(state)


def one_cycle(step: int, steps: int, warmup: float) -> float:
    """Share of the step size: a cosine from 0.04 up to 1 over the first ``warmup`` of the steps, one down to 1e-4.

    A function of the step alone, so that a resumed training may have another length than the interrupted one.
    Source: Smith and Topin, Super-convergence (2018).
    """
    rise = max(warmup * steps, 1.0)
    low, place = (0.04, step / rise - 1) if step < rise else (1e-4, (step - rise) / max(steps - rise, 1.0))
    return low + (1 - low) * (1 + math.cos(math.pi * min(abs(place), 1.0))) / 2


def _adam(groups, steps, config):
    return torch.optim.Adam(groups, weight_decay=0.0)


def _plateau(groups, steps, config):
    optimizer = torch.optim.Adam(groups)
    schedule = torch.optim.lr_scheduler.ReduceLROnPlateau(
        optimizer,
        factor=config.get("factor", 0.5),
        patience=config.get("patience", 200),
        min_lr=config.get("min_lr", 1e-5),
    )
    return {
        "optimizer": optimizer,
        "lr_scheduler": {"scheduler": schedule, "interval": "epoch", "monitor": "loss/training"},
    }


def _onecycle(groups, steps, config):
    optimizer = torch.optim.AdamW(groups, weight_decay=config.get("weight_decay", 0.0))
    schedule = torch.optim.lr_scheduler.LambdaLR(optimizer, partial(one_cycle, steps=steps, warmup=config["warmup"]))
    return {"optimizer": optimizer, "lr_scheduler": {"scheduler": schedule, "interval": "step"}}


def _lbfgs(groups, steps, config):
    share = float(config.get("adam_share", 0.8))
    return AdamThenLBFGS(
        groups, int(share * steps), int(config.get("history_size", 20)), int(config.get("max_iter", 5))
    )


OPTIMIZERS: dict[str, Callable] = {
    "adam": _adam,
    "adam_plateau": _plateau,
    "adam_onecycle": _onecycle,
    "adam_lbfgs": _lbfgs,
}


def build_optimizer(config: dict[str, Any], weights: list[nn.Parameter], physical: list[nn.Parameter], steps: int):
    """Return what Lightning's ``configure_optimizers`` may return.

    Args:
        config: ``name`` (see ``OPTIMIZERS``), ``lr`` of the network, ``lr_physical`` of the law's parameters (their
            logarithms; None: the same), and the method's own options.
        weights, physical: the two groups of parameters.
        steps: number of steps of the whole training.

    Raises:
        UserError: unknown name, a step size that is not positive.
    """
    make = choose(config["name"], OPTIMIZERS, "optimizer")
    lr = config["lr"]
    lr_physical = config.get("lr_physical") or lr
    for key, value in (("lr", lr), ("lr_physical", lr_physical)):
        if isinstance(value, bool) or not isinstance(value, int | float) or not value > 0:
            raise UserError(
                "step size must be positive", where=f"optimizer.{key}", received=repr(value), allowed="above 0"
            )
    groups: list[dict[str, Any]] = [{"params": weights, "lr": float(lr)}]
    if physical:
        groups.append({"params": physical, "lr": float(lr_physical)})
    try:
        return make(groups, steps, config)
    except ValueError as error:
        options = {key: value for key, value in config.items() if key != "name"}
        raise UserError("impossible option", where="optimizer", received=options, fix=str(error)) from error
