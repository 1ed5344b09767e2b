"""The recursions of :mod:`.state_recursions` as one differentiable operation of torch."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from .state_recursions import backward, forward


@dataclass(frozen=True)
class Drive:
    """What drives the elements along trials that follow one another, float64 arrays of shape (n,).

    Attributes:
        v: slip velocity, which the contact has (imposed) or is corrected to.
        N: load.
        h: time to the next sample, s.
        start: share by which slip velocity and states start anew: 1 where a trial begins, 0 where nothing starts.
        gate: share of the correction, 0 to 1.
        mobility: slip acceleration per force; 0: the slip velocity is imposed.
        steps: per sample.
        u, slopes: slip velocity of the motion along which the slip acceleration without friction is given, and slopes
            of that in slip position and slip velocity, shape (n, 2), where the motion acts back on it.
    """

    v: np.ndarray
    N: np.ndarray
    h: np.ndarray
    start: np.ndarray
    gate: np.ndarray
    mobility: float
    steps: int
    u: np.ndarray | None = None
    slopes: np.ndarray | None = None

    def along(self, A: np.ndarray) -> tuple[np.ndarray, ...]:
        """What forward and backward take of it at every sample."""
        u = self.v if self.u is None else self.u
        slopes = np.zeros((len(self.v), 2)) if self.slopes is None else self.slopes
        return self.v, self.N, A, self.h, self.start, self.gate, u, slopes


class Recursion(torch.autograd.Function):
    """(z0, tables, elements, gain, A: slip acceleration without friction, off: of velocity and position at starts) ->
    force, slip velocity (n,), states (n, K), slip position off that of the motion it is along (n,); float64. It runs on
    the CPU; its result lies where A does."""

    @staticmethod
    def forward(
        ctx, z0: Tensor, tables: Tensor, elements: Tensor, gain: Tensor, A: Tensor, off: Tensor, grid, drive: Drive
    ):
        known = [
            np.ascontiguousarray(value.detach().cpu().numpy(), dtype=float) for value in (z0, tables, elements, A, off)
        ]
        share, moving = float(gain), drive.mobility > 0
        path = np.empty((len(drive.v) * drive.steps, 2 + known[0].shape[1]))
        rest = (grid, known[2], share, drive.mobility, drive.steps, moving, path)
        force, slip, states, left, reached = forward(drive.along(known[3]), known[0], known[4], known[1], *rest)
        ctx.kept = drive, known, rest, (slip, states, reached)
        ctx.like = [(value.dtype, value.device) for value in (z0, tables, elements, gain, A, off)]
        told = tuple(torch.from_numpy(value).to(A.device) for value in (force, slip, states, left))
        ctx.mark_non_differentiable(told[2])
        return told

    @staticmethod
    def backward(ctx, *bars):
        drive, (z0, tables, elements, A, _), (grid, *_, share, mobility, steps, moving, path), told = ctx.kept
        f_bar, v_bar, left_bar = (np.ascontiguousarray(bars[k].cpu().numpy()) for k in (0, 1, 3))
        rest = (grid, elements, share, mobility, steps, moving, path)
        found = backward(f_bar, v_bar, left_bar, drive.along(A), z0, tables, *rest, told)
        slopes = [
            torch.as_tensor(value, dtype=t, device=device) for value, (t, device) in zip(found, ctx.like, strict=True)
        ]
        return (*slopes, None, None)
