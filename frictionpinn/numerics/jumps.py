"""Samples beside a jump."""

import numpy as np

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
    steps, result = np.diff(y), np.zeros(len(y), bool)
    excess = np.abs(steps[1:-1] - (steps[:-2] + steps[2:]) / 2)  # white noise makes it sqrt(5) sigma
    largest = np.abs(steps[1:-1]) >= np.maximum(np.abs(steps[:-2]), np.abs(steps[2:]))
    at = 1 + np.flatnonzero(largest & (excess > JUMP * 5**0.5 * sigma))
    result[at] = result[at + 1] = True
    return result
