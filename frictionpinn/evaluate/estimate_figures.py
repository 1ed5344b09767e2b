"""Figures of estimates: how well parameters are told, and what the model leaves of the measurements."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from ..show import readable_unit
from .style import INK

if TYPE_CHECKING:
    from ..data.recording import Recording
    from ..identify.result import Estimate

Seen = dict[str, tuple[np.ndarray, dict[str, np.ndarray]]]  # trial -> times, and what was measured by signal

MOST_TRIALS = 3  # in one figure: what fits on a screen


def parameters_figure(
    names: Sequence[str],
    values: Mapping[str, float],
    ends: Mapping[str, tuple[float, float]],
    correlation: np.ndarray,
) -> Figure:
    """Left: 95 % intervals relative to the values. Right: correlations.

    Args:
        names, values, ends: parameters, their values and the ends of their intervals.
        correlation: shape (n, n).
    """
    n = len(names)
    figure = Figure(figsize=(9, 1.5 + 0.42 * n), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(3, 2))
    for row, name in enumerate(names):
        value = values[name]
        low, high = (end / value - 1 if value else np.nan for end in ends[name])
        if np.isfinite(low) and np.isfinite(high):
            left.plot([100 * min(low, high), 100 * max(low, high)], [row, row], color=INK["model"], lw=4)
            left.plot([0], [row], "o", color=INK["reference"], ms=4)
        else:
            left.text(0.0, row, "not told", ha="center", va="center", fontsize=8, color=INK["reference"])
    left.axvline(0.0, color=INK["baseline"], lw=0.8)
    left.set_yticks(range(n), [f"{name} = {values[name]:.4g}" for name in names])
    left.set(xlabel="95 % interval, % of the value", ylim=(n - 0.5, -0.5))
    image = right.imshow(np.nan_to_num(correlation), vmin=-1, vmax=1, cmap="RdBu_r", aspect="auto")
    right.set_xticks(range(n), names, rotation=45, ha="right", fontsize=8)
    right.set_yticks(range(n), names, fontsize=8)
    figure.colorbar(image, ax=right, label="correlation")
    return figure


def residuals_figure(estimate: Estimate, recording: Recording | None = None) -> Figure:
    """The fit over the measurement, a column for each of the first trials: every signal that the model predicts as it
    was measured and as it was fitted, SI units; below, model minus measurement in multiples of the noise.

    A search keeps no model: without the ``recording``, what is left alone.
    """
    seen, units = _measured(estimate, recording)
    trials = list(estimate.residuals)[:MOST_TRIALS]
    outputs = tuple(next(iter(seen.values()))[1]) if seen else ()
    size = max(9, 4.2 * len(trials)), 1.6 + 1.9 * (len(outputs) + 1)
    figure = Figure(figsize=size, layout="constrained")
    grid = figure.subplots(len(outputs) + 1, len(trials), squeeze=False, sharex="col", sharey="row")
    for column, name in zip(grid.T, trials, strict=True):
        residuals = estimate.residuals[name]
        t, measured = seen.get(name) or (np.arange(len(next(iter(residuals.values())))), {})
        for axes, (signal, y) in zip(column, measured.items(), strict=False):
            axes.plot(t, y, ".", ms=3, color=INK["baseline"], label="measured")
            axes.plot(t, y + residuals[signal], lw=1.2, color=INK["model"], label="fitted model")
        column[-1].axhspan(-2, 2, color=INK["band"], label="noise, two standard deviations")
        for k, (signal, residual) in enumerate(residuals.items()):
            left = residual / estimate.sigmas.get(signal, 1.0)
            column[-1].plot(t, left, ".", ms=2.5, color=f"C{k}", label=f"{signal}: what is left")
        column[0].set_title(f"trial {name}", fontsize=9)
        column[-1].set_xlabel("time (s)" if name in seen else "sample")
        column[-1].margins(x=0.01)
    for axes, signal in zip(grid[:, 0], outputs, strict=False):
        unit = readable_unit(units.get(signal, ""))
        axes.set_ylabel(f"{signal} ({unit})" if unit else signal)
    grid[-1, 0].set_ylabel("model minus measurement,\nin multiples of the noise", fontsize=8)
    figure.suptitle(f"Fit over the measurement: {estimate.outcome}", fontsize=11)
    drawn = [axes.get_legend_handles_labels() for axes in (grid[0, 0], grid[-1, 0])]
    lines = {label: line for both in drawn for line, label in zip(*both, strict=True)}
    figure.legend(lines.values(), lines, loc="outside lower center", ncols=4, frameon=False, fontsize=8, markerscale=3)
    return figure


def _measured(estimate: Estimate, recording: Recording | None) -> tuple[Seen, Mapping[str, str]]:
    """What was measured of the signals that the model predicts, and the units of these."""
    if estimate.minimum is not None:
        models = estimate.minimum.models
        units = models[0].simulator.mechanism.system.signal_units
        return {m.trial: (m.t, dict(zip(m.outputs, m.y, strict=True))) for m in models}, units
    seen: Seen = {}
    for trial in recording.trials if recording is not None else ():
        residuals = estimate.residuals.get(trial.name, {})  # empty of trials that were cut into windows
        own = {name: trial.signals[name] for name in residuals if name in trial.signals}
        seen |= {trial.name: (trial.t, own)} if own else {}
    return seen, recording.units if recording is not None else {}
