"""Measurement noise added to a recording's signals, reproducible from one seed.

A call ``noise(recording, seed)`` returns the noisy recording; ``t`` and ``truth`` stay as they were. The random stream
of a signal depends on the seed and on the names of its trial and of itself alone, so that it does not change when
trials or signals are added, dropped or reordered.
"""

from __future__ import annotations

import zlib
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from frictionpinn.data.recording import Recording
from frictionpinn.errors import UserError


def stream(seed: int, *names: str) -> np.random.Generator:
    """Return the random generator that belongs to ``seed`` and ``names``.

    The names enter ``numpy.random.SeedSequence`` by their CRC-32, which unlike ``hash`` is the same in every process.

    Raises:
        UserError: ``seed`` is negative or not an integer.
    """
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
        raise UserError("invalid seed", where="seed", received=repr(seed), allowed="an integer of at least 0")
    return np.random.default_rng(np.random.SeedSequence([int(seed), *(zlib.crc32(name.encode()) for name in names)]))


def check_levels(sigmas: Mapping[str, float]) -> None:
    """Raise :class:`UserError` for a noise level, signal -> standard deviation, SI units, that no sensor has."""
    for name, sigma in sigmas.items():
        if not 0 < sigma < np.inf:
            raise UserError("impossible noise level", where=f"sigmas.{name}", received=sigma,
                            allowed="a standard deviation above 0, SI units",
                            fix="leave it out where it is not known: it is estimated")  # fmt: skip


def pooled(recording: Recording) -> dict[str, np.ndarray]:
    """Return each signal's samples of all trials together: name -> array of shape (sum of trial lengths,)."""
    names = dict.fromkeys(name for trial in recording.trials for name in trial.signals)
    return {
        name: np.concatenate([trial.signals[name] for trial in recording.trials if name in trial.signals])
        for name in names
    }


def _require(ok: bool, what: str, where: str, received: object, allowed: str) -> None:
    if not ok:
        raise UserError(what, where=where, received=received, allowed=allowed)


class Noise(ABC):
    """Common call of the noise models."""

    @abstractmethod
    def levels(self, recording: Recording) -> dict[str, float]:
        """Return the noise's standard deviation per signal of the noise-free ``recording``, SI units."""

    @abstractmethod
    def __call__(self, recording: Recording, seed: int) -> Recording:
        """Return ``recording`` with noise on every signal of every trial.

        Raises:
            UserError: ``seed`` is negative or not an integer.
        """


@dataclass(frozen=True)
class NoNoise(Noise):
    """Leaves the recording as it is."""

    def levels(self, recording: Recording) -> dict[str, float]:
        return dict.fromkeys(pooled(recording), 0.0)

    def __call__(self, recording: Recording, seed: int) -> Recording:
        return recording


@dataclass(frozen=True)
class GaussianNoise(Noise):
    """Additive white Gaussian noise in proportion to each signal's spread.

    ``y = x + level * std(x) * e`` with ``e ~ N(0, 1)``, independent per trial, signal and sample; ``std(x)`` is the
    population standard deviation of the signal over all trials of the recording together. NaN samples stay NaN.

    Args:
        level: noise standard deviation relative to the signal's, dimensionless.

    Raises:
        UserError: ``level`` is negative or not finite.
    """

    level: float = 0.05

    def __post_init__(self) -> None:
        _require(0 <= self.level < np.inf, "invalid noise level", "level", self.level, "0 or above, 0.05 for 5 %")

    def levels(self, recording: Recording) -> dict[str, float]:
        return self._gaussian(recording)

    def _gaussian(self, recording: Recording) -> dict[str, float]:
        return {name: self.level * float(np.nanstd(values)) for name, values in pooled(recording).items()}

    def _draw(self, generator: np.random.Generator, n: int) -> np.ndarray:
        return generator.standard_normal(n)

    def __call__(self, recording: Recording, seed: int) -> Recording:
        spread = self._gaussian(recording)
        trials = []
        for trial in recording.trials:
            noisy = {
                name: values + spread[name] * self._draw(stream(seed, trial.name, name), len(values))
                for name, values in trial.signals.items()
            }
            trials.append(replace(trial, signals=noisy))
        return replace(recording, trials=tuple(trials))


@dataclass(frozen=True)
class QuantisedNoise(GaussianNoise):
    """Gaussian noise, then rounding to the step of an analogue-to-digital converter.

    ``y = step * round((x + e) / step)`` with ``step = (max(x) - min(x)) / 2**bits`` over the recording, or as given.
    :meth:`levels` adds the rounding error's variance ``step**2 / 12`` (Widrow and Kollár, *Quantization Noise*, 2008).

    Args:
        level: as in :class:`GaussianNoise`.
        bits: resolution of the converter over the signal's range.
        step: signal name -> step in the signal's SI unit; signals that it names do not use ``bits``.

    Raises:
        UserError: ``bits`` is outside 1 to 32, or a step is not above 0.
    """

    bits: int = 12
    step: Mapping[str, float] | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        _require(1 <= self.bits <= 32, "invalid resolution", "bits", self.bits, "1 to 32")
        for name, value in (self.step or {}).items():
            _require(0 < value < np.inf, "invalid quantisation step", f"step.{name}", value, "above 0")

    def steps(self, recording: Recording) -> dict[str, float]:
        """Return the rounding step per signal, SI units; 0 for a constant signal.

        Raises:
            UserError: ``step`` names a signal that the recording lacks.
        """
        signals, given = pooled(recording), dict(self.step or {})
        for name in given:
            _require(name in signals, "unknown signal", "step", name, ", ".join(signals))
        return {
            name: given.get(name, float(np.nanmax(values) - np.nanmin(values)) / 2**self.bits)
            for name, values in signals.items()
        }

    def levels(self, recording: Recording) -> dict[str, float]:
        steps = self.steps(recording)
        return {name: float(np.hypot(std, steps[name] / 12**0.5)) for name, std in self._gaussian(recording).items()}

    def __call__(self, recording: Recording, seed: int) -> Recording:
        steps, noisy = self.steps(recording), super().__call__(recording, seed)
        trials = (
            replace(trial, signals={k: _round(values, steps[k]) for k, values in trial.signals.items()})
            for trial in noisy.trials
        )
        return replace(noisy, trials=tuple(trials))


@dataclass(frozen=True)
class OutlierNoise(GaussianNoise):
    """Gaussian noise of which some samples are outliers (Tukey's contaminated normal distribution).

    A sample's noise is ``scale`` times larger with probability ``fraction``; its standard deviation is therefore
    ``level * std(x) * sqrt(1 - fraction + fraction * scale**2)``.

    Args:
        level: as in :class:`GaussianNoise`.
        fraction: probability of an outlier, 0 to 1.
        scale: factor on the noise of an outlier, dimensionless.

    Raises:
        UserError: ``fraction`` or ``scale`` is out of range.
    """

    fraction: float = 0.01
    scale: float = 10.0

    def __post_init__(self) -> None:
        super().__post_init__()
        _require(0 <= self.fraction <= 1, "invalid fraction of outliers", "fraction", self.fraction, "0 to 1")
        _require(0 < self.scale < np.inf, "invalid scale of outliers", "scale", self.scale, "above 0")

    def levels(self, recording: Recording) -> dict[str, float]:
        factor = (1 - self.fraction + self.fraction * self.scale**2) ** 0.5
        return {name: factor * std for name, std in self._gaussian(recording).items()}

    def _draw(self, generator: np.random.Generator, n: int) -> np.ndarray:
        noise = generator.standard_normal(n)
        return np.where(generator.random(n) < self.fraction, self.scale * noise, noise)


def _round(values: np.ndarray, step: float) -> np.ndarray:
    return step * np.round(values / step) if step > 0 else values
