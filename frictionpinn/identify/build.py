"""From a trial of a recording to its model: channels, noisy inputs, start values of the initial states."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import sympy as sp

from ..data.recording import Trial
from ..errors import UserError
from ..numerics.jumps import beside_jumps
from ..numerics.paths import DEGREE, InputPath
from ..numerics.placing import unplaced
from ..numerics.simulate import Simulator
from ..numerics.spline_basis import NoisyInput, PathBasis, choose_basis
from ..physics.mechanism import Mechanism
from .trial import TrialModel

MOST_COEFFICIENTS = 150  # of one input in one window; a signal that needs more is interpolated as measured
MOST_OF_A_MOTION = 300  # the same for a driven coordinate
REST = 4.0  # standard errors: a smoothed initial velocity below counts as rest, where the search starts
FIRST_SAMPLES = 5  # through which a line tells the initial state


@dataclass(frozen=True)
class Channels:
    """Which recorded signals a mechanism's model produces, and which drive it.

    Attributes:
        outputs: measured signals that the model predicts.
        motions: signals (position, velocity, acceleration) and places in u of every driven coordinate.
        plain: signal and place in u of every other input that acts.
    """

    outputs: tuple[str, ...]
    motions: tuple[tuple[tuple[str, ...], tuple[int, ...]], ...]
    plain: tuple[tuple[str, int], ...]

    @classmethod
    def of(cls, mechanism: Mechanism, recorded: set[str]) -> Channels:
        """Sort the recorded signals.

        Raises:
            UserError: nothing that the model predicts was measured, or nothing of a driven coordinate.
        """
        names = mechanism.input_signals
        outputs = tuple(name for name in mechanism.predictions if name in recorded)
        motions = tuple((c.signals, tuple(names.index(name) for name in c.signals)) for c in mechanism.driven)
        needed = [(f"nothing of {c.name} was recorded", (*c.signals,)) for c in mechanism.system.moving]
        for lack, own in (*needed, ("nothing to compare the model with", (*mechanism.predictions,))):
            if not recorded.intersection(own):
                raise UserError(lack, where="recording", received=", ".join(sorted(recorded)),
                                allowed=f"at least one of {', '.join(own)}")  # fmt: skip
        acting = set().union(*(sp.sympify(row).free_symbols for row in mechanism.residuals))
        inputs = [item.name for item in mechanism.system.inputs if item.symbol in acting]
        plain = tuple((name, names.index(name)) for name in inputs if name in recorded and name not in outputs)
        return cls(outputs, motions, plain)

    @property
    def input_names(self) -> tuple[str, ...]:
        """Signals of all inputs."""
        return (*(name for signals, _ in self.motions for name in signals), *(name for name, _ in self.plain))


def trial_model(
    trial: Trial, simulator: Simulator, channels: Channels, sigmas: Mapping[str, float], rest: bool, noisy: bool
) -> TrialModel:
    """The model of one trial or window.

    The motion of a driven coordinate is always a spline, whose knots suit its noise, unless that takes very many
    coefficients and all three of its signals were measured; other inputs only where they are taken as noisy.

    Args:
        trial, simulator, channels: what was measured, of which mechanism, and which signals count.
        sigmas: signal -> noise standard deviation, SI units.
        rest: whether the trial starts at rest; else its initial velocities and bristle state are unknown, too.
        noisy: whether other inputs than motions are splines.
    """
    mechanism, t = simulator.mechanism, np.array(trial.t, dtype=float)  # a copy: compiled code wants to own it
    missing = np.full(len(t), np.nan)

    def measured(names: tuple[str, ...]) -> np.ndarray:
        return np.stack([np.asarray(trial.signals.get(name, missing), float) for name in names])

    inputs: list[NoisyInput] = []
    coefficients = np.zeros((len(t) - 1, len(mechanism.input_signals), DEGREE + 1))
    still = {name: np.zeros(len(t)) for c in mechanism.driven for name in c.signals}
    motions = [(names, columns, min(MOST_OF_A_MOTION, len(t) // 2)) for names, columns in channels.motions]
    plain = [((name,), (column,), min(MOST_COEFFICIENTS, len(t) // 4)) for name, column in channels.plain]
    for names, columns, most in (*motions, *plain):
        motion, y, basis = len(names) > 1, measured(names), None
        if motion:
            y = anchored(y)
        levels = np.array([sigmas.get(name, 1.0) for name in names])
        if not np.isfinite(y).any():
            continue
        if motion or noisy:
            basis = choose_basis(t, y, levels, most)
        if motion and basis is None and not np.isfinite(y).all():
            basis = PathBasis.evenly(t, most - DEGREE, len(names))
        if basis is not None:
            inputs.append(NoisyInput(names, columns, basis, y, basis.fit(y, levels)[0]))
        else:
            path = InputPath.from_signals(mechanism, t, still | dict(zip(names, y, strict=True)))
            coefficients[:, list(columns)] = path.coefficients[:, list(columns)]

    start: dict[str, float] = {}
    for c in mechanism.free:
        first = dict.fromkeys(c.signals[:2], (0.0, np.inf))  # value, standard error
        for name in set(c.signals[:2]) & set(trial.signals):
            at = np.flatnonzero(np.isfinite(trial.signals[name]))[:FIRST_SAMPLES]
            if len(at) < 2:
                continue
            times, y = t[at] - t[0], trial.signals[name][at]
            design = np.stack([np.ones(len(times)), times], axis=1)
            spread = np.linalg.inv(design.T @ design)[0, 0] ** 0.5
            first[name] = float(np.linalg.lstsq(design, y, rcond=None)[0][0]), float(sigmas[name] * spread)
        (position, _), (velocity, error) = first.values()
        start |= {c.signals[0]: position, c.signals[1]: velocity if not rest and abs(velocity) > REST * error else 0.0}
    if not rest:
        start |= dict.fromkeys(simulator.bristles, 0.0)
    positions = [c.signals[0] for c in mechanism.free]
    acting = [c.signals[0] for c in unplaced(mechanism.system, set(trial.signals))]
    y = measured(channels.outputs)
    if not all(contact.law.memory for contact in mechanism.contacts):
        for row, name in zip(y, channels.outputs, strict=True):
            if name in {c.signals[2] for c in mechanism.free}:
                row[beside_jumps(row, sigmas[name])] = np.nan
    silent = [n for n in positions if n not in trial.signals and n not in acting]  # nothing tells it: it begins at 0
    return TrialModel(
        simulator, trial.name, t, channels.outputs, y,
        InputPath(mechanism.input_signals, t, coefficients, trial.session), tuple(inputs),
        tuple(n for n in simulator.state_names if (not rest or n in positions) and n not in silent), start,
    )  # fmt: skip


def anchored(y: np.ndarray) -> np.ndarray:
    """A motion, shape (3, n), that begins at 0 in what no lower derivative tells: positions of velocities alone."""
    measured = np.isfinite(y).any(axis=1)
    if measured.any() and not measured[0]:
        y[: int(np.argmax(measured)), 0] = 0.0
    return y
