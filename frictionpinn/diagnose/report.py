"""The report of a diagnosis: its verdict in words, figures, and one self-contained page with the equation."""

from __future__ import annotations

import base64
import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Template
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..data.findings import listed
from ..evaluate.picture import save_png
from ..evaluate.style import INK, readable
from ..numerics.excess import RESIDUAL
from ..show import LOOKS, readable_unit
from .diagnosis import Diagnosis
from .errors import main_signal
from .verdict import FOUND, NO_VERDICT, NOTHING, PARTLY, UNEXPLAINED, Unexplained

MOST_TRIALS, MOST_BARS = 3, 12  # in one figure: what fits on a screen
INSTANTS = 200  # at which the evidence so far is drawn
LEAST_CHANCE = -100  # decimal logarithm: no noise is known so well that smaller ones differ


def headline(d: Diagnosis) -> str:
    """The verdict, the error before and after beside the noise, and what is left: a few sentences."""
    names = []
    for a in d.accepted:
        alike = ", ".join(c.name for c, _ in a.alike)
        names.append(a.candidate.name + (f" (or {alike}: the data do not tell them apart)" if alike else ""))
    missing, unnamed = f"Missing: {listed(names)}{gain_in_words(d)}", dependence(d.unexplained)
    said = {
        FOUND: f"{missing}.",
        NOTHING: f"Nothing is missing that this recording could show{' and that matters' if d.trifle else ''}.",
        PARTLY: f"{missing}; and beyond that {unnamed}, which no name fits.",
        UNEXPLAINED: f"Something is missing that none of the names fits: {unnamed}.",
        NO_VERDICT: f"No verdict: {'; '.join(d.doubts)}.",
    }
    sentences = [said[d.verdict], error_in_words(d)]
    if d.shares and d.left["value"] is not None:
        each = [f"{a.candidate.name} took off {share(own)}" for a, own in zip(d.accepted, d.shares, strict=True)]
        left = ", ".join(filter(None, [f"{share(d.left)} is left", dependence(d.unexplained or d.trifle)]))
        sentences.append(f"Of the squared error of {_spaced(d.main)} beyond the noise, {listed(each)}; {left}.")
    if d.trifle is not None:
        sentences.append(f"Significant but small: {dependence(d.trifle)}, {100 * d.trifle.size:.2g} % of the friction "
                         f"force (diagnose.worth: {100 * d.settings.worth:.2g} %).")  # fmt: skip
    if untested := {r.candidate.name for r in d.refused if "could not be tested" in r.why}:
        sentences.append(f"{len(untested)} candidates could not be tested: their derivatives overflow in the "
                         "simulation.")  # fmt: skip
    return " ".join(sentences)


def dependence(rest: Unexplained | None) -> str:
    """What a remainder is and on which variables it may depend, three at most; empty where there is none."""
    if rest is None:
        return ""
    kind, variables = "friction" if rest.kind == "friction" else "a force", _spaced(" or ".join(rest.depends_on[:3]))
    if not rest.confirmed:
        return f"{kind} that goes with {variables} in the fitted trials alone"
    return f"{kind} that depends on {variables}"


def gain_in_words(d: Diagnosis) -> str:
    """What the held-out trials say of the effects: an rms error with much noise in it hardly moves.

    Where the parameters as fitted predict them badly, what they gain once those move within their errors: a static
    friction that the fitted trials leave open makes a slip that comes too late.
    """
    total = gain_together(d)
    if total is None:
        return ""
    moved = ""
    if total < d.settings.gain:
        moved = f", {d.gain_within_errors:+.0f} with parameters moved within their errors"
    return f" (log-likelihood of trials that no fit saw {total:+.0f}{moved})"


def gain_together(d: Diagnosis) -> float | None:
    """Log-likelihood that held-out trials gain by all effects, at the declared model's noise levels; None without."""
    if not d.accepted or not d.scored.startswith("held"):
        return None
    return float(sum(evidence_so_far(d, k)[1][-1] for k in range(len(d.before.models))))


def error_in_words(d: Diagnosis) -> str:
    """The error beyond the noise of the signal quoted first, before and after, and where the noise is known from."""
    entry = d.errors[d.main]
    what = entry["quantity"].removeprefix("rms error")
    old, new = (f"{e['value']:.3g} ({e['ci95'][0]:.3g} to {e['ci95'][1]:.3g})"
                for e in (entry["excess_before"], entry["excess_after"]))  # fmt: skip
    if entry["noise_from"] == RESIDUAL:
        noise = f"the model's own residual is taken for the noise, {entry['noise_floor']:.3g}"
        other = "neighbouring samples differ by"
    else:
        noise, other = f"noise floor {entry['noise_floor']:.3g}, from {entry['noise_from']}", "the model leaves"
    if entry["noise_other"] is not None:
        noise += f" ({other} {entry['noise_other']:.3g}: noise correlated in time, or a model far off)"
    count = entry.get("outliers_left_out")
    noise += f" ({count} outliers left out)" if count else ""
    unit = entry["unit"].replace("*", " ")
    return f"Error{what} beyond the noise, {d.scored}, {unit}: {old} before, {new} after; {noise}."


def number(value: float | None) -> str:
    """Four significant digits."""
    return "?" if value is None else f"{value:.4g}"


def span(ci95: Sequence[float | None]) -> str:
    """A 95 % interval in words."""
    return "not told by these data" if None in ci95 else f"{number(ci95[0])} to {number(ci95[1])}"


def chance(log10_p: float) -> str:
    """A chance from its decimal logarithm: 1e-38; what is below any that a model of noise could tell has no figure."""
    return f"below 1e{LEAST_CHANCE:d}" if log10_p < LEAST_CHANCE else f"{10.0**log10_p:.1g}"


def share(told: Mapping[str, Any]) -> str:
    """A share with its 95 % interval, in per cent."""
    if told["value"] is None:
        return "?"
    value, low, high = (f"{100 * x:.0f}" for x in (told["value"], *told["ci95"]))
    return f"{value} % ({low} to {high} %)"


def _spaced(name: str) -> str:
    return name.replace("_", " ")


def write_page(
    path: Path,
    result: Mapping[str, Any],
    words: str,
    mathml: str,
    figures: Sequence[Path],
    together: float | None = None,
) -> None:
    """Write the report as one HTML file, from ``page.html``.

    Args:
        result: as in ``result.json``.
        words: see :func:`headline`.
        mathml: the friction force.
        figures: PNG files, embedded under the names of their files.
        together: see :func:`gain_together`.
    """
    images = {p.stem: base64.b64encode(p.read_bytes()).decode() for p in figures}
    page = Template(Path(__file__).with_name("page.html").read_text(encoding="utf-8"))
    refused: dict[str, list[str]] = {}
    for candidate in result["refused"]:
        refused.setdefault(candidate["why"], []).append(candidate["name"])
    words_of = {"number": number, "span": span, "share": share, "chance": chance, "unit": readable_unit}
    text = page.render(r=result, headline=words, mathml=mathml, images=images, refused=refused, together=together,
                       looks=LOOKS, **words_of)  # fmt: skip
    path.write_text(text, encoding="utf-8")


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
            text = f"{entry['value']:.3g} {readable(d.errors[name]['unit'])}"
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
    axes.set_yticks(np.mean(places, axis=0), [_spaced(name) for name in names])
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
    rows = [{**row, "width": np.maximum(row["width"], 0.1)} for row in rows]  # a logarithmic axis has no 0
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


def evidence_so_far(d: Diagnosis, k: int) -> tuple[np.ndarray, np.ndarray]:
    """Times, s, and the log-likelihood that trial ``k`` gains until then, shape (INSTANTS + 1,) each.

    At the declared model's noise levels, which take what it lacks for noise: never too much.
    """
    loss, sigmas, t = d.bench.problem.loss, d.before.sigmas, d.before.models[k].t
    before, after = (fit.state.pieces[k].residuals for fit in (d.before, d.after))
    gained = np.zeros(INSTANTS)
    for name in before:
        old, new = (np.array_split(np.nan_to_num(r[name] / sigmas[name]), INSTANTS) for r in (before, after))
        gained += [loss.cost(a) - loss.cost(b) for a, b in zip(old, new, strict=True)]
    return np.linspace(t[0], t[-1], INSTANTS + 1), np.concatenate([[0.0], np.cumsum(gained)])


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
    unit, sigma = readable(d.errors[name]["unit"]), d.noise.get(name, 0.0)
    for axes, k in zip(rows, trials, strict=True):
        t = d.before.models[k].t
        axes.axhspan(-2 * sigma, 2 * sigma, color=INK["band"], label="noise, two standard deviations")
        for fit, model in zip((d.before, d.after), _models(d), strict=False):
            axes.plot(t, fit.state.pieces[k].residuals[name], ".", ms=2.5, **model)
        axes.set_ylabel(f"{_spaced(name)} ({unit})")
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
    what = f"force ({readable(rest.unit)})" if rest.kind == "force" else "share of dry friction"
    axes.set(xlabel=f"{_spaced(name)} ({readable(units.get(name, ''))})", ylabel=what)
    lines = filter(None, (f"no name fits: {dependence(rest)}", rest.formula))
    axes.set_title("\n".join(textwrap.fill(line, 75) for line in lines), fontsize=11)
    axes.legend(frameon=False, fontsize=8)
    return figure
