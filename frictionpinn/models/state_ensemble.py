"""Several networks with memory of one variant, trained side by side and used as one."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import torch

from ..data.contact import ContactTrial
from .base import Batch, FrictionModel
from .elements import StateFriction
from .ensemble import FrictionEnsemble, losses_of, stacked


class StateEnsemble(FrictionEnsemble):
    """N members with a state; member k takes the steps that it would take alone.

    The recursion along a trial is compiled and no operation of torch's, so members are not batched: each is computed in
    its turn, on as many threads as torch has. In simulation their mean is a network with the bristles of all members,
    each with an N-th of its force.

    Args:
        members: models with a state, trained on the same samples; see :class:`.ensemble.FrictionEnsemble`.
    """

    numbers = torch.float64  # as alone, where they are Python's

    def _gradients_of(self, weights: dict, rest: dict, numbers: dict, batch: Batch) -> tuple[dict, dict]:
        def one(k: int) -> tuple[dict, dict]:
            own, fixed, given = self._of_member(k, weights, rest, numbers)
            leaves = {key: value.requires_grad_() for key, value in own.items()}
            with torch.enable_grad():
                parts = self._call(losses_of, leaves, fixed, given, batch)
                slopes = torch.autograd.grad(parts["loss"], list(leaves.values()))
            return dict(zip(leaves, slopes, strict=True)), {key: value.detach() for key, value in parts.items()}

        found = self._in_turn(one)
        return stacked([item[0] for item in found]), stacked([item[1] for item in found])

    def _call(self, what: Callable, weights: dict, rest: dict, numbers: dict, batch: Batch) -> Any:
        plain = {key: float(value) for key, value in numbers.items()}
        return super()._call(what, weights, rest, plain, batch)

    def each(self, what: Callable[[FrictionModel, Batch], dict], batch: Batch) -> dict:
        """``what(member, batch)`` of all members, stacked along the first axis."""
        tables = self._table("weight"), self._table("buffer"), self._table("number")

        def one(k: int) -> dict:
            own, fixed, given = self._of_member(k, *tables)
            return self._call(what, own, fixed, given, batch)

        return stacked([one(k) for k in range(self.size)])

    def arrays(self, trial: ContactTrial, source: str = "online") -> dict[str, np.ndarray]:
        return self.template.arrays(trial, source)

    def friction(self) -> StateFriction:
        """The mean of the members as plain numbers: T of all their bristles, and the mean of what is left beside."""
        members = [member.friction() for member in self.members()]  # type: ignore[operator]
        tables = [*(own.tables[:-1] for own in members), np.mean([own.tables[-1:] for own in members], axis=0)]
        share = np.array([1 / self.size, 1 / self.size, 1.0, 1.0])[:, None]  # of kappa and c, not of gap and n
        elements = np.concatenate([share * own.elements for own in members], axis=1)
        return StateFriction(np.concatenate(tables), members[0].grid, np.ascontiguousarray(elements))
