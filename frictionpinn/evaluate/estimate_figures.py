"""Figures of estimates: how well parameters are told, and what the model leaves of the measurements."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from .style import INK

if TYPE_CHECKING:
    from ..identify.result import Estimate

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


def residuals_figure(estimate: Estimate) -> Figure:
    """Model minus measurement over time, in multiples of the noise, for every signal of the first trials."""
    trials = list(estimate.residuals)[:MOST_TRIALS]
    times = {} if estimate.minimum is None else {m.trial: m.t for m in estimate.minimum.models}
    figure = Figure(figsize=(9, 0.9 + 1.7 * len(trials)), layout="constrained")
    rows = figure.subplots(len(trials), 1, squeeze=False)[:, 0]
    for axes, name in zip(rows, trials, strict=True):
        axes.axhspan(-2, 2, color=INK["band"], label="noise, two standard deviations")
        for signal, residual in estimate.residuals[name].items():
            t = times.get(name, np.arange(len(residual)))
            axes.plot(t, residual / estimate.sigmas.get(signal, 1.0), ".", ms=2.5, label=signal)
        axes.set_title(f"trial {name}", fontsize=9)
        axes.margins(x=0.01)
    figure.supylabel("model minus measurement, in multiples of the noise", fontsize=9)
    rows[-1].set_xlabel("time (s)" if times else "sample")
    figure.legend(*rows[0].get_legend_handles_labels(), loc="outside lower center", ncols=6, frameon=False, fontsize=8,
                  markerscale=3)  # fmt: skip
    return figure
