"""Errors of what a simulation takes from the measured motion, unknowns of a training through the motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn


class InputErrors(nn.Module):
    """Errors of the frictionless acceleration along the training trials, where smoothing left some, and of the slip
    velocity at every start; where the acceleration depends on it, of the slip position too.

    Each unknown comes in units of its size, with a standard normal beforehand: white noise becomes an acceleration's
    error by the kernel that gives it the spectrum of what smoothing leaves, larger near the ends of a trial
    (:mod:`..data.input_noise`).

    Args:
        lengths: samples of every segment, by training trial.
        shape: kernel, shape (m,).
        ends: size near an end as a multiple of that further inside, by distance in samples.
        scales: input_error, start_error, first_error, start_time, step, input_step, see
            :func:`..data.input_noise.input_noise`.
    """

    kernel: Tensor
    between: Tensor
    share: Tensor
    size: Tensor
    sizes: Tensor

    def __init__(
        self,
        lengths: Sequence[Sequence[int]],
        shape: Sequence[float],
        ends: Sequence[float],
        scales: Mapping[str, float],
    ):
        super().__init__()
        kernel, near, count = torch.tensor(shape, dtype=torch.float64), np.array(ends), 0
        low, share, size = [], [], []
        for own in lengths:
            if scales["input_error"] > 0:
                place = np.arange(sum(own)) * scales["step"] / scales["input_step"]
                low.append(count + place.astype(int))
                share.append(place % 1)
                count += int(place[-1]) + 1 + len(kernel)  # the kernel's reach beyond the ends of a trial
            size.append(np.full(sum(own), scales["input_error"]))
            size[-1][: len(near)] *= near
            size[-1][sum(own) - len(near) :] *= near[::-1]
        known = {"size": size} | ({"between": low, "share": share} if low else {})
        tables = {name: torch.from_numpy(np.concatenate(value)) for name, value in known.items()}
        tables |= {"kernel": kernel, "sizes": torch.tensor([scales["first_error"], scales["start_error"]])}
        for name, table in tables.items():
            self.register_buffer(name, table, persistent=False)
        starts = sum(len(own) for own in lengths)
        self.time = scales.get("start_time", 0.0)
        self.inputs = nn.Parameter(torch.zeros(count))
        self.starts = nn.Parameter(torch.zeros(starts))
        self.places = nn.Parameter(torch.zeros(starts)) if self.time > 0 else None

    def along(self) -> Tensor:
        """Of the frictionless acceleration at every sample, shape (n,), m/s^2 or rad/s^2."""
        if not len(self.inputs):
            return self.size
        white = self.inputs.double()[None, None]
        ahead = nn.functional.conv1d(white, self.kernel[None, None])[0, 0]
        return self.size * ((1 - self.share) * ahead[self.between] + self.share * ahead[self.between + 1])

    def at_starts(self, anew: Tensor) -> Tensor:
        """Of slip velocity and slip position at every start, shape (starts, 2); ``anew``: share by which it starts from
        the measured ones, 1 at the first sample of a trial."""
        size = torch.where(anew == 1, self.sizes[0], anew * self.sizes[1])
        places = torch.zeros_like(size) if self.places is None else self.time * self.places.double()
        return size[:, None] * torch.stack([self.starts.double(), places], dim=1)

    def squares(self) -> Tensor:
        """Minus twice the logarithm of what is known of them beforehand."""
        found = self.inputs.square().sum() + self.starts.square().sum()
        return (found if self.places is None else found + self.places.square().sum()).double()

    @torch.no_grad()
    def forget(self) -> None:
        """No errors."""
        for p in self.parameters():
            p.zero_()


def of_training(state: Mapping[str, Any], scales: Mapping[str, float], through: str) -> InputErrors | None:
    """Errors over the training trials that ``state`` tells of, None where there are none."""
    known = through == "motion" and state.get("lengths") and scales["start_error"] > 0
    return InputErrors(state["lengths"], state["input_shape"], state["input_ends"], scales) if known else None
