"""Jumps of a sampled signal: where they are, and what one costs that comes some samples earlier or later."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

BESIDE = 2  # samples on either side of a jump that may fall into it: they seem to tell its time exactly
JUMP = 4.0  # standard errors by which a jump between two samples exceeds what the samples beside them suggest


def beside_jumps(y: np.ndarray, sigma: float) -> np.ndarray:
    """The samples on both sides of every jump of a signal, shape (n,), bool.

    Without memory the friction force jumps where a body stops or breaks away, and the acceleration with it. On which
    side of a sample that falls no model tells to a fraction of the interval, and a small change of its parameters
    changes nothing: such a sample costs a likelihood the whole jump, and would make a staircase of it.

    Args:
        y: samples, shape (n,).
        sigma: standard deviation of their noise.
    """
    result, at = np.zeros(len(y), bool), _jumps(y, JUMP * 5**0.5 * sigma)  # white noise makes sqrt(5) sigma
    result[at] = result[at + 1] = True
    return result


@dataclass(frozen=True)
class Jump:
    """An acceleration that jumps in a simulation, since a body stops, turns round or breaks away.

    Attributes:
        model, r: the acceleration, and the model less the measured one, zero where nothing was measured, over the
            noise, shape (n,) each.
        at: sample before the jump.
        slopes: derivatives of its time in what is unknown of the trial, in samples, shape (n_l,).
    """

    model: np.ndarray
    r: np.ndarray
    at: int
    slopes: np.ndarray

    def costs(self, most: int) -> tuple[np.ndarray, np.ndarray]:
        """Shifts in samples, up to ``most`` either way, and half the sum of squares that each adds.

        The samples that a jump passes take the value on its other side.
        """

        def passed(samples: np.ndarray, value: float) -> np.ndarray:
            old = self.r[samples]
            new = np.where(old == 0.0, 0.0, old + value - self.model[samples])
            return np.cumsum(new**2 - old**2) / 2

        later = np.arange(self.at + 1, min(self.at + 1 + most, len(self.r)))
        sooner = np.arange(self.at, max(self.at - most, -1), -1)
        costs = passed(sooner, self.model[self.at + 1])[::-1], [0.0], passed(later, self.model[self.at])
        return np.arange(-len(sooner), len(later) + 1), np.concatenate(costs)


def jumps_at_rest(t: np.ndarray, v: np.ndarray, a: np.ndarray, sigma: float) -> list[tuple[int, int]]:
    """Where an acceleration jumps by more than its noise since the velocity comes to zero or leaves it.

    Args:
        t, v, a: times, simulated velocity and acceleration, shape (n,), SI units.
        sigma: standard deviation of the acceleration's noise.

    Returns:
        samples before the jump, and beside it the one of the two where the body moves.
    """
    k = _jumps(a, sigma)
    moves = np.where(np.abs(v[k]) < np.abs(v[k + 1]), k + 1, k)
    # Within two intervals: towards rest a Stribeck curve slows a body down faster than at the sample before.
    near = np.abs(v[moves]) <= 2 * np.maximum(np.abs(a[k]), np.abs(a[k + 1])) * (t[k + 1] - t[k])
    return list(zip(k[near].tolist(), moves[near].tolist(), strict=True))


def times_at_rest(t: np.ndarray, v: np.ndarray, a: np.ndarray) -> list[tuple[int, float]]:
    """Samples before the jumps of an acceleration without noise, and the times, s, of these jumps between the samples:
    when the velocity of the side on which the body moves comes to zero. See :func:`jumps_at_rest`."""
    found = jumps_at_rest(t, v, a, 0.0)
    return [(k, float(np.clip(t[m] - v[m] / a[m] if a[m] else t[m], t[k], t[k + 1]))) for k, m in found]


def _jumps(y: np.ndarray, least: float) -> np.ndarray:
    """Samples before the steps that exceed those beside them by ``least``."""
    steps = np.diff(y)
    excess = np.abs(steps[1:-1] - (steps[:-2] + steps[2:]) / 2)
    largest = np.abs(steps[1:-1]) >= np.maximum(np.abs(steps[:-2]), np.abs(steps[2:]))
    return 1 + np.flatnonzero(largest & (excess > least))
