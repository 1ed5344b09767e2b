"""The figure of a sweep: the force error of every run and of its group, the errors of the parameters beside it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from matplotlib.figure import Figure

from ..physics.base import plain_name
from ..show import unit_of_error

_POINT, _MEAN = "#8d99ae", "#d1495b"
_PARAMETERS = ("#1b6ca8", "#d1495b", "#2e933c", "#edae49", "#6d597a", "#444444", "#00798c")
_MARKERS = "osD^vPX"


def summary_figure(rows: Sequence[Mapping[str, Any]], grouped: Sequence[Mapping[str, Any]], keys: Sequence[str]):
    """Left: force error of every finished run, mean and standard deviation of its group; right: parameter errors.

    Groups whose forces have different units get a panel each.
    """
    shown = [entry for entry in grouped if "force_rmse_mean" in entry]
    units = list(dict.fromkeys(entry["force_unit"] for entry in shown))
    names = [key[:-8] for entry in shown for key in entry if key.endswith("_off_abs")]
    names = list(dict.fromkeys(names))
    columns = 2 if names else 1
    heights = [1.2 + 0.42 * sum(entry["force_unit"] == unit for entry in shown) for unit in units]
    figure = Figure(figsize=(5.6 * columns + 1.5, sum(heights) + 1.2), layout="constrained")
    panels = figure.subplots(len(units), columns, squeeze=False, gridspec_kw={"height_ratios": heights})
    for line, unit in enumerate(units):
        mine = [entry for entry in shown if entry["force_unit"] == unit]
        _forces(panels[line][0], rows, mine, keys, unit_of_error(unit))
        if names:
            _parameters(panels[line][1], mine, names, labelled=line == 0)
    if names:
        figure.legend(loc="outside lower center", ncols=min(len(names), 7), frameon=False)
    figure.suptitle(headline(shown, keys))
    return figure


def _label(entry: Mapping[str, Any], keys: Sequence[str]) -> str:
    return ", ".join(f"{key.rpartition('.')[2]} {entry[key]}" for key in keys) or "all runs"


def headline(shown: Sequence[Mapping[str, Any]], keys: Sequence[str]) -> str:
    """Which group has the lowest force error, in words."""
    if len({entry["force_unit"] for entry in shown}) > 1 or len(shown) < 2:
        return "Force error on held-out trials"
    best = min(shown, key=lambda entry: entry["force_rmse_mean"])
    unit = unit_of_error(best["force_unit"])
    return f"Lowest force error on held-out trials: {_label(best, keys)}, {best['force_rmse_mean']:.3g} {unit} rms"


def _forces(axis, rows, mine, keys, unit: str) -> None:
    for place, entry in enumerate(mine):
        runs = [r for r in rows if "force_rmse" in r and all(str(r[key]) == str(entry[key]) for key in keys)]
        axis.plot([r["force_rmse"] for r in runs], [place] * len(runs), "o", ms=5, color=_POINT, alpha=0.7)
        deviation = entry["force_rmse_std"]
        axis.errorbar(
            entry["force_rmse_mean"], place, xerr=0 if math.isnan(deviation) else deviation, fmt="|", ms=14, mew=2,
            color=_MEAN, capsize=3,
        )  # fmt: skip
    axis.set_yticks(range(len(mine)), [_label(entry, keys) for entry in mine])
    axis.set_ylim(len(mine) - 0.5, -0.5)  # as beside it
    axis.set_xlim(left=0)
    axis.set(xlabel=f"force error, rms ({unit}): runs, mean ± standard deviation")
    _clean(axis)


def _parameters(axis, mine, names: Sequence[str], labelled: bool) -> None:
    plain = {name: plain_name(name).removeprefix("refined_") for name in names}
    colors = list(dict.fromkeys(plain.values()))
    markers = list(dict.fromkeys(name.removesuffix(plain[name]) for name in names))  # as trained, refined; by contact
    for name in names:
        points = [(100 * e[f"{name}_off_abs"], i) for i, e in enumerate(mine) if f"{name}_off_abs" in e]
        color = _PARAMETERS[colors.index(plain[name]) % len(_PARAMETERS)]
        marker = _MARKERS[markers.index(name.removesuffix(plain[name])) % len(_MARKERS)]
        axis.plot(*zip(*points, strict=True) if points else ([], []), marker, ms=6, color=color, alpha=0.85,
                  ls="none", label=name if labelled else None)  # fmt: skip
    axis.set(xscale="log", xlabel="parameter off the truth (%), mean over runs")
    axis.set_yticks(range(len(mine)), [])
    axis.set_ylim(len(mine) - 0.5, -0.5)
    _clean(axis)


def _clean(axis) -> None:
    axis.grid(axis="x", color="#e8ecf1")
    axis.set_axisbelow(True)
    for side in ("top", "right"):
        axis.spines[side].set_visible(False)
