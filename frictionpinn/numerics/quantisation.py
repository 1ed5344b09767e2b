"""The step in which a signal was recorded, from the signal alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

LEVELS = 5  # fewer are a switched signal, which may be exact
FEWEST = 5  # changes between two holds by which a step is known
ALIKE, MOST = 0.05, 0.9  # how closely they are of one size, and how many of them


def quantisation_step(signals: Sequence[np.ndarray]) -> float:
    """Return the step of a signal that is too slow for its recorder's resolution, in its unit; 0 where none shows.

    Such a signal holds a level for some samples and then changes by one step. A slow signal can do no other, so the
    changes between two holds are of one size; those of a switched or resampled signal are of many, and a signal with
    noise above its step hardly ever holds. The step is their median.

    Args:
        signals: samples of each trial, shape (n,), without gaps.
    """
    sizes = [np.zeros(0)]
    for y in signals:
        change = np.abs(np.diff(y))
        held = change == 0
        sizes.append(change[1:-1][held[:-2] & ~held[1:-1] & held[2:]])
    between = np.concatenate(sizes)
    if len(between) < FEWEST or len(np.unique(np.concatenate(signals))) < LEVELS:
        return 0.0
    step = float(np.median(between))
    return step if np.mean(np.abs(between - step) <= ALIKE * step) >= MOST else 0.0
