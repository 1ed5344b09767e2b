"""From a recording to trial models: windows, noise levels, noisy inputs, start values of the initial states."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import sympy as sp

from ..data.recording import Recording, Trial
from ..errors import UserError
from ..numerics.paths import DEGREE, InputPath
from ..numerics.simulate import Simulator
from ..numerics.smoothing import difference_sigma
from ..numerics.spline_basis import PathBasis, choose_basis
from ..physics.mechanism import Mechanism
from .trial import NoisyInput, TrialModel

MOST_COEFFICIENTS = 150  # of one input in one window; a signal that needs more is interpolated as measured
MOST_OF_A_MOTION = 300  # the same for a driven coordinate
LONGEST_S_SAMPLES = 4000  # a trial with more samples is cut into windows of about half as many
REST = 4.0  # standard errors: a smoothed initial velocity below counts as rest, where the search starts


@dataclass(frozen=True)
class Channels:
    """Which recorded signals a mechanism's model produces, and which drive it.

    Attributes:
        outputs: measured signal -> the model's name for it.
        motions: signals (position, velocity, acceleration) and places in u of every driven coordinate.
        plain: signal and place in u of every other input that acts.
    """

    outputs: dict[str, str]
    motions: tuple[tuple[tuple[str, ...], tuple[int, ...]], ...]
    plain: tuple[tuple[str, int], ...]

    @classmethod
    def of(cls, mechanism: Mechanism, recorded: set[str]) -> Channels:
        """Sort the recorded signals.

        Raises:
            UserError: nothing that the model predicts was measured, or nothing of a driven coordinate.
        """
        names = mechanism.input_signals
        outputs = {name: name for c in mechanism.free for name in c.signals if name in recorded}
        motions = tuple((c.signals, tuple(names.index(name) for name in c.signals)) for c in mechanism.driven)
        for signals, _ in motions:
            if not recorded.intersection(signals):
                raise UserError("missing input signal", where="recording", received=", ".join(sorted(recorded)),
                                allowed=f"at least one of {', '.join(signals)}", 
                                fix="record the driven coordinate")  # fmt: skip
        plain: list[tuple[str, int]] = []
        if mechanism.system.massless:
            shown = {item.name: item.name if mechanism.effects else "F" for item in mechanism.system.inputs}
            outputs = {name: key for name, key in shown.items() if name in recorded}
        else:
            acting = set().union(*(sp.sympify(row).free_symbols for row in mechanism.residuals))
            plain = [
                (item.name, names.index(item.name))
                for item in mechanism.system.inputs
                if item.symbol in acting and item.name in recorded
            ]
        if not outputs:
            wanted = [name for c in mechanism.free for name in c.signals] or [i.name for i in mechanism.system.inputs]
            raise UserError("nothing to compare the model with", where="recording",
                            received=", ".join(sorted(recorded)),
                            allowed=f"at least one of {', '.join(wanted)}")  # fmt: skip
        return cls(outputs, motions, tuple(plain))

    @property
    def input_names(self) -> tuple[str, ...]:
        """Signals of all inputs."""
        return (*(name for signals, _ in self.motions for name in signals), *(name for name, _ in self.plain))


def windows_of(recording: Recording, length_s: float | None) -> list[Trial]:
    """Cut every trial into equal windows of about ``length_s``; without it, only trials that are very long."""
    result = []
    for trial in recording.trials:
        span = trial.t[-1] - trial.t[0]
        count = round(span / length_s) if length_s else (
            1 if len(trial) <= LONGEST_S_SAMPLES else -(-2 * len(trial) // LONGEST_S_SAMPLES)
        )  # fmt: skip
        edges = np.linspace(0, len(trial), max(count, 1) + 1).round().astype(int)
        for k, (first, end) in enumerate(pairwise(edges)):
            if end - first < DEGREE + 3:
                raise UserError("window too short", where="windows", received=f"{end - first} samples",
                                allowed=f"at least {DEGREE + 3} samples", fix="lengthen the windows")  # fmt: skip
            name = trial.name if count <= 1 else f"{trial.name}[{k}]"
            signals = {key: np.asarray(values, float)[first:end] for key, values in trial.signals.items()}
            t, start = np.ascontiguousarray(trial.t[first:end], dtype=float), trial.start_at(first)
            result.append(Trial(name, t, signals, {}, start, trial.number))
    return result


def difference_sigmas(trials: list[Trial], names: list[str]) -> dict[str, float]:
    """Noise standard deviations by differences, pooled over trials."""
    result = {}
    for name in names:
        pairs = [(trial.t, trial.signals[name]) for trial in trials if name in trial.signals]
        result[name] = difference_sigma(pairs) or 1e-9
    return result


@dataclass(frozen=True)
class Builder:
    """Makes trial models; ``initial`` says which initial states are unknown ("free" or "rest")."""

    simulator: Simulator
    channels: Channels
    sigmas: Mapping[str, float]
    initial: str
    noisy: bool

    def model(self, trial: Trial) -> TrialModel:
        """Return the model of one trial or window, its inputs smoothed."""
        mechanism, t = self.simulator.mechanism, trial.t
        coefficients = np.zeros((len(t) - 1, len(mechanism.input_signals), DEGREE + 1))
        noisy: list[NoisyInput] = []
        for signals, columns in self.channels.motions:
            item = self._motion(trial, signals, columns)
            if item is not None:
                noisy.append(item)
            else:
                path = InputPath.from_signals(mechanism, t, self._zeros(trial) | _named(trial, signals))
                coefficients[:, list(columns)] = path.coefficients[:, list(columns)]
        for name, column in self.channels.plain:
            item = self._plain(trial, name, column) if self.noisy else None
            if item is not None:
                noisy.append(item)
            elif name in trial.signals:
                path = InputPath.from_signals(mechanism, t, self._zeros(trial) | {name: trial.signals[name]})
                coefficients[:, column] = path.coefficients[:, column]
        bases = {name: _smooth(trial, name, self.sigmas) for name in self.channels.outputs}
        start = self._start(bases)
        states = tuple(name for name in self.simulator.state_names if self._unknown(name))
        known = {name: value for name, value in start.items() if name != "z" or "z" in states}
        return TrialModel(
            self.simulator, trial.name, t, self.channels.outputs, _rows(trial, self.channels.outputs),
            InputPath(mechanism.input_signals, t, coefficients, trial.session), tuple(noisy), states, known,
        )  # fmt: skip

    def _zeros(self, trial: Trial) -> dict[str, np.ndarray]:
        driven = [name for c in self.simulator.mechanism.driven for name in c.signals]
        return {name: np.zeros(len(trial.t)) for name in driven}

    def _motion(self, trial: Trial, signals: tuple[str, ...], columns: tuple[int, ...]) -> NoisyInput | None:
        """The spline of a driven coordinate; None where it needs many coefficients and all three signals are known."""
        y, sigmas = _rows(trial, signals), np.array([self.sigmas.get(name, 1.0) for name in signals])
        most = min(MOST_OF_A_MOTION, len(trial.t) // 2)
        basis = choose_basis(trial.t, y, sigmas, most)
        if basis is None and np.isfinite(y).all():
            return None
        basis = basis or PathBasis.evenly(trial.t, most - DEGREE, 3)
        return NoisyInput(signals, columns, basis, y, basis.fit(y, sigmas)[0])

    def _plain(self, trial: Trial, name: str, column: int) -> NoisyInput | None:
        if name not in trial.signals:
            return None
        y, sigmas = _rows(trial, (name,)), np.array([self.sigmas[name]])
        basis = choose_basis(trial.t, y, sigmas, min(MOST_COEFFICIENTS, len(trial.t) // 4))
        return None if basis is None else NoisyInput((name,), (column,), basis, y, basis.fit(y, sigmas)[0])

    def _unknown(self, state: str) -> bool:
        if self.initial == "free":
            return True
        return state in [c.signals[0] for c in self.simulator.mechanism.free]

    def _start(self, smooth: dict[str, tuple[float, float]]) -> dict[str, float]:
        start: dict[str, float] = {}
        for c in self.simulator.mechanism.free:
            q, v, _ = c.signals
            start[q] = smooth[q][0] if q in smooth else 0.0
            value, error = smooth.get(v, (0.0, 1.0))
            start[v] = value if abs(value) > REST * error and self.initial == "free" else 0.0
        if self.simulator.mechanism.memory:
            start["z"] = 0.0
        return start


def _named(trial: Trial, names: tuple[str, ...]) -> dict[str, np.ndarray]:
    return {name: np.asarray(trial.signals[name], float) for name in names}


def _rows(trial: Trial, names) -> np.ndarray:
    missing = np.full(len(trial.t), np.nan)
    return np.stack([np.asarray(trial.signals.get(name, missing), float) for name in names])


def _smooth(trial: Trial, name: str, sigmas: Mapping[str, float]) -> tuple[float, float]:
    """Value of a signal at the first sample, from a line through the first few, and its standard error."""
    t, y = trial.t[:5] - trial.t[0], trial.signals[name][:5]
    design = np.stack([np.ones(len(t)), t], axis=1)
    solution = np.linalg.lstsq(design, y, rcond=None)[0]
    spread = np.linalg.inv(design.T @ design)[0, 0] ** 0.5
    return float(solution[0]), float(sigmas[name] * spread)
