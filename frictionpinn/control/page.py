"""One self-contained page of a closed loop: pictures and tables, light or dark as the reader's screen."""

from __future__ import annotations

import base64
import html
import io

from matplotlib.figure import Figure

_STYLE = """:root {color-scheme: light dark; --line: #ddd; --soft: #f5f6f8; --note: #555; --ink: #222; --paper: #fff}
@media (prefers-color-scheme: dark) {
:root {--line: #3a3f47; --soft: #23272e; --note: #a9b1bc; --ink: #e6e8eb; --paper: #16191d}}
body {font: 16px/1.5 system-ui, sans-serif; max-width: 72rem; margin: 2rem auto; padding: 0 1rem; color: var(--ink);
background: var(--paper)}
.wide {overflow-x: auto} table {border-collapse: collapse; margin: 1rem 0; width: 100%; font-size: .9rem}
th, td {padding: .3rem .7rem; text-align: right; border-bottom: 1px solid var(--line);
font-variant-numeric: tabular-nums}
th:first-child, td:first-child {text-align: left} td.ours {font-weight: 600}
img {max-width: 100%; background: #fff} figcaption, p.note {color: var(--note); font-size: .9rem}
figure {margin: 2rem 0} pre {background: var(--soft); padding: .8rem; overflow-x: auto; font-size: .8rem}"""


def page(title: str, body: str) -> str:
    """A page with a title; ``body`` is HTML."""
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{html.escape(title)}</title>\n<style>{_STYLE}</style></head><body>\n"
        f"<h1>{html.escape(title)}</h1>\n{body}\n</body></html>\n"
    )


def picture(figure: Figure, caption: str) -> str:
    """A figure in the page, with its caption."""
    buffer, told = io.BytesIO(), html.escape(caption)
    figure.savefig(buffer, dpi=110, facecolor="white")
    data = base64.b64encode(buffer.getvalue()).decode("ascii")
    return f'<figure><img alt="{told}" src="data:image/png;base64,{data}"><figcaption>{told}</figcaption></figure>'
