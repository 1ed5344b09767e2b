"""Inputs of the networks: signals of the contact, each seen through short causal windows."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..errors import UserError, choose

ODD = {"v_slip": -1.0, "normal_force": 1.0, "a_frictionless": -1.0}
Window = tuple[tuple[int, int], ...]


@dataclass(frozen=True)
class Features:
    """Which signals a network sees, and how much of their past.

    A window (W, n) stands for the n + 1 coefficients of the least-squares polynomial of degree n through the last W
    samples, in time counted back from the newest one (in units of the window's length): its value, slope, curvature
    now. (1, 0) is the newest sample itself. Every feature is linear in the signal, so the same operation on the
    signals' rates gives the features' time derivative.

    Attributes:
        inputs: names of signals, of ``v_slip``, ``normal_force`` (its magnitude), ``a_frictionless``.
        windows: for each input its windows.
    """

    inputs: tuple[str, ...]
    windows: dict[str, Window]

    @classmethod
    def from_config(cls, inputs, windows) -> Features:
        """Check and build from plain configuration values (lists)."""
        if isinstance(inputs, str) or not inputs:
            raise UserError("no inputs", where="model.inputs", received=inputs, allowed=f"a list of {', '.join(ODD)}")
        table: dict[str, Window] = {}
        for name in inputs:
            choose(name, ODD, "model.inputs")
            specs = windows.get(name, [[1, 0]])
            if not isinstance(specs, list | tuple):
                raise UserError(
                    "no windows", where=f"model.windows.{name}", received=repr(specs), allowed="a list such as [[1, 0]]"
                )
            table[name] = tuple(_window(spec, name) for spec in specs)
        return cls(tuple(inputs), table)

    @cached_property
    def odd(self) -> np.ndarray:
        """-1 for each feature that changes sign when the motion is mirrored, +1 for the others; shape (d,)."""
        signs = [ODD[name] for name in self.inputs for _, degree in self.windows[name] for _ in range(degree + 1)]
        return np.array(signs)

    @property
    def length(self) -> int:
        """Samples that the longest window needs."""
        return max(w for specs in self.windows.values() for w, _ in specs)

    def __call__(self, t: np.ndarray, signals: dict[str, np.ndarray]) -> np.ndarray:
        """Return the features, shape (n, d), of signals of shape (n,) at times ``t``."""
        columns = [
            local_polynomial(t, signals[name], w, degree) for name in self.inputs for w, degree in self.windows[name]
        ]
        return np.concatenate(columns, axis=1)


def _window(spec, name: str) -> tuple[int, int]:
    """(samples, degree) of a configured window, checked."""
    numbers = [item for item in spec if isinstance(item, int)] if isinstance(spec, list | tuple) else []
    if len(numbers) != 2 or numbers[0] < 1 or not 0 <= numbers[1] < numbers[0]:
        raise UserError(
            "impossible window",
            where=f"model.windows.{name}",
            received=spec,
            allowed="a list of [samples >= 1, degree from 0 to samples - 1]",
            fix="lower the degree or lengthen the window",
        )
    return numbers[0], numbers[1]


def local_polynomial(t: np.ndarray, values: np.ndarray, window: int, degree: int) -> np.ndarray:
    """Coefficients, shape (n, degree + 1), of the least-squares polynomial through the last ``window`` samples.

    Before the trial's first sample the signal is taken to have had its first value. Time runs in units of the
    window's length, so all coefficients have the signal's unit. Sampling need not be uniform.
    """
    if window == 1:
        return values[:, None].astype(float)
    index = np.arange(len(t))[:, None] - np.arange(window)[None]
    past = values[np.maximum(index, 0)]
    step = np.diff(t)
    span = window * float(np.median(step))
    if np.allclose(step, step[0], rtol=1e-4):
        design = np.vander(-np.arange(window) / window, degree + 1, increasing=True)
        return past @ np.linalg.pinv(design).T
    offset = (t[np.maximum(index, 0)] + np.minimum(index, 0) * span / window - t[:, None]) / span
    design = offset[..., None] ** np.arange(degree + 1)
    return np.einsum("nkw,nw->nk", np.linalg.pinv(design), past)
