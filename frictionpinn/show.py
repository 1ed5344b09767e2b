"""How results show themselves: as text, in a notebook, as figures, as plain types and in files."""

from __future__ import annotations

import base64
import html
import io
import math
import sys
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from .errors import choose, unwritten

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST_ROWS = 12  # of a table as text: what fits on a screen with what stands around it
WIDTH, LEAST = 110, 12  # of a table as text; of a column that gives way to others
STYLE = "text-align:left;padding:2px 12px 2px 0;font-variant-numeric:tabular-nums"

# Of the pages that results write: light or dark as the reader's system is, tables wider than the screen scroll in
# <div class="wide">, figures, which are drawn on white, turned over in the dark with their hues kept. Rows and cells of
# class "ours" stand out.
LOOKS = """:root {color-scheme: light dark; --ink: #222; --paper: #fff; --soft: #555; --line: #ddd; --box: #f5f6f8}
@media (prefers-color-scheme: dark) {
:root {--ink: #ddd; --paper: #16191d; --soft: #a5abb3; --line: #3a3f46; --box: #22262c}
img {filter: invert(.9) hue-rotate(180deg)}
}
body {font: 16px/1.5 system-ui, sans-serif; max-width: 62rem; margin: 2rem auto; padding: 0 1rem;
color: var(--ink); background: var(--paper); overflow-wrap: break-word}
.wide {overflow-x: auto; margin: 1rem 0}
table {border-collapse: collapse; width: 100%}
th, td {padding: .3rem .7rem; text-align: right; border-bottom: 1px solid var(--line);
font-variant-numeric: tabular-nums}
th:first-child, td:first-child {text-align: left}
th[scope=row] {font-weight: inherit}
td.ours, tr.ours > * {font-weight: 600} small {white-space: nowrap}
img {max-width: 100%; height: auto} figure {margin: 2rem 0}
figcaption, p.note {color: var(--soft); font-size: .9rem}
pre {background: var(--box); padding: .6rem; overflow-x: auto; font-size: .8rem}"""


@dataclass(frozen=True, repr=False)
class Table:
    """Rows under headings.

    Attributes:
        columns: headings.
        rows: cells; numbers are shown with four digits, None as nothing.
        title: a line above.
        notes: sentences below.
    """

    columns: tuple[str, ...]
    rows: tuple[tuple[object, ...], ...] = ()
    title: str = ""
    notes: tuple[str, ...] = ()

    @property
    def names(self) -> list[str]:
        """The first cell of every row."""
        return [str(row[0]) for row in self.rows]

    def to_dict(self) -> dict[str, dict[str, object]]:
        """First cell -> the others by their headings."""
        return {str(row[0]): dict(zip(self.columns[1:], row[1:], strict=True)) for row in self.rows}

    def text(self, most: int | None = None) -> str:
        """Aligned columns, long cells in several lines; of more than ``most`` rows the first ones."""
        cells = [list(self.columns), *([_cell(value) for value in row] for row in self.rows[:most])]
        widths = [max(len(row[k]) for row in cells) for k in range(len(self.columns))]
        while sum(widths) + 2 * len(widths) > WIDTH and max(widths) > LEAST:
            widths[widths.index(max(widths))] -= 1
        lines = [line for row in cells for line in _lines(row, widths)]
        rest = len(self.rows) - len(cells) + 1
        more = [f"  and {rest} more"] if rest else []
        said = [textwrap.fill(text, WIDTH) for text in (self.title, *self.notes)]
        return "\n".join([*filter(None, said[:1]), *(lines if self.rows else []), *more, *said[1:]])

    def __repr__(self) -> str:
        return self.text()

    def _repr_html_(self) -> str:
        head = "".join(f'<th scope="col" style="{STYLE}">{html.escape(name)}</th>' for name in self.columns)
        body = "".join(
            "<tr>" + "".join(f'<td style="{STYLE}">{html.escape(_cell(value))}</td>' for value in row) + "</tr>"
            for row in self.rows
        )
        table = f'<div style="overflow-x:auto"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'
        title = f"<p><strong>{html.escape(self.title)}</strong></p>" if self.title else ""
        return title + (table if self.rows else "") + "".join(f"<p>{html.escape(note)}</p>" for note in self.notes)


def _lines(row: Sequence[str], widths: Sequence[int]) -> list[str]:
    """A row of a table as lines of text."""
    cells = [textwrap.wrap(cell, width) if width else [] for cell, width in zip(row, widths, strict=True)]
    lines = zip_longest(*cells, fillvalue="")
    return [f"  {'  '.join(c.ljust(w) for c, w in zip(line, widths, strict=True))}".rstrip() for line in lines]


def _cell(value: object) -> str:
    if value is None:
        return ""
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def interval(ends: Sequence[float | None]) -> str:
    """A 95 % interval as people write it; empty where there is none."""
    low, high = (math.nan if end is None else float(end) for end in ends)
    return "" if low != low and high != high else f"{estimated(low, ends)} to {estimated(high, ends)}"


def estimated(value: float, ends: Sequence[float | None]) -> str:
    """A value with so many digits, four at least, that the ends of its interval differ by ten of the last."""
    told = [float(end) for end in ends if end is not None and math.isfinite(end)]
    size, width = max(map(abs, told), default=0.0), max(told, default=0.0) - min(told, default=0.0)
    apart = math.ceil(math.log10(size / width)) + 1 if width > 0 else 0
    return f"{value:.{min(max(apart, 4), 15)}g}"


def plain(value: float) -> float | None:
    """A float for JSON; None where it is not finite."""
    return float(value) if math.isfinite(value) else None


def readable_unit(unit: str) -> str:
    """A unit for a table: N*m becomes N m, a square gets its sign, a ratio has none."""
    return "" if unit == "1" else unit.replace("**", "^").replace("*", " ").replace("^2", "²")


def unit_of_error(unit: str) -> str:
    """As :func:`readable_unit`; an error of several contacts is a share, that of each over its own force."""
    return readable_unit(unit) or "of the force"


class Shown:
    """A result. Subclasses say :meth:`tables`, :meth:`figures` and :meth:`to_dict`; the rest follows from these.

    Attributes:
        most_rows: of a table as text; None: all, as of parameters.
    """

    most_rows: ClassVar[int | None] = MOST_ROWS

    def tables(self) -> list[Table]:
        """What there is to read."""
        raise NotImplementedError

    def figures(self) -> dict[str, Figure]:
        """What there is to see, by name."""
        return {}

    def to_dict(self) -> dict[str, Any]:
        """Plain types, as in ``result.json``."""
        raise NotImplementedError

    def plot(self, name: str | None = None) -> Figure:
        """One of the figures, by default the first, as matplotlib's: ``.plot().savefig("fit.png")``.

        Raises:
            UserError: no figure of that name; the line lists them.
        """
        if "IPython" in sys.modules:
            import matplotlib.pyplot  # noqa: F401  (teaches a notebook to show figures)
        drawn = self.figures()
        return drawn[next(iter(drawn))] if name is None else choose(name, drawn, "figure")

    def save(self, folder: str | Path) -> Path:
        """Write ``result.json`` and every figure as PNG to a folder, made where it is missing; returns it."""
        from .workflow.manifest import write_json

        folder = folder_at(folder)
        write_json(folder / "result.json", self.to_dict())
        for name, figure in self.figures().items():
            (folder / f"{name}.png").write_bytes(png(figure))
        return folder

    def __repr__(self) -> str:
        return "\n".join(table.text(self.most_rows) for table in self.tables())

    def _repr_html_(self) -> str:
        parts = [table._repr_html_() for table in self.tables()]
        for name, figure in self.figures().items():
            data = base64.b64encode(png(figure)).decode()
            parts.append(f'<img alt="{html.escape(name)}" style="max-width:100%" src="data:image/png;base64,{data}">')
        return "\n".join(parts)


def folder_at(place: str | Path) -> Path:
    """A folder, made where it is missing.

    Raises:
        UserError: it cannot be made.
    """
    folder = Path(place)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise unwritten(error, folder, "name another folder") from error
    return folder


def png(figure: Figure) -> bytes:
    """A figure as the content of a PNG file."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=100)
    return buffer.getvalue()


def page(title: str, body: str) -> str:
    """One self-contained page with a title; ``body`` is HTML."""
    title = html.escape(title)
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{title}</title>\n<style>\n{LOOKS}\n</style></head><body>\n<h1>{title}</h1>\n{body}\n</body></html>\n"
    )


def picture(content: bytes, caption: str) -> str:
    """A figure in a page, the content of its PNG file and all, with a caption."""
    data, told = base64.b64encode(content).decode(), html.escape(caption)
    return f'<figure><img alt="{told}" src="data:image/png;base64,{data}"><figcaption>{told}</figcaption></figure>'
