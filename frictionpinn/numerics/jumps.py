"""Jumps of a sampled signal: where they are, and what one costs that comes some samples earlier or later."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..physics.mechanism import Mechanism
from .simulation import Simulation

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
    """An acceleration or a force that jumps in a simulation, since a body stops, turns round or breaks away.

    Attributes:
        model, r: that signal, and the model less the measured one, zero where nothing was measured, over the
            noise, shape (n,) each.
        at: sample before the jump.
        share: of the interval from that sample to the next, after which it jumps.
        slopes: derivatives of its time in what is unknown of the trial, in samples, shape (n_l,).
    """

    model: np.ndarray
    r: np.ndarray
    at: int
    share: float
    slopes: np.ndarray

    def costs(self, error: float, most: float) -> tuple[np.ndarray, np.ndarray]:
        """Shifts in samples, by which it passes samples up to ``most`` standard errors ``error`` of its time away, and
        half the sum of squares that each adds.

        It passes a sample by a standard error, or to the middle between two. The samples that it passes take the value
        on its other side.
        """
        beyond, count = min(error, 0.5), int(most * error) + 1

        def passed(samples: np.ndarray, value: float) -> np.ndarray:
            old = self.r[samples]
            new = np.where(old == 0.0, 0.0, old + value - self.model[samples])
            return np.cumsum(new**2 - old**2) / 2

        later = np.arange(self.at + 1, min(self.at + 1 + count, len(self.r)))
        sooner = np.arange(self.at, max(self.at - count, -1), -1)
        shifts = sooner[::-1] - self.at - self.share - beyond, [0.0], later - self.at - self.share + beyond
        costs = passed(sooner, self.model[self.at + 1])[::-1], [0.0], passed(later, self.model[self.at])
        return np.concatenate(shifts), np.concatenate(costs)


@dataclass(frozen=True)
class Stop:
    """Where a signal jumps since a velocity comes to zero or leaves it: between the samples ``at`` and the next, at the
    ``time``, s; the body moves at the sample ``moves`` of the two."""

    at: int
    moves: int
    time: float


def find_stops(t: np.ndarray, v: np.ndarray, a: np.ndarray, y: np.ndarray, sigma: float = 0.0) -> list[Stop]:
    """Where a signal jumps by more than its noise since a velocity comes to zero or leaves it.

    Args:
        t, v, a: times, simulated velocity and acceleration, shape (n,), SI units.
        y, sigma: what jumps, the acceleration or a force, shape (n,), and the standard deviation of its noise.
    """
    found = []
    for k in _jumps(y, sigma).tolist():
        m = k + 1 if abs(v[k]) < abs(v[k + 1]) else k
        # Within two intervals: towards rest a Stribeck curve slows a body down faster than at the sample before.
        if abs(v[m]) <= 2 * max(abs(a[k]), abs(a[k + 1])) * (t[k + 1] - t[k]):
            time = t[m] - v[m] / a[m] if a[m] else t[m]
            found.append(Stop(k, m, float(np.clip(time, t[k], t[k + 1]))))
    return found


def _jumps(y: np.ndarray, least: float) -> np.ndarray:
    """Samples before the steps that exceed those beside them by ``least``."""
    steps = np.diff(y)
    excess = np.abs(steps[1:-1] - (steps[:-2] + steps[2:]) / 2)
    largest = np.abs(steps[1:-1]) >= np.maximum(np.abs(steps[:-2]), np.abs(steps[2:]))
    return 1 + np.flatnonzero(largest & (excess > least))


def jumps_in(
    run: Simulation, mechanism: Mechanism, outputs: Sequence[str], r: np.ndarray, scale: np.ndarray, n_g: int
) -> tuple[tuple[Jump, ...], np.ndarray]:
    """Where what is measured jumps in a simulation, and which samples are beside, shape (n_out, n), bool.

    An acceleration jumps where a body stops, the force of an imposed motion where that turns round: when a velocity
    comes to zero, the time of which changes by -dv / a.

    Args:
        run, mechanism: a simulation with sensitivities to ``n_g`` parameters, then to the unknowns of a trial, of a
            mechanism whose friction jumps.
        outputs: measured signals.
        r, scale: their residuals over the noise, shape (n_out, n), and its standard deviations, shape (n_out,).
    """
    stopping = [(name, velocity, run.signals[velocity], run.signals[name])
                for _, velocity, name in (c.signals for c in mechanism.free)]  # fmt: skip
    if mechanism.system.massless:
        stopping = [(name, "v_slip", run.v_slip, np.gradient(run.v_slip, run.t)) for name in outputs]
    found, near = list[Jump](), np.zeros(r.shape, bool)
    for name, velocity, v, a in stopping:
        if name not in outputs:
            continue
        row, y = outputs.index(name), run.signals[name]
        for stop in find_stops(run.t, v, a, y, scale[row]):
            k, interval = stop.at, run.t[stop.at + 1] - run.t[stop.at]
            near[row, max(k + 1 - BESIDE, 0) : k + 1 + BESIDE] = True
            slopes = -run.sensitivities[velocity][stop.moves, n_g:] / (a[stop.moves] * interval)
            found.append(Jump(y / scale[row], r[row], k, (stop.time - run.t[k]) / interval, slopes))
    return tuple(found), near
