"""Trials and recordings: what a mechanism did, as arrays in SI units."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np


@dataclass(frozen=True)
class Trial:
    """One uninterrupted run of a mechanism.

    Attributes:
        name: what identifies it among its recording's trials ("1", "0.25Hz_30lb_0.5in").
        t: time, s, shape (n,), strictly increasing, not necessarily uniform.
        signals: name -> array of shape (n,), SI units.
        truth: noise-free signals and forces of simulated data, for scoring alone; empty for measured data.
    """

    name: str
    t: np.ndarray
    signals: dict[str, np.ndarray]
    truth: dict[str, np.ndarray] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.t)

    def with_signals(self, **signals: np.ndarray) -> Trial:
        """Return a copy in which the given signals are added or replaced."""
        return replace(self, signals={**self.signals, **signals})


@dataclass(frozen=True)
class Recording:
    """Several trials of one mechanism.

    Attributes:
        trials: in the order of the file.
        units: signal name -> SI unit as text ("m/s").
        source: where it came from, for reports.
        checksum: sha256 of the data, for ``result.json``.
    """

    trials: tuple[Trial, ...]
    units: dict[str, str]
    source: str = ""
    checksum: str = ""

    @property
    def names(self) -> list[str]:
        """Names of the trials."""
        return [trial.name for trial in self.trials]

    def select(self, names: Iterable[str]) -> Recording:
        """Return the recording that holds only the named trials, in their original order."""
        wanted = {str(name) for name in names}
        return replace(self, trials=tuple(trial for trial in self.trials if trial.name in wanted))

    def __len__(self) -> int:
        return sum(len(trial) for trial in self.trials)
