"""Figures of the reproduction: errors of all methods, the transfer matrix, the ablations."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from ..evaluate.style import INK
from ..show import readable_unit

KINDS = {"online": "online", "in_simulation": "in simulation"}
SWEPT = {
    "data.rate_hz": "sampling rate (Hz)",
    "data.training_trials": "training swings",
    "model.inputs": "inputs",
    "model.loss.weight": "weight of the bristle's consistency (lambda)",
    "model.network.activation": "activation",
    "model.windows.v_slip": "longest window of the slip velocity",
    "noise.level": "noise (share of each signal's spread)",
    "rollout": "friction fitted in motion",
    "smoothing": "smoothing of the measured signals",
}
SHADES = {"online": INK["baseline"], "in_simulation": INK["model"]}


def errors_figure(errors: Mapping[str, Any]) -> Figure:
    """Mean square error of every method, a panel for each trajectory; bars are medians, whiskers the seeds' range."""
    found = {name: row for methods in errors.values() for name, row in methods.items()}
    labels = {name: row["label"] for name, row in sorted(found.items(), key=lambda item: not item[1]["model"])}
    figure = Figure(figsize=(3.4 + 4.2 * len(errors), 1.2 + 0.42 * len(labels)), layout="constrained")
    panels = figure.subplots(1, len(errors), sharex=True, sharey=True, squeeze=False)[0]
    for axis, (trajectory, methods) in zip(panels, errors.items(), strict=True):
        for place, name in enumerate(labels):
            for shift, kind in zip((-0.19, 0.19), KINDS, strict=True):
                cell = methods.get(name, {}).get(kind, {})
                value = cell.get("value")
                if not value:
                    continue
                axis.barh(place + shift, value, 0.36, color=SHADES[kind], zorder=2)
                known = [item for item in cell["by_seed"].values() if item]
                axis.plot([min(known), max(known)], [place + shift] * 2, color=INK["reference"], lw=1.0, zorder=3)
                beside = {"xytext": (6, 0), "textcoords": "offset points", "va": "center", "fontsize": 8}
                reach = max(*known, value, cell.get("published", 0.0))
                axis.annotate(f"{value:.2g}", (reach, place + shift), **beside)
                if "published" in cell:
                    axis.plot(cell["published"], place + shift, "D", color=INK["reference"], ms=6, zorder=4)
        axis.set(title=trajectory, xscale="log", xlabel="mean square error of the force (N²)")
        axis.set_yticks(range(len(labels)), list(labels.values()))
        axis.margins(x=0.15, y=0.01)
        axis.spines[["top", "right"]].set_visible(False)
    panels[0].invert_yaxis()
    for kind, text in KINDS.items():
        panels[0].barh([np.nan], [np.nan], color=SHADES[kind], label=text)
    panels[0].plot([], [], "D", color=INK["reference"], ms=6, ls="none", label="published")
    if any(len(row[kind]["by_seed"]) > 1 for row in found.values() for kind in KINDS if kind in row):
        panels[0].plot([], [], color=INK["reference"], lw=1.0, label="range over seeds")
    figure.legend(loc="outside lower center", ncols=4, frameon=False)
    figure.suptitle("Friction force against the truth: shorter bars are better")
    return figure


def transfer_figure(found: Mapping[str, Any]) -> Figure:
    """Train system x test system for every model, online above, in simulation below; the number is the error."""
    matrix = found["matrix"]
    systems = list(next(iter(matrix.values())))
    figure = Figure(figsize=(1.8 + 2.3 * len(matrix), 5.2), layout="constrained")
    axes = figure.subplots(2, len(matrix), squeeze=False, sharex=True, sharey=True)
    grids = {
        (model, kind): np.array([[rows[a][b][kind]["value"] or np.nan for b in systems] for a in systems])
        for model, rows in matrix.items()
        for kind in KINDS
    }
    known = np.concatenate([grid[np.isfinite(grid)] for grid in grids.values()])
    scale = LogNorm(float(known.min()) / 1.5, float(known.max()) * 1.5)
    for row, (kind, text) in enumerate(KINDS.items()):
        for axis, model in zip(axes[row], matrix, strict=True):
            image = axis.imshow(grids[model, kind], cmap="YlOrRd", norm=scale)
            for (i, j), value in np.ndenumerate(grids[model, kind]):
                told = f"{value:.2g}" if np.isfinite(value) else "failed"
                axis.text(j, i, told, ha="center", va="center", fontsize=11, color="white" if value > 1 else "black")
            axis.set_xticks(range(len(systems)), systems)
            axis.set_yticks(range(len(systems)), systems)
            if row == 0:
                axis.set_title(model.upper())
            else:
                axis.set_xlabel("tested on")
        axes[row][0].set_ylabel(f"{text}\ntrained on")
    figure.colorbar(image, ax=axes, label=f"mean square error of the force ({readable_unit(found['unit'])})")
    figure.suptitle("Transfer between systems")
    return figure


def ablation_figure(found: Mapping[str, Any]) -> Figure:
    """Error over the levels of every ablation, online or, where that was measured, in simulation."""
    tables = found["ablations"]
    columns = 4
    count = -(-len(tables) // columns)
    figure = Figure(figsize=(13, 0.6 + 2.9 * count), layout="constrained")
    axes = figure.subplots(count, columns, sharey=True, squeeze=False).ravel()
    for axis in axes[len(tables) :]:
        axis.set_axis_off()
    for axis, (name, entry) in zip(axes, tables.items(), strict=False):
        levels = list(entry["levels"])
        kind = next(key for key in reversed(KINDS) if key in entry["levels"][levels[0]])
        for place, level in enumerate(levels):
            cell = entry["levels"][level][kind]
            values = list(cell["by_seed"].values())
            default = level == found["default"][name] or (found["default"][name] == "all" and place == len(levels) - 1)
            axis.plot([place] * len(values), values, ".", color=INK["baseline"], ms=5, zorder=2)
            face = INK["model"] if default else "white"
            axis.plot(place, cell["value"], "o", mfc=face, mec=INK["model"], mew=1.6, ms=8, zorder=3)
            axis.annotate(
                f"{cell['value']:.2g}",
                (place, cell["value"]),
                (0, 9),
                textcoords="offset points",
                ha="center",
                fontsize=8,
            )
        axis.plot(range(len(levels)), [entry["levels"][lv][kind]["value"] for lv in levels], color=INK["model"], lw=0.9)
        axis.set_xticks(range(len(levels)), [short(level) for level in levels], fontsize=8)
        where = "" if kind == "online" else ", in simulation"
        axis.set(title=f"{name} ({entry['model'].upper()}){where}", yscale="log")
        axis.set_xlabel(SWEPT.get(entry["key"], entry["key"]), fontsize=9)
        axis.margins(x=0.15, y=0.2)
        axis.spines[["top", "right"]].set_visible(False)
    for axis in axes[::columns]:
        axis.set_ylabel(f"error ({readable_unit(found['unit'])})")
    figure.suptitle(
        "What each choice buys: force error, online on the held-out swing unless said; the default is filled"
    )
    return figure


def short(level: str) -> str:
    """A level as a tick: the longest window in samples, the number of inputs, else as it stands."""
    if level.startswith("[["):
        longest = level.strip("[]").split("],[")[-1].split(",")[0]
        return f"{longest} sample" + ("s" if longest != "1" else "")
    if level.startswith("["):
        names = {"v_slip": "v", "normal_force": "N", "a_frictionless": "a"}
        return ", ".join(names.get(item, item) for item in level.strip("[]").split(","))
    return level
