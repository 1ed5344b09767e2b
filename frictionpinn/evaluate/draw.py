"""Figures of an evaluation: each trajectory, the errors of all methods, the friction characteristics."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from ..numerics.simulation import Simulation
from ..show import readable_unit
from .characteristics import Characteristics
from .picture import save_png
from .style import INK
from .trajectory import Trajectory
from .yardsticks import Candidate

KINDS = {"online": "online", "in_simulation": "in simulation"}
_SHADES = {"online": "#8d99ae", "in_simulation": "#d1495b"}


def draw(
    folder: Path,
    result: Mapping[str, Any],
    methods: Mapping[str, Mapping[str, Candidate]],
    trajectories: Sequence[Trajectory],
    runs: Mapping[str, Mapping[str, Simulation | str]],
    surfaces: Mapping[str, Mapping[str, Characteristics]],
) -> list[Path]:
    """Write every figure as PNG; return the files in reading order. ``methods`` and ``surfaces`` are by contact."""
    folder.mkdir(parents=True, exist_ok=True)
    drawn = {"errors": errors_figure(result)}
    for k, trajectory in enumerate(trajectories):
        for contact, table in methods.items():
            own = trajectory.at(contact)
            drawn[f"trajectory_{k + 1}_{contact}".rstrip("_")] = trajectory_figure(
                own, table, runs[own.name], result["errors"][own.name]
            )
    for contact, maps in surfaces.items():
        told = result["characteristics"][contact] if contact else result["characteristics"]
        drawn[f"characteristics_{contact}".rstrip("_")] = characteristics_figure(maps, told, contact)
    paths = []
    for name, figure in drawn.items():
        paths.append(folder / f"{name}.png")
        save_png(figure, paths[-1])
    return paths


def trajectory_figure(
    trajectory: Trajectory,
    methods: Mapping[str, Candidate],
    runs: Mapping[str, Simulation | str],
    errors: Mapping[str, Any],
) -> Figure:
    """Force online, force in simulation and, where a coordinate is free, its position: truth, model, yardstick."""
    system, clean, free = trajectory.system, trajectory.clean, trajectory.mechanism.free
    moved = next((c for c in free if system.jacobian[c.name] != 0), next(iter(free), None))
    rows = 3 if moved else 2
    figure = Figure(figsize=(9, 2.9 * rows), layout="constrained")
    axes = figure.subplots(rows, 1, sharex=True)
    unit, square = readable_unit(system.force_unit), readable_unit(errors["model"]["online"]["force_mse"]["unit"])
    first = next(iter(trajectory.seen.values()))
    model = methods["model"]
    shown = {"coulomb_viscous": "baseline", "mujoco": "simulator", "model": "model"}
    shown[next((key for key in ("identified", "observer") if key in methods), "")] = "observer"

    def label(key: str, kind: str) -> str:
        error = errors[key][kind]
        told = f"{error['force_mse']['value']:.3g} {square}" if "force_mse" in error else error["failed"]
        return f"{errors[key]['label']}: {told}"

    for axis in axes[:2]:
        axis.plot(clean.t, trajectory.force, color=INK["reference"], lw=1.6, label=trajectory.reference)
    for z, (key, ink) in enumerate(shown.items(), 2):
        if key not in methods:
            continue
        candidate, color = methods[key], INK[ink]
        if candidate.online is not None:
            axes[0].plot(clean.t, candidate.online(first), color=color, lw=0.9, zorder=z, label=label(key, "online"))
        if candidate.simulate is None:
            continue
        run = runs[key]
        told = label(key, "in_simulation")
        axes[1].plot(*((run.t, run.F) if isinstance(run, Simulation) else ([], [])), color=color, zorder=z, label=told)
        if moved and isinstance(run, Simulation):
            axes[2].plot(run.t, run.signals[moved.signals[0]], color=color, zorder=z)
    span = float(np.ptp(trajectory.force)) or 1.0
    for axis, kind in zip(axes[:2], KINDS.values(), strict=True):
        axis.set(ylabel=f"friction force, {kind} ({unit})")
        axis.set_ylim(trajectory.force.min() - 0.25 * span, trajectory.force.max() + 0.55 * span)
        axis.legend(loc="upper right", framealpha=0.8, edgecolor="none", fontsize=8, ncols=2)
    if moved:
        name = moved.signals[0]
        axes[2].plot(clean.t, clean.signals[name], color=INK["reference"], lw=1.6)
        axes[2].set(ylabel=f"{name} ({readable_unit(system.signal_units[name])})")
    axes[-1].set(xlabel="time (s)")
    figure.align_ylabels()
    figure.suptitle(f"{model.label} on {trajectory.name}, {system.title}: friction force, mean square errors")
    return figure


def errors_figure(result: Mapping[str, Any]) -> Figure:
    """Mean square error of every method, online and in simulation, one panel per trajectory; published ones marked."""
    table = result["errors"]
    width = 4.6 * len(table) + 2.4
    height = 1.6 + 0.5 * max(len(methods) for methods in table.values())
    figure = Figure(figsize=(width, height), layout="constrained")
    panels = figure.subplots(1, len(table), sharey=True, sharex=True, squeeze=False)[0]
    labelled: set[str] = set()
    for axis, (name, methods) in zip(panels, table.items(), strict=True):
        for row, (key, entry) in enumerate(methods.items()):
            for shift, kind in zip((-0.18, 0.18), KINDS, strict=True):
                error, at_left = entry.get(kind, {}).get("force_mse"), axis.get_yaxis_transform()
                if "failed" in entry.get(kind, {}):
                    axis.text(0.01, row + shift, "failed", transform=at_left, va="center", fontsize=8, style="italic")
                if error is None:
                    continue
                edge = INK["reference"] if key == "model" else "none"
                axis.barh(row + shift, error["value"], 0.34, color=_SHADES[kind], ec=edge, lw=1.2)
                axis.annotate(
                    f"{error['value']:.3g}", (error["value"], row + shift), (4, 0), textcoords="offset points",
                    va="center", fontsize=8,
                )  # fmt: skip
                if "published" in error:
                    told = "published" if "published" not in labelled else None
                    labelled.add("published")
                    axis.plot(error["published"], row + shift, "D", color=INK["reference"], ms=6, label=told)
        axis.set(title=name, xscale="log", xlabel=f"mean square error of the force ({_unit(methods)})")
        axis.set_yticks(range(len(methods)), [entry["label"] for entry in methods.values()])
        axis.xaxis.set_minor_formatter(NullFormatter())  # within a decade their labels overlap
        axis.margins(x=0.25)
        for side in ("top", "right"):
            axis.spines[side].set_visible(False)
    panels[0].invert_yaxis()
    for kind, text in KINDS.items():
        panels[0].barh([np.nan], [np.nan], color=_SHADES[kind], label=text)
    figure.legend(loc="outside lower center", frameon=False, ncols=3)
    figure.suptitle("\n".join(textwrap.wrap(headline(result), int(9 * width))))
    return figure


def _unit(methods: Mapping[str, Any]) -> str:
    return readable_unit(methods["model"]["online"]["force_mse"]["unit"])


def headline(result: Mapping[str, Any]) -> str:
    """The model's errors over those of the Coulomb + viscous fit, and where it failed, in words."""
    parts = []
    for kind, text in KINDS.items():
        ratios = []
        for methods in result["errors"].values():
            ours, theirs = (methods[key].get(kind, {}).get("force_mse") for key in ("model", "coulomb_viscous"))
            if ours and theirs and theirs["value"] > 0:
                ratios.append(f"{ours['value'] / theirs['value']:.2g}")
        if ratios:
            lowest, highest = min(ratios, key=float), max(ratios, key=float)
            parts.append(f"{text} {float(lowest):g}" + (f" to {float(highest):g}" if highest != lowest else ""))
    failures = {
        text: sum("failed" in methods["model"].get(kind, {}) for methods in result["errors"].values())
        for kind, text in KINDS.items()
    }
    failed = "".join(f"; {text} it failed on {n} of {len(result['errors'])}" for text, n in failures.items() if n)
    where = f"on {result['system']}" + ("" if result["system"] == result["trained_on"] else " (transferred)")
    label = f"{result['model'].upper()} {where}"
    told = f": {', '.join(parts)} times the square error of the Coulomb + viscous fit" if parts else ""
    return label + told + failed


def characteristics_figure(
    surfaces: Mapping[str, Characteristics], told: Mapping[str, Any], contact: str = ""
) -> Figure:
    """Force over slip velocity and normal force: each model, the truth and, for one model alone, their difference; over
    the slip velocity alone, in one panel, where the normal force never changed.

    Args:
        surfaces: name of a model -> its characteristics, all on one grid.
        told: units, as in ``result.json``.
        contact: its name, for the title, where there are several.
    """
    first = next(iter(surfaces.values()))
    if len(first.N) == 1:
        return _curves(surfaces, told, contact)
    panels = {name: surface.model for name, surface in surfaces.items()}
    if first.truth is not None:
        panels["truth, steady sliding"] = first.truth
    differs = first.truth is not None and len(surfaces) == 1
    figure = Figure(figsize=(4 * (len(panels) + differs), 4), layout="constrained")
    axes = figure.subplots(1, len(panels) + differs, sharex=True, sharey=True, squeeze=False)[0]
    unit = readable_unit(told["unit"])
    top = max(float(np.abs(force).max()) for force in panels.values())
    for axis, (name, force) in zip(axes, panels.items(), strict=False):
        image = axis.pcolormesh(first.v, first.N, force, cmap="RdBu_r", vmin=-top, vmax=top, shading="gouraud")
        off = surfaces[name].rms if name in surfaces else None
        axis.set(title=name if off is None else f"{name}: {off:.2g} {unit} rms off")
    figure.colorbar(image, ax=axes[: len(panels)], location="bottom", label=f"friction force ({unit})")
    if first.truth is not None and differs:
        error = first.model - first.truth
        reach = float(np.abs(error).max()) or 1.0
        image = axes[-1].pcolormesh(first.v, first.N, error, cmap="PuOr_r", vmin=-reach, vmax=reach, shading="gouraud")
        axes[-1].set(title="difference")
        figure.colorbar(image, ax=axes[-1], location="bottom", label=f"model less truth ({unit})")
    for axis in axes:
        axis.set(xlabel=f"slip velocity ({readable_unit(told['v_slip']['unit'])})")
    axes[0].set(ylabel=f"normal force ({readable_unit(told['normal_force']['unit'])})")
    title = f"Friction characteristics{f' of {contact}' if contact else ''} over the range seen in training"
    figure.suptitle(textwrap.fill(title, 36 * (len(panels) + differs)))
    return figure


def _curves(surfaces: Mapping[str, Characteristics], told: Mapping[str, Any], contact: str) -> Figure:
    """Force over slip velocity at the one normal force that was seen: each model, and the truth."""
    first, unit = next(iter(surfaces.values())), readable_unit(told["unit"])
    figure = Figure(figsize=(6.4, 4), layout="constrained")
    axis = figure.subplots()
    if first.truth is not None:
        axis.plot(first.v, first.truth[0], color=INK["reference"], lw=1.6, label="truth, steady sliding")
    inks = [INK[name] for name in ("model", "observer", "simulator", "baseline")]
    for k, (name, surface) in enumerate(surfaces.items()):
        off = "" if surface.rms is None else f": {surface.rms:.2g} {unit} rms off"
        axis.plot(first.v, surface.model[0], color=inks[k % len(inks)], label=f"{name}{off}")
    axis.axhline(0.0, color=INK["baseline"], lw=0.6, zorder=0)
    axis.set(xlabel=f"slip velocity ({readable_unit(told['v_slip']['unit'])})", ylabel=f"friction force ({unit})")
    axis.legend(loc="upper left", frameon=False)
    of, load = f" of {contact}" if contact else "", f"{first.N[0]:.3g} {readable_unit(told['normal_force']['unit'])}"
    title = f"Friction characteristics{of} over the range seen in training, at a normal force of {load}"
    figure.suptitle(textwrap.fill(title, 62))
    return figure
