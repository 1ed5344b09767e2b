"""Figures of a training run: a message in the title, axes with units, the baseline beside the model."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from ..data.contact import ContactTrial
from .force import reference_force
from .style import INK

Forces = Mapping[str, np.ndarray]


def force_over_time(
    trial: ContactTrial,
    forces: Forces,
    force_unit: str,
    title: str,
    interval: tuple[np.ndarray, np.ndarray] | None = None,
) -> Figure:
    """Friction force over time on one trial, and below it the errors; the first of ``forces`` is the model's.

    ``interval``: lower and upper end of the model's 95 % interval, shape (n,) each, drawn as a band.
    """
    reference, label = reference_force(trial)
    figure = Figure(figsize=(9, 5), layout="constrained")
    top, bottom = figure.subplots(2, 1, sharex=True, gridspec_kw={"height_ratios": [3, 1]})
    top.plot(trial.t, reference, color=INK["reference"], lw=1.6, label=label)
    for k, (name, force) in enumerate(forces.items()):
        color = INK["model"] if k == 0 else INK["baseline"]
        top.plot(trial.t, force, color=color, lw=1.1, label=name, zorder=3 - k)
        bottom.plot(trial.t, force - reference, color=color, lw=0.9, zorder=3 - k)
    if interval is not None:
        top.fill_between(
            trial.t, *interval, color=INK["model"], alpha=0.25, lw=0, label="95 % interval of the ensemble"
        )
        bottom.fill_between(trial.t, *(end - reference for end in interval), color=INK["model"], alpha=0.25, lw=0)
    bottom.axhline(0.0, color=INK["reference"], lw=0.8)
    top.set(ylabel=f"friction force ({force_unit})", title=title)
    bottom.set(xlabel="time (s)", ylabel=f"error ({force_unit})")
    top.legend(loc="upper right", frameon=False, fontsize=9, ncols=1)
    shown = np.concatenate([reference, *(interval or ())])
    low, high = float(shown.min()), float(shown.max())
    span = (high - low) or 1.0
    top.set_ylim(low - 0.25 * span, high + 0.6 * span)  # room for the legend
    return figure


def force_over_velocity(
    trials: list[ContactTrial], forces: Mapping[str, list[np.ndarray]], units, title: str
) -> Figure:
    """Friction force against slip velocity on the held-out trials: reference as points, the model's force over it.

    Args:
        forces: name -> forces of each trial; the first is the model's.
        units: units of force and of slip velocity.
    """
    figure = Figure(figsize=(6.5, 5), layout="constrained")
    axes = figure.subplots()
    slip = np.concatenate([trial.truth.get("v_slip", trial.offline["v_slip"]) for trial in trials])
    references = [reference_force(trial) for trial in trials]
    axes.plot(
        slip, np.concatenate([r for r, _ in references]), ".", ms=3, color=INK["reference"], label=references[0][1]
    )
    for k, (name, parts) in enumerate(forces.items()):
        color = INK["model"] if k == 0 else INK["baseline"]
        axes.plot(slip, np.concatenate(parts), ".", label=name, color=color, ms=2, alpha=0.6)
    axes.set(xlabel=f"slip velocity ({units[1]})", ylabel=f"friction force ({units[0]})", title=title)
    axes.legend(loc="best", frameon=False, fontsize=9, markerscale=3)
    return figure


def residuals(
    trials: list[ContactTrial], forces: Mapping[str, list[np.ndarray]], force_unit: str, title: str
) -> Figure:
    """Force less reference, before (the last of ``forces``, a yardstick) and after (the first, the model).

    Left over time on the longest trial, right their distribution on all trials.

    Args:
        forces: name -> forces of each trial.
    """
    left = {
        name: [force - reference_force(trial)[0] for trial, force in zip(trials, parts, strict=True)]
        for name, parts in forces.items()
    }
    k = int(np.argmax([len(trial) for trial in trials]))
    figure = Figure(figsize=(10, 3.6), layout="constrained")
    over_time, spread = figure.subplots(1, 2, sharey=True, gridspec_kw={"width_ratios": [3, 1]})
    reach = max(float(np.abs(np.concatenate(parts)).max()) for parts in left.values()) or 1.0
    bins = np.linspace(-reach, reach, 61)
    for place, (name, parts) in reversed(list(enumerate(left.items()))):
        color = INK["model"] if place == 0 else INK["baseline"]
        label = f"{'after' if place == 0 else 'before'}: {name}"
        over_time.plot(trials[k].t, parts[k], color=color, lw=1.0, label=label)
        share = np.full(sum(map(len, parts)), 100.0 / sum(map(len, parts)))
        spread.hist(np.concatenate(parts), bins, weights=share, orientation="horizontal", color=color, alpha=0.65)
    over_time.axhline(0.0, color=INK["reference"], lw=0.8)
    over_time.set_ylim(-1.05 * reach, 1.45 * reach)
    over_time.set(xlabel=f"time (s), trial {trials[k].name}", ylabel=f"force less reference ({force_unit})")
    over_time.legend(loc="upper right", frameon=False, fontsize=9)
    spread.set(xlabel="share of all samples (%)")
    figure.suptitle(title)
    return figure
