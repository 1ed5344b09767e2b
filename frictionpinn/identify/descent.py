"""From a coarse resolution in time to the single sample, and back: how a rugged likelihood is descended."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from .minima import returned
from .solve import Evaluate, Solution, State, levenberg_marquardt

if TYPE_CHECKING:
    from .problem import Problem

COARSEST = 0.25  # of the usual time between two peaks of the slip velocity: a stop is placed better than that
FINER = 2.0  # factor from one resolution to the next: a minimum lies well within the basin of the next
COARSE: dict[str, Any] = {"iterations": 20, "decrease": 0.1}  # of a search at a coarse resolution
FINE: dict[str, Any] = {"iterations": 20, "decrease": 0.03}  # at the sample; noise levels are refined afterwards


def resolutions(problem: Problem) -> list[float]:
    """Resolutions in time, s, from the coarsest to the single sample (0)."""
    times = np.concatenate([np.diff(motion.model.t[motion.edges]) for motion in problem.motions])
    interval = min(float(np.median(np.diff(model.t))) for model in problem.trials)
    coarsest = COARSEST * float(np.median(times))
    count = 1 + int(np.log(max(coarsest / interval, 1.0)) / np.log(FINER))
    return [*(coarsest / FINER**k for k in range(count)), 0.0]


def coarse_to_fine(
    evaluate: Evaluate, first: State, limits: tuple[np.ndarray, np.ndarray], widths: Sequence[float]
) -> Solution | None:
    """Follow the minimum from a coarse resolution in time to a finer one.

    Args:
        evaluate: as of :meth:`Problem.evaluate`, with its option ``width``.
        first: unknowns to start from.
        limits: of the global ones.
        widths: resolutions, s, coarsest first, see :func:`resolutions`.

    Returns:
        the minimum at the last one; None where the model cannot be simulated there.
    """
    found: Solution | None = None
    state = first
    for width in widths:
        at = _at(evaluate, width)
        begun = at(state.u, state.locals, True)
        found = None if begun is None else levenberg_marquardt(at, begun, limits, **(COARSE if width else FINE))
        state = state if found is None else found.state
    return found


def cycled(
    evaluate: Evaluate, found: Solution, limits: tuple[np.ndarray, np.ndarray], widths: Sequence[float]
) -> list[Solution]:
    """The minimum and others found from it by going back to a coarser resolution and down again, lowest first.

    Each time farther back: one level, half of them, all.
    """
    minima = [found]
    for depth in sorted({1, len(widths) // 2, len(widths) - 1} - {0}):
        other = coarse_to_fine(evaluate, minima[0].state, limits, widths[-1 - depth :])
        if other is None or returned(minima[0].state)(other.state):
            continue
        minima = sorted([*minima, other], key=lambda solution: solution.state.cost)
    return minima


def _at(evaluate: Evaluate, width: float) -> Evaluate:
    def at(u, locals_, derivatives, **options):
        return evaluate(u, locals_, derivatives, **({"width": width} | options))

    return at
