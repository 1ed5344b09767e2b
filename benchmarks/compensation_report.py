"""Table, figures and page of benchmarks/compensation.py, from the results in benchmarks/results/compensation*.json."""

from __future__ import annotations

import html
import json
from collections.abc import Callable, Iterable
from textwrap import fill

import numpy as np
from compensation import (
    ARMS,
    CHOICES,
    FIGURES,
    FIRST,
    INFORMED,
    MOVES,
    REFERENCES,
    RESULTS,
    SKIPPED,
    SLOW,
    closed,
    made,
)
from compensation_plants import KINDS
from matplotlib.figure import Figure

from frictionpinn.show import page, picture, png

COMMAND = "python benchmarks/compensation.py"
INK = {"none": "#8d99ae", "coulomb": "#b08968", "stribeck": "#d9722e", "feedforward": "#edae49",
       "disturbance_observer": "#00798c", "estimator": "#d1495b", "measuring": "#6a4c93",
       "oracle": "#222222"}  # fmt: skip
SCALE = {"drive": (1e6, "µm"), "joint": (1e6, "µrad")}
FORCE = {"drive": "N", "joint": "N m"}


def unit(name: str) -> tuple[float, str]:
    """Factor and unit in which errors are told."""
    return SCALE[KINDS[name].system]


def _heading(name: str) -> str:
    title = KINDS[name].title
    return title[0].upper() + title[1:]


def verdicts(table: dict) -> list[str]:
    """What the benchmark must show, each with its figures."""
    median = {
        (name, motion): {arm: float(np.median(row["rms"])) for arm, row in arms.items()}
        for name, motions in table.items()
        for motion, arms in motions.items()
    }
    slow = [1 - row["estimator"] / row["none"] for (_, motion), row in median.items() if motion in SLOW]
    others = [arm for arm in ARMS if arm not in ("estimator", *INFORMED)]
    worse = [f"{n}, {m} ({min((row[a], a) for a in others)[1]})" for (n, m), row in median.items()
             if row["estimator"] > min(row[a] for a in others)]  # fmt: skip
    ratio = {key: row["estimator"] / row["oracle"] for key, row in median.items()}
    within = sum(value <= 1.5 for value in ratio.values())
    sensing = {key: row["measuring"] / row["oracle"] for key, row in median.items()}
    return [
        f"our estimator against no compensation, slow references: rms error {100 * min(slow):.1f} to "
        f"{100 * max(slow):.1f} % lower (median {100 * np.median(slow):.1f} %; wanted: 60 %)",
        f"settings where another arm but the oracles has a lower median: {len(worse)} of {len(median)} "
        "(wanted: at most 1)" + (f": {'; '.join(worse)}" if worse else ""),
        f"within 1.5 times the oracle's: {within} of {len(median)} settings; ratio median "
        f"{np.median(list(ratio.values())):.2f}, from {min(ratio.values()):.2f} to {max(ratio.values()):.2f}",
        "an oracle that measures (told the axis, it makes good what the encoder shows), within 1.5 times the oracle's: "
        f"{sum(value <= 1.5 for value in sensing.values())} of {len(median)} settings; ratio median "
        f"{np.median(list(sensing.values())):.2f}, from {min(sensing.values()):.2f} to {max(sensing.values()):.2f}",
    ]


def missing(table: dict) -> list[str]:
    """Our error over the oracle's, in two factors: what encoder and delay take, and what we do not know."""
    lines = ["our estimator's rms error over the oracle's = sensing x knowledge, ratios of medians over seeds;",
             "sensing: an oracle that measures over the oracle; knowledge: our estimator over an oracle that measures",
             f"  {'':<10}" + "".join(f"{motion:>24}" for motion in REFERENCES)]  # fmt: skip
    for name, motions in table.items():
        cells = []
        for arms in motions.values():
            ours, measuring, oracle = (np.median(arms[arm]["rms"]) for arm in ("estimator", *INFORMED))
            parts = (ours / oracle, measuring / oracle, ours / measuring)
            cells.append("{} = {} x {}".format(*(plain(value, 2) for value in parts)))
        lines.append(f"  {name:<10}" + "".join(f"{cell:>24}" for cell in cells))
    return lines


def text(result: dict, chosen: dict) -> str:
    """The whole result for a terminal."""
    table, (low, high) = result["table"], result["seeds"]
    lines = [
        f"{COMMAND}: seeds {low} to {high}; medians, in brackets the quartiles",
        f"errors from {SKIPPED:g} to {MOVES:g} s of the motion; parameters believed 20 % wrong, odd seeds with "
        "50 % more load",
        "",
        *verdicts(table),
        "",
        *missing(table),
        "",
    ]
    for name, motions in table.items():
        factor, told = unit(name)
        tuned = ", ".join(f"{ARMS[arm]} {CHOICES[arm][0]} {value:g}" for arm, value in chosen[name].items())
        lines += [f"{name}: {KINDS[name].title}; {tuned}", ""]
        for key, title in FIGURES.items():
            scale, shown = (factor, told) if key in ("rms", "peak") else (1.0, "W")
            shown = f"{FORCE[KINDS[name].system]}/s" if key == "variation" else shown
            lines.append(f"  {title + ', ' + shown:<34}" + "".join(f"{ARMS[arm][:20]:>23}" for arm in ARMS))
            for motion, arms in motions.items():
                cells = [scale * np.quantile(arms[arm][key], [0.5, 0.25, 0.75]) for arm in ARMS]
                lines.append(
                    f"    {motion:<32}"
                    + "".join(f" {f'{plain(c[0], 4)} ({plain(c[1], 3)}, {plain(c[2], 3)})':>22}" for c in cells)
                )
        lines.append("")
    return "\n".join(lines)


def plain(value: float, digits: int) -> str:
    """A number of so many digits, without an exponent."""
    return f"{float(f'{value:.{digits}g}'):g}"


def gains(table: dict) -> Figure:
    """Rms error of every arm relative to none, every setting a point."""
    figure = Figure(figsize=(10, 4.6), layout="constrained")
    axis = figure.subplots()
    arms = [arm for arm in ARMS if arm != "none"]
    for k, arm in enumerate(arms):
        shares = [
            np.median(np.array(row[arm]["rms"]) / np.array(row["none"]["rms"]))
            for motions in table.values()
            for row in motions.values()
        ]
        spread = np.linspace(-0.25, 0.25, len(shares))
        axis.scatter(k + spread, 100 * np.array(shares), s=22, color=INK[arm])
        axis.hlines(100 * np.median(shares), k - 0.35, k + 0.35, color=INK[arm], lw=2)
    axis.axhline(40, color=INK["none"], lw=0.8, ls="--")
    axis.annotate("60 % lower", (len(arms) - 0.6, 40), (0, 3), textcoords="offset points", fontsize=8, ha="right")
    axis.set(yscale="log", ylabel="rms error, % of that without compensation", xticks=range(len(arms)))
    axis.set_xticklabels([fill(ARMS[arm], 12) for arm in arms])
    axis.yaxis.set_major_formatter("{x:g}")
    axis.set_title("What compensation leaves of the tracking error: a point for every axis and reference")
    return figure


def traces(name: str, chosen: dict, seed: int = FIRST + 1) -> Figure:
    """Errors and torques of one axis on the reversing sine."""
    factor, told = unit(name)
    figure = Figure(figsize=(10, 5), layout="constrained")
    top, bottom = figure.subplots(2, 1, sharex=True)
    for arm in ("none", "feedforward", "disturbance_observer", "estimator"):
        ((loop, _),) = closed(name, "reversing sine", seed, made(chosen, name, arm))
        part = (loop.t > SKIPPED) & (loop.t < SKIPPED + 2.5)
        top.plot(loop.t[part], factor * loop.error[part], color=INK[arm], lw=1.1, label=ARMS[arm])
        if arm == "estimator":
            bottom.plot(loop.t[part], loop.friction[part], color=INK["oracle"], lw=1.4, label="true friction")
            bottom.plot(
                loop.t[part], loop.added[part], color=INK[arm], lw=1.0, label="added by our estimator, load included"
            )
            bottom.fill_between(loop.t[part], loop.low[part], loop.high[part], color=INK[arm], alpha=0.2, lw=0)
    top.set(ylabel=f"tracking error ({told})", title=f"{_heading(name)}: reversing sine, load +50 %")
    bottom.set(xlabel="time (s)", ylabel=f"friction ({FORCE[KINDS[name].system]})")
    for axis in (top, bottom):
        axis.legend(loc="upper right", frameon=False, fontsize=8, ncols=4)
        low, high = axis.get_ylim()
        axis.set_ylim(low, high + 0.25 * (high - low))
    return figure


def circle(name: str, chosen: dict, seed: int = FIRST + 1, magnified: float = 3.0) -> Figure:
    """The circle that two axes draw, its deviation magnified."""
    figure = Figure(figsize=(10, 3.8), layout="constrained")
    arms = ("none", "feedforward", "disturbance_observer", "estimator")
    for k, (axis, arm) in enumerate(zip(figure.subplots(1, len(arms), sharex=True, sharey=True), arms, strict=True)):
        found = closed(name, "circle", seed, made(chosen, name, arm))
        part = (found[0][0].t > SKIPPED) & (found[0][0].t < SKIPPED + 3)
        x, y = (loop.reference[part, 0] for loop, _ in found)
        ex, ey = (loop.error[part] for loop, _ in found)
        axis.plot(x, y, color=INK["none"], lw=0.8)
        axis.plot(x - magnified * ex, y - magnified * ey, color=INK[arm], lw=1.2)
        axis.set(aspect="equal", xticks=[], yticks=[], title=ARMS[arm])
        axis.set_frame_on(False)
        if k == 0:
            axis.set_xlabel(f"deviation times {magnified:.0f}")
    return figure


def grid(name: str, motions: dict, key: str) -> str:
    """Medians and quartiles of one figure, a row for every reference."""
    factor, told = unit(name) if key in ("rms", "peak") else (1.0, "")
    head = "".join(f'<th scope="col">{html.escape(text)}</th>' for text in ARMS.values())
    body = ""
    for motion, arms in motions.items():
        body += f'<tr><th scope="row">{html.escape(motion)}</th>'
        for arm in ARMS:
            mid, low, high = factor * np.quantile(arms[arm][key], [0.5, 0.25, 0.75])
            body += (
                f"<td{' class=ours' if arm == 'estimator' else ''}>{plain(mid, 3)} "
                f"<small>({plain(low, 2)}–{plain(high, 2)})</small></td>"
            )
        body += "</tr>\n"
    return f'<div class="wide"><table><tr><th scope="col">{FIGURES[key]} ({told})</th>{head}</tr>\n{body}</table></div>'


def write(chosen: dict) -> None:
    """Write compensation.txt and compensation.html from what has been measured."""
    result = json.loads((RESULTS / "compensation.json").read_text(encoding="utf-8"))
    told = text(result, chosen)
    parts = sorted(RESULTS.glob("compensation_*.txt"))
    (RESULTS / "compensation.txt").write_text(told, encoding="utf-8")
    body = "<ul>" + "".join(f"<li>{html.escape(line)}</li>" for line in verdicts(result["table"])) + "</ul>\n"
    body += f'<p class="note">{html.escape(COMMAND)}; seeds {result["seeds"][0]} to {result["seeds"][1]}. Medians, '
    body += "quartiles in brackets.</p>\n"
    body += f"<pre>{html.escape(chr(10).join(missing(result['table'])))}</pre>\n"
    body += picture(
        png(gains(result["table"])), "Median of the ratio over seeds; the bar is the median of all settings."
    )
    for name, motions in result["table"].items():
        body += f"<h2>{html.escape(_heading(name))}</h2>\n{grid(name, motions, 'rms')}{grid(name, motions, 'peak')}"
        body += picture(
            png(traces(name, chosen)), "Tracking error, and what was added to the torque beside the true friction."
        )
    body += picture(png(circle("drive", chosen)), "Two drives on a circle; grey: the circle that was asked for.")
    for path in parts:
        body += f"<h2>{html.escape(path.stem.removeprefix('compensation_').capitalize())}</h2>\n"
        body += f"<pre>{html.escape(path.read_text(encoding='utf-8'))}</pre>\n"
    (RESULTS / "compensation.html").write_text(page("Friction compensation in a closed loop", body), encoding="utf-8")
    print(told)


def save(name: str, lines: list[str]) -> None:
    """Write a part of the result, and show it."""
    text = "\n".join(lines) + "\n"
    (RESULTS / f"compensation_{name}.txt").write_text(text, encoding="utf-8")
    print(text)


def kept(name: str, kinds: Iterable[str]) -> dict:
    """What a part measured before of the kinds that are not measured now, by kind."""
    file = RESULTS / f"compensation_{name}.json"
    before = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
    return {kind: found for kind, found in before.items() if kind not in kinds}


def keep(name: str, found: dict, table: Callable[[dict], list[str]]) -> None:
    """Write what a part measured, by kind in their order, and its table."""
    whole = {kind: found[kind] for kind in KINDS if kind in found}
    (RESULTS / f"compensation_{name}.json").write_text(json.dumps(whole, indent=1) + "\n", encoding="utf-8")
    save(name, table(whole))
