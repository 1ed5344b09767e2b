"""The result of an evaluation for people: a table on the terminal, a self-contained HTML page."""

from __future__ import annotations

import html
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from ..show import page, picture, readable_unit
from .draw import KINDS, headline
from .fidelity import sentences

_MOTION = ("position_rms", "velocity_rms")
_CAPTIONS = {
    "errors": "Mean square error of every method; a diamond is the published figure, on a trajectory of the kind.",
    "trajectory": "Top: what an observer of the noisy signals gets. Below: the same friction inside the equation of "
    "motion, and the motion that follows.",
    "characteristics": "Steady friction force over slip velocity and normal force.",
}


def columns(result: Mapping[str, Any], trajectory: str) -> list[str]:
    """Heads of the table of one trajectory, with units; a column of published figures only where there are any."""
    methods = [entry for table in result["errors"].values() for entry in table.values()]
    force = readable_unit(result["errors"][trajectory]["model"]["online"]["force_mse"]["unit"])
    heads = ["method"]
    for kind, text in KINDS.items():
        heads += [
            f"{text} ({force})",
            *([f"published, {text}"] if _has_published(result, kind) else []),
        ]
    runs = [entry.get("in_simulation", {}) for entry in methods]
    motion: Mapping[str, Any] = next((run for run in runs if "position_rms" in run), {})
    for kind in _MOTION:
        heads += [f"{name} rms ({readable_unit(entry['unit'])})" for name, entry in motion.get(kind, {}).items()]
    return heads


def _has_published(result: Mapping[str, Any], kind: str) -> bool:
    tables = result["errors"].values()
    return any("published" in e.get(kind, {}).get("force_mse", {}) for table in tables for e in table.values())


def rows(result: Mapping[str, Any], trajectory: str) -> Iterator[list[str]]:
    """Cells of the table of one trajectory, a row per method; a dash where a method has no such figure."""
    width = len(columns(result, trajectory))
    for entry in result["errors"][trajectory].values():
        cells = [entry["label"]]
        for kind in KINDS:
            part = entry.get(kind, {})
            error = part.get("force_mse", {})
            cells.append(part.get("failed") or _number(error.get("value")))
            if _has_published(result, kind):
                cells.append(_number(error.get("published")))
        run = entry.get("in_simulation", {})
        cells += [_number(item["value"]) for kind in _MOTION for item in run.get(kind, {}).values()]
        yield cells + ["-"] * (width - len(cells))


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"


def note(result: Mapping[str, Any]) -> str:
    """What the figures rest on."""
    seeds, noise, law = len(result["seeds"]), result["noise"], result["truth"]["friction"]
    level = f"{noise['name']} noise" + (f" at {noise['level']:g} of each signal's spread" if "level" in noise else "")
    level = "no noise added" if noise["name"] == "none" else level
    published = result["published"]
    drawn = f"median of {seeds} seeds. " if seeds > 1 and law else "one seed. " if law else ""
    simulated = "In simulation: friction in the equation of motion, inputs " + ("prescribed. " if law else "measured. ")
    acting = " + ".join([str(law), *(result["truth"]["effects"] or ())])
    compared = (
        f"Truth: {acting}. " if law else f"A measurement: no truth is known; compared with the {result['reference']}. "
    )
    return (
        f"Online: {level}, signals filtered causally ({result['smoothing']['name']}). {drawn}{simulated}{compared}"
        f"Published figures: {published['source']}; {published['note']}."
    )


def terminal_table(result: Mapping[str, Any]) -> str:
    """Mean square errors of the force and errors of the motion, for a terminal."""
    lines = []
    for name, about in result["trajectories"].items():
        heads = columns(result, name)
        table = [heads, *rows(result, name)]
        widths = [max(len(row[k]) for row in table) for k in range(len(heads))]
        lines.append(f"{name}: {_about(about)}")
        for row in table:
            rest = "".join(f"  {cell:>{width}}" for cell, width in zip(row[1:], widths[1:], strict=True))
            lines.append(f"  {row[0]:<{widths[0]}}{rest}")
    lines += sentences(result.get("fidelity", {}))
    return "\n".join(lines)


def _about(about: Mapping[str, Any]) -> str:
    far, rest, duration = about["displacement"], about["at_rest"]["value"], about["duration"]
    moved = f"ends {far['value']:+.3g} {far['unit']} from its start"
    return f"{duration['value']:.3g} {duration['unit']}, at rest {100 * rest:.0f} % of it, {moved}"


def write_page(path: Path, result: Mapping[str, Any], figures: Sequence[Path]) -> Path:
    """Write one HTML file that holds tables and figures."""
    title = f"{result['model'].upper()} of {result['trained_on']}, evaluated on {result['system']}"
    body = [
        f"<p>{html.escape(headline(result))}.</p>",
        *(f"<p>{html.escape(text)}.</p>" for text in sentences(result.get("fidelity", {}))),
        *(_table(result, name, about) for name, about in result["trajectories"].items()),
        f'<p class="note">{html.escape(note(result))}</p>',
        *(picture(item.read_bytes(), _CAPTIONS[item.stem.split("_")[0]]) for item in figures),
    ]
    path.write_text(page(title, "\n".join(body)), encoding="utf-8")
    return path


def _table(result: Mapping[str, Any], name: str, about: Mapping[str, Any]) -> str:
    head = "".join(f'<th scope="col">{html.escape(cell)}</th>' for cell in columns(result, name))
    body = ""
    for key, row in zip(result["errors"][name], rows(result, name), strict=True):
        first, *rest = (html.escape(cell) for cell in row)
        cells = f'<th scope="row">{first}</th>' + "".join(f"<td>{cell}</td>" for cell in rest)
        body += f"<tr{' class=ours' if key == 'model' else ''}>{cells}</tr>\n"
    table = f'<div class="wide"><table><tr>{head}</tr>\n{body}</table></div>'
    return f"<h2>{html.escape(name)}</h2>\n<p>{html.escape(_about(about))}</p>\n{table}"
