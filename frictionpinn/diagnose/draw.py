"""Figures of a diagnosis: what was left, what was tried, what it became."""

from __future__ import annotations

import textwrap
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from ..evaluate.picture import save_png
from ..evaluate.style import INK
from .diagnosis import Diagnosis
from .errors import FORCE
from .scan import Scanned
from .verdict import FOUND, NOTHING, PARTLY
from .words import beyond, depends, negligible, shared, untested

MOST_TRIALS, MOST_BARS = 3, 12
INSTANTS = 200  # at which the evidence so far is drawn


def draw(folder: Path, d: Diagnosis) -> list[Path]:
    """Write every figure as PNG; return the files in reading order."""
    folder.mkdir(parents=True, exist_ok=True)
    drawn = {"error": error_figure(d), "residual": residual_figure(d), "tried": tried_figure(d),
             "dependence": dependence_figure(d)}  # fmt: skip
    if d.accepted:
        drawn["proof"] = proof_figure(d)
    if d.unexplained is not None:
        drawn["remainder"] = remainder_figure(d)
    paths = []
    for name, figure in drawn.items():
        paths.append(folder / f"{name}.png")
        save_png(figure, paths[-1])
    return paths


def headline(d: Diagnosis) -> str:
    """The verdict in one sentence, with the error before and after."""
    entry = d.errors[d.main]
    change = beyond(d, entry)
    if entry.get("outliers_left_out"):
        change += f" ({entry['outliers_left_out']} outliers left out)"
    more = f"{change}.{shared(d)}{negligible(d)}{untested(d)}"
    names = " and ".join(name_of(d, k) for k in range(len(d.accepted)))
    if d.verdict == FOUND:
        return f"Missing: {names}{_gain(d)}. {more}"
    if d.verdict == NOTHING:
        return f"Nothing is missing that this recording could show{' and that matters' if d.trifle else ''}. {more}"
    rest = d.unexplained
    kind = "friction" if rest and rest.kind == "friction" else "a force"
    if d.verdict == PARTLY:
        beside = f"{kind} that depends on {_words(d)}, which no name fits"
        return f"Missing: {names}{_gain(d)}; and beyond that {beside}. {more}"
    return f"Something is missing that none of the names fits: {kind} that depends on {_words(d)}. {more}"


def name_of(d: Diagnosis, k: int) -> str:
    """An accepted effect with what the data do not tell from it."""
    own = d.accepted[k]
    others = [c.name for c, _ in own.alike]
    return own.candidate.name + (f" (or {', '.join(others)}: the data do not tell them apart)" if others else "")


def _gain(d: Diagnosis) -> str:
    """What the held-out trials say of the effects: an rms error with much noise in it hardly moves.

    Where the parameters as fitted predict them badly, what they gain once those move within their errors: a static
    friction that the fitted trials leave open makes a slip that comes too late.
    """
    if not d.scored.startswith("held"):
        return ""
    total = sum(evidence_so_far(d, k)[1][-1] for k in range(len(d.before.models)))
    moved = ""
    if total < d.settings.gain:
        moved = f", {d.gain_within_errors:+.0f} with parameters moved within their errors"
    return f" (log-likelihood of trials that no fit saw {total:+.0f}{moved})"


def _words(d: Diagnosis) -> str:
    return depends(d.unexplained) if d.unexplained else ""


def error_figure(d: Diagnosis) -> Figure:
    """Error beyond the noise, before and after, of every signal, with 95 % intervals."""
    names = list(d.errors)
    figure = Figure(figsize=(8, 1.8 + 0.5 * len(names)), layout="constrained")
    axes = figure.subplots()
    place = np.arange(len(names))
    clear = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 0.6}
    for k, (key, color) in enumerate((("excess_before", INK["baseline"]), ("excess_after", INK["model"]))):
        floors = np.array([max(d.errors[n]["noise_floor"], 1e-300) for n in names])
        value = np.array([d.errors[n][key]["value"] for n in names]) / floors
        low, high = (np.array([d.errors[n][key]["ci95"][i] for n in names]) / floors for i in (0, 1))
        label = "declared model" if k == 0 else "augmented model"
        axes.barh(place + 0.4 * k, value, 0.38, color=color, label=label)
        reach = np.maximum([value - low, high - value], 0.0)
        axes.errorbar(value, place + 0.4 * k, xerr=reach, fmt="none", ecolor=INK["reference"], lw=1.2, capsize=3)
        for n, y, end in zip(names, place + 0.4 * k, np.maximum(high, value), strict=True):
            text = f"{d.errors[n][key]['value']:.3g} {d.errors[n]['unit']}"
            axes.annotate(text, (end, y), (5, 0), textcoords="offset points", va="center", fontsize=8, bbox=clear)
    axes.set_yticks(place + 0.2, [n.replace("_", " ") for n in names])
    axes.invert_yaxis()
    axes.margins(x=0.2)
    axes.set_xlim(left=0.0)
    axes.set_xlabel(f"error beyond the noise, in multiples of the noise, {d.scored} (whiskers: 95 %)")
    axes.set_title(textwrap.fill(_short(d), 80), fontsize=11)
    figure.legend(frameon=False, fontsize=8, loc="outside lower center", ncols=2)
    return figure


def _short(d: Diagnosis) -> str:
    if d.verdict == FOUND:
        return "missing: " + ", ".join(a.candidate.name for a in d.accepted)
    if d.verdict == NOTHING:
        return "nothing is missing"
    names = "".join(f"{a.candidate.name}, " for a in d.accepted)
    return f"missing: {names}and something that depends on {_words(d)}"


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
    pair = [fit.state.pieces[k].residuals for fit in (d.before, d.after)]
    edges = np.linspace(0.0, 1.0, INSTANTS + 1)
    gained = np.zeros(INSTANTS + 1)
    for name in pair[0]:
        old, new = (np.nan_to_num(r[name] / sigmas[name]) for r in pair)
        at = np.round(edges * len(old)).astype(int)
        for i in range(INSTANTS):
            part = slice(at[i], at[i + 1])
            gained[i + 1] += loss.cost(old[part]) - loss.cost(new[part])
    return t[0] + edges * (t[-1] - t[0]), np.cumsum(gained)


def residual_figure(d: Diagnosis) -> Figure:
    """Residual of the main signal over time on some trials, before and after, with the noise as a band."""
    name = d.main if d.main != FORCE else next(iter(d.before.state.pieces[0].residuals))
    trials = [k for k, piece in enumerate(d.before.state.pieces) if name in piece.residuals][:MOST_TRIALS]
    figure = Figure(figsize=(9, 1.6 + 1.7 * len(trials)), layout="constrained")
    rows = figure.subplots(len(trials), 1, squeeze=False)[:, 0]
    unit, sigma = d.errors[name]["unit"], d.noise.get(name, 0.0)
    for axes, k in zip(rows, trials, strict=True):
        t = d.before.models[k].t
        axes.axhspan(-2 * sigma, 2 * sigma, color=INK["band"], label="noise, two standard deviations")
        axes.plot(t, d.before.state.pieces[k].residuals[name], ".", ms=2.5, color=INK["baseline"], label="declared")
        axes.plot(t, d.after.state.pieces[k].residuals[name], ".", ms=2.5, color=INK["model"], label="augmented")
        axes.set(ylabel=f"{name} ({unit})", title=f"trial {d.before.models[k].trial}")
        axes.title.set_fontsize(9)
    rows[0].legend(frameon=False, fontsize=8, loc="upper right", ncols=3, markerscale=3)
    rows[-1].set_xlabel("time (s)")
    figure.suptitle(f"model minus measurement, {d.scored}", fontsize=11)
    return figure


def tried_figure(d: Diagnosis) -> Figure:
    """How significant the candidates were at the declared model; what was added in colour."""
    tested = sorted(d.selection.first.tested, key=lambda t: t.log_p)[:MOST_BARS]
    taken = {a.candidate.name for a in d.accepted}
    figure = Figure(figsize=(8, 0.8 + 0.32 * len(tested)), layout="constrained")
    axes = figure.subplots()
    values = [max(-t.log_p, 0.1) for t in tested]
    colors = [INK["model"] if t.candidate.name in taken else INK["baseline"] for t in tested]
    axes.barh(range(len(tested)), values, color=colors)
    axes.set_yticks(range(len(tested)), [t.candidate.name.replace("_", " ") for t in tested])
    axes.invert_yaxis()
    axes.axvline(threshold(d), color=INK["reference"], lw=1, ls="--")
    axes.set(xlabel="evidence at the declared model, -log10 of the chance (dashed: threshold)",
             title="candidates tested" + (", added in red" if taken else ": none was added"))  # fmt: skip
    axes.set_xscale("log")
    axes.set_xlim(0.1, 2 * max([*values, threshold(d)]))
    return figure


def threshold(d: Diagnosis) -> float:
    """-log10 of the chance at which one of all candidates counts."""
    return -d.settings.log_p + float(np.log10(max(len(d.selection.first.tested), 1)))


def dependence_figure(d: Diagnosis) -> Figure:
    """Whether anything is left, by variable: evidence that the residual depends on it, before and after."""
    before, after = _by_variable(d.selection.first), _by_variable(d.selection.last)
    names = list(before)
    figure = Figure(figsize=(8, 1.2 + 0.4 * len(names)), layout="constrained")
    axes = figure.subplots()
    for k, (table, color, label) in enumerate(
        ((before, INK["baseline"], "declared model"), (after, INK["model"], "augmented model"))
    ):
        values = [max(table.get(n, 0.0), 0.1) for n in names]
        axes.barh(np.arange(len(names)) + 0.4 * k, values, 0.38, color=color, label=label)
    axes.axvline(-d.settings.log_p, color=INK["reference"], lw=1, ls="--", label="threshold")
    axes.set_yticks(np.arange(len(names)) + 0.2, [n.replace("_", " ") for n in names])
    axes.invert_yaxis()
    axes.set(xlabel="evidence, -log10 of the chance", title="does the residual depend on ...?")
    axes.set_xscale("log")
    axes.set_xlim(0.1, 4 * max([*before.values(), *after.values(), -d.settings.log_p]))
    figure.legend(frameon=False, fontsize=8, loc="outside lower center", ncols=3)
    return figure


def _by_variable(scanned: Scanned) -> dict[str, float]:
    result: dict[str, float] = {}
    for m in scanned.remaining:
        corrected = max(0.0, -m.log_p - float(np.log10(len(scanned.remaining))))
        result[m.variable] = max(result.get(m.variable, 0.0), corrected)
    return dict(sorted(result.items()))


def remainder_figure(d: Diagnosis) -> Figure:
    """Shape of the remainder over the variable that explains most of it."""
    rest = d.unexplained
    assert rest is not None
    figure = Figure(figsize=(7, 3.6), layout="constrained")
    axes = figure.subplots()
    axes.fill_between(rest.x, rest.shape - 2 * rest.error, rest.shape + 2 * rest.error, color=INK["band"],
                      label="two standard errors")  # fmt: skip
    axes.plot(rest.x, rest.shape, color=INK["model"], label="what is left")
    axes.axhline(0.0, color=INK["reference"], lw=0.8)
    system = d.bench.mechanism.system
    units = {"time": "s", "position": system.slip_unit, "velocity": f"{system.slip_unit}/s",
             "acceleration": f"{system.slip_unit}/s^2", "normal_force": "N", **system.signal_units}  # fmt: skip
    what = f"force ({rest.unit})" if rest.kind == "force" else "share of dry friction"
    name = rest.depends_on[0]
    axes.set(xlabel=f"{name.replace('_', ' ')} ({units.get(name, '')})", ylabel=what)
    lines = (f"no name fits: depends on {_words(d)}", rest.formula or "")
    axes.set_title("\n".join(textwrap.fill(line, 75) for line in lines if line), fontsize=11)
    axes.legend(frameon=False, fontsize=8)
    return figure
