"""Figures of a diagnosis: error before and after, residual, what was tried, the proof, and what is left."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..data.findings import listed
from ..diagnose.diagnosis import Diagnosis
from ..diagnose.errors import main_signal
from ..diagnose.verdict import Unexplained
from ..evaluate.picture import save_png
from ..evaluate.style import INK
from ..show import readable_unit
from .diagnosis import dependence, evidence_so_far
from .words import spaced

MOST_TRIALS, MOST_BARS = 3, 12  # in one figure: what fits on a screen


def figures(d: Diagnosis) -> dict[str, Figure]:
    """Every figure in reading order, by name."""
    drawn = {"error": error_figure(d), "residual": residual_figure(d), "tried": tried_figure(d),
             "dependence": dependence_figure(d)}  # fmt: skip
    if d.accepted:
        drawn["proof"] = proof_figure(d)
    if d.unexplained is not None:
        drawn["remainder"] = remainder_figure(d, d.unexplained)
    return drawn


def draw(folder: Path, d: Diagnosis) -> list[Path]:
    """Write every figure as PNG; return the files in reading order."""
    folder.mkdir(parents=True, exist_ok=True)
    drawn = figures(d)
    for name, figure in drawn.items():
        save_png(figure, folder / f"{name}.png")
    return [folder / f"{name}.png" for name in drawn]


def error_figure(d: Diagnosis) -> Figure:
    """Error beyond the noise, before and after, of every signal, with 95 % intervals."""
    names, floors = list(d.errors), np.array([max(e["noise_floor"], 1e-300) for e in d.errors.values()])
    told = [[e[key] for e in d.errors.values()] for key in ("excess_before", "excess_after")][: len(_models(d))]
    values = [np.array([e["value"] for e in entries]) / floors for entries in told]
    figure, axes, places = _bars(names, [{**m, "width": v} for m, v in zip(_models(d), values, strict=True)])
    clear = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 0.6}
    for place, value, entries in zip(places, values, told, strict=True):
        low, high = np.array([e["ci95"] for e in entries]).T / floors
        reach = np.maximum([value - low, high - value], 0.0)
        axes.errorbar(value, place, xerr=reach, fmt="none", ecolor=INK["reference"], lw=1.2, capsize=3)
        for name, y, end, entry in zip(names, place, np.maximum(high, value), entries, strict=True):
            text = f"{entry['value']:.3g} {readable_unit(d.errors[name]['unit'])}"
            axes.annotate(text, (end, y), (5, 0), textcoords="offset points", va="center", fontsize=8, bbox=clear)
    axes.margins(x=0.2)
    axes.set_xlim(left=0.0)
    axes.set_xlabel(f"error beyond the noise, in multiples of the noise, {d.scored} (whiskers: 95 %)")
    missing = [*(a.candidate.name for a in d.accepted), *filter(None, [dependence(d.unexplained)])]
    title = f"missing: {listed(missing)}" if missing else "nothing is missing"
    axes.set_title(textwrap.fill(title, 80), fontsize=11)
    return figure


def _models(d: Diagnosis) -> list[dict[str, Any]]:
    """Label and colour of the models that figures compare: where nothing was added, of the declared one alone."""
    declared = {"label": "declared model", "color": INK["baseline"]}
    return [declared, {"label": "augmented model", "color": INK["model"]}] if d.accepted else [declared]


def _bars(names: Sequence[str], rows: Sequence[dict[str, Any]]) -> tuple[Figure, Axes, list[np.ndarray]]:
    """A figure with one bar of each row (arguments of ``barh``) for each name, and the bars' places, shape (names,)."""
    figure = Figure(figsize=(8, 1.3 + (0.15 + 0.2 * len(rows)) * len(names)), layout="constrained")
    axes, height = figure.subplots(), 0.8 / len(rows)
    places = [np.arange(len(names)) + k * height for k in range(len(rows))]
    for place, row in zip(places, rows, strict=True):
        axes.barh(place, height=0.95 * height, **row)
    axes.set_yticks(np.mean(places, axis=0), [spaced(name) for name in names])
    axes.invert_yaxis()
    if len(rows) > 1:
        figure.legend(frameon=False, fontsize=8, loc="outside lower center", ncols=2)
    return figure, axes, places


def tried_figure(d: Diagnosis) -> Figure:
    """How significant the candidates were at the declared model; what was added in colour."""
    tested = sorted(d.selection.first.tested, key=lambda t: t.log_p)[:MOST_BARS]
    taken = {a.candidate.name for a in d.accepted}
    colors = [INK["model"] if t.candidate.name in taken else INK["baseline"] for t in tested]
    threshold = -d.settings.log_p + float(np.log10(max(len(d.selection.first.tested), 1)))  # over all candidates
    title = "candidates tested at the declared model" + (", added in red" if taken else ": none was added")
    return _evidence([t.candidate.name for t in tested], [{"width": [-t.log_p for t in tested], "color": colors}],
                     threshold, title)  # fmt: skip


def dependence_figure(d: Diagnosis) -> Figure:
    """Whether anything is left, by variable: evidence that the residual depends on it, before and after."""
    names = sorted({m.variable for m in d.selection.first.remaining})
    rows = []
    for model, scanned in zip(_models(d), (d.selection.first, d.selection.last), strict=False):
        best = {name: min((m.log_p for m in scanned.remaining if m.variable == name), default=0.0) for name in names}
        rows.append({**model, "width": [-best[name] - np.log10(len(scanned.remaining)) for name in names]})
    return _evidence(names, rows, -d.settings.log_p, "does the residual depend on ...?")


def _evidence(names: Sequence[str], rows: Sequence[dict[str, Any]], threshold: float, title: str) -> Figure:
    """Bars of -log10 of the chance to see as much by luck, with the threshold from which it counts."""
    rows = [{**row, "width": np.maximum(row["width"], 0.13)} for row in rows]  # a logarithmic axis has no 0: a stub
    figure, axes, _ = _bars(names, rows)
    axes.axvline(threshold, color=INK["reference"], lw=1, ls="--")
    axes.set(title=title, xlabel="evidence, -log10 of the chance (dashed: threshold)", xscale="log",
             xlim=(0.1, 4 * max([threshold, *(float(row["width"].max()) for row in rows if len(names))])))  # fmt: skip
    return figure


def proof_figure(d: Diagnosis) -> Figure:
    """Log-likelihood that the augmented model gains on the declared one, summed over time and all signals by trial."""
    figure = Figure(figsize=(8, 3.0), layout="constrained")
    axes = figure.subplots()
    total = 0.0
    for k, model in enumerate(d.before.models):
        t, gained = evidence_so_far(d, k)
        total += gained[-1]
        color = INK["model"] if k == 0 else None
        axes.plot(t, gained, lw=2, color=color, label=f"trial {model.trial}: {gained[-1]:+.0f}")
    axes.axhline(0.0, color=INK["reference"], lw=1, ls="--", label="declared model")
    axes.margins(x=0.02)
    axes.set(xlabel="time (s)", ylabel="log-likelihood gained",
             title=f"augmented against declared model, {d.scored}: {total:+.0f}")  # fmt: skip
    axes.legend(frameon=False, fontsize=8, loc="best", ncols=1 + len(d.before.models) // 6)
    return figure


def residual_figure(d: Diagnosis) -> Figure:
    """Residual of one signal over time on some trials, before and after, with the noise as a band.

    Of those that a model leaves a residual in, the one by which errors would be quoted first.
    """
    pieces = d.before.state.pieces
    left = {n: e for n, e in d.errors.items() if any(n in piece.residuals for piece in pieces)}
    name = main_signal(d.bench.mechanism.system, left)
    trials = [k for k, piece in enumerate(pieces) if name in piece.residuals][:MOST_TRIALS]
    figure = Figure(figsize=(9, 1.6 + 1.7 * len(trials)), layout="constrained")
    rows = figure.subplots(len(trials), 1, squeeze=False)[:, 0]
    unit, sigma = readable_unit(d.errors[name]["unit"]), d.noise.get(name, 0.0)
    for axes, k in zip(rows, trials, strict=True):
        t = d.before.models[k].t
        axes.axhspan(-2 * sigma, 2 * sigma, color=INK["band"], label="noise, two standard deviations")
        for fit, model in zip((d.before, d.after), _models(d), strict=False):
            axes.plot(t, fit.state.pieces[k].residuals[name], ".", ms=2.5, **model)
        axes.set_ylabel(f"{spaced(name)} ({unit})")
        axes.set_title(f"trial {d.before.models[k].trial}", fontsize=9)
        axes.margins(x=0.02)
    rows[-1].set_xlabel("time (s)")
    figure.suptitle(f"model minus measurement, {d.scored}", fontsize=11)
    figure.legend(*rows[0].get_legend_handles_labels(), frameon=False, fontsize=8, loc="outside lower center", ncols=3,
                  markerscale=3)  # fmt: skip
    return figure


def remainder_figure(d: Diagnosis, rest: Unexplained) -> Figure:
    """Shape of the remainder over the variable that explains most of it."""
    figure = Figure(figsize=(7, 3.6), layout="constrained")
    axes = figure.subplots()
    low, high = rest.shape - 2 * rest.error, rest.shape + 2 * rest.error
    axes.fill_between(rest.x, low, high, color=INK["band"], label="two standard errors")
    axes.plot(rest.x, rest.shape, color=INK["model"], label="what is left")
    axes.axhline(0.0, color=INK["reference"], lw=0.8)
    system, name = d.bench.mechanism.system, rest.depends_on[0]
    units = {"time": "s", "position": system.slip_unit, "velocity": f"{system.slip_unit}/s",
             "acceleration": f"{system.slip_unit}/s^2", "normal_force": "N", **system.signal_units}  # fmt: skip
    what = f"force ({readable_unit(rest.unit)})" if rest.kind == "force" else "share of dry friction"
    axes.set(xlabel=f"{spaced(name)} ({readable_unit(units.get(name, ''))})", ylabel=what)
    lines = filter(None, (f"no name fits: {dependence(rest)}", rest.formula))
    axes.set_title("\n".join(textwrap.fill(line, 75) for line in lines), fontsize=11)
    axes.legend(frameon=False, fontsize=8)
    return figure
