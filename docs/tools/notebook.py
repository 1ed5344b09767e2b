"""Notebooks kept as Markdown: their cells run, their outputs put beneath them, and written as .ipynb too.

A page is a notebook in the Markdown form that jupytext reads: blocks of ``python`` are cells that share one namespace,
blocks of ``bash`` commands in the same folder, ``%%writefile name`` in a cell's first line writes the rest to a file.
The value of a cell's last line is shown: a figure as a picture, a result as its table. Other blocks are text.
"""

from __future__ import annotations

import ast
import base64
import contextlib
import io
import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
FENCE = re.compile(r"^```(python|bash)\n(.*?)^```\n?", re.S | re.M)
WRITE = re.compile(r"%%writefile (\S+)\n")
COLUMNS = "100"  # of the terminal that commands believe to write to


@dataclass
class Output:
    """What a cell showed: "text", "html" (with its plain text), or "png" (with what it is called)."""

    kind: str
    content: Any
    plain: str = ""


@dataclass
class Cell:
    """A piece of a notebook: "markdown", "python" or "bash"."""

    kind: str
    source: str
    outputs: list[Output] = field(default_factory=list)


def cells(text: str) -> list[Cell]:
    """The cells of a page, in order."""
    found, end = [], 0
    for match in FENCE.finditer(text):
        if prose := text[end : match.start()].strip("\n"):
            found.append(Cell("markdown", prose))
        found.append(Cell(match.group(1), match.group(2).rstrip("\n")))
        end = match.end()
    if prose := text[end:].strip("\n"):
        found.append(Cell("markdown", prose))
    return found


def run(text: str, folder: Path) -> list[Cell]:
    """Run the cells of a page in a folder, one after another; raises what a cell raises, with its text."""
    namespace: dict[str, Any] = {"__name__": "__main__"}
    made = cells(text)
    with _inside(folder):
        for cell in made:
            if cell.kind == "bash":
                cell.outputs = [Output("text", told)] if (told := _shell(cell.source)) else []
            elif cell.kind == "python":
                try:
                    cell.outputs = list(_python(cell.source, namespace))
                except Exception as error:
                    error.add_note(f"in the cell:\n{cell.source}")
                    raise
    for out in (out for cell in made for out in cell.outputs if out.kind == "text"):
        out.content = out.content.replace(f"{folder.resolve()}/", "")  # where it ran is nobody's business
    if pyplot := sys.modules.get("matplotlib.pyplot"):
        pyplot.close("all")
    return made


@contextlib.contextmanager
def _inside(folder: Path) -> Iterator[None]:
    """The current folder for a while; what is there can be imported."""
    before = Path.cwd()
    os.chdir(folder)
    sys.path.insert(0, str(folder))
    try:
        yield
    finally:
        os.chdir(before)
        sys.path.remove(str(folder))


def _shell(command: str) -> str:
    own = {
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
        "COLUMNS": COLUMNS,
        "NO_COLOR": "1",
    }
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH", "")]))
    done = subprocess.run(["bash", "-euc", command], capture_output=True, text=True,
                          env={**os.environ, **own, "PYTHONPATH": path})  # fmt: skip
    if done.returncode:
        raise RuntimeError(f"exit {done.returncode} of:\n{command}\n{done.stdout}{done.stderr}")
    return done.stdout.rstrip("\n")


def _python(source: str, namespace: dict[str, Any]) -> Iterator[Output]:
    if match := WRITE.match(source):
        Path(match.group(1)).write_text(source[match.end() :] + "\n", encoding="utf-8")
        return
    tree = ast.parse(source)
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    printed, value = io.StringIO(), None
    with contextlib.redirect_stdout(printed):
        exec(compile(tree, "<cell>", "exec"), namespace)
        if isinstance(last, ast.Expr):
            value = eval(compile(ast.Expression(last.value), "<cell>", "eval"), namespace)
    if told := printed.getvalue().rstrip("\n"):
        yield Output("text", told)
    if value is not None:
        yield _shown(value)


def _shown(value: Any) -> Output:
    if hasattr(value, "savefig"):
        buffer = io.BytesIO()
        value.savefig(buffer, format="png", dpi=150)
        return Output("png", buffer.getvalue(), called(value))
    if hasattr(value, "_repr_html_"):
        return Output("html", value._repr_html_(), repr(value))
    return Output("text", repr(value))


def called(figure: Any) -> str:
    """What a figure shows, in words: its titles, or the labels of its axes."""
    heading = figure.get_suptitle() if hasattr(figure, "get_suptitle") else ""
    words = [heading, *(axes.get_title() for axes in figure.axes)]
    words = [word for word in words if word] or [
        " over ".join(filter(None, (axes.get_ylabel(), axes.get_xlabel()))) for axes in figure.axes if axes.get_xlabel()
    ]
    return "; ".join(dict.fromkeys(" ".join(word.split()) for word in words)) or "figure"


def page(made: list[Cell], stem: str, folder: Path) -> str:
    """The page with its outputs; pictures are written to ``folder`` as ``stem_1.png`` and so on."""
    parts, pictures = [], 0
    for cell in made:
        parts.append(cell.source if cell.kind == "markdown" else _fenced(cell))
        for out in cell.outputs:
            if out.kind == "png":
                pictures += 1
                folder.mkdir(parents=True, exist_ok=True)
                (folder / f"{stem}_{pictures}.png").write_bytes(out.content)
                words = re.sub(r"[\[\]]", "", out.plain)
                parts.append(f"![{words}]({folder.name}/{stem}_{pictures}.png){{ .figure }}")
            elif out.kind == "html":
                parts.append(f'<div class="output">{_bare(out.content)}</div>')
            else:
                parts.append(f"```{{ .text .output }}\n{out.content}\n```")
    return "\n\n".join(parts) + "\n"


def _fenced(cell: Cell) -> str:
    if match := WRITE.match(cell.source):
        return f'```python title="{match.group(1)}"\n{cell.source[match.end() :]}\n```'
    return f"```{cell.kind}\n{cell.source}\n```"


def _bare(html: str) -> str:
    """A table of a result in the looks of the site, on one line, lest Markdown reads in it."""
    return re.sub(r"\s*\n\s*", " ", re.sub(r' style="[^"]*"', "", html))


def as_ipynb(made: list[Cell]) -> str:
    """The notebook as Jupyter's own JSON, with its outputs."""
    rows = []
    for k, cell in enumerate(made):
        if cell.kind == "markdown":
            rows.append({"cell_type": "markdown", "id": f"cell-{k}", "metadata": {}, "source": cell.source})
            continue
        source = f"%%bash\n{cell.source}" if cell.kind == "bash" else cell.source
        outputs = [_as_jupyter(out) for out in cell.outputs]
        rows.append({"cell_type": "code", "id": f"cell-{k}", "metadata": {}, "execution_count": None,
                     "source": source, "outputs": outputs})  # fmt: skip
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    book = {"cells": rows, "metadata": {"kernelspec": kernel}, "nbformat": 4, "nbformat_minor": 5}
    return json.dumps(book, indent=1, ensure_ascii=False) + "\n"


def _as_jupyter(out: Output) -> dict[str, Any]:
    if out.kind == "text":
        return {"output_type": "stream", "name": "stdout", "text": out.content + "\n"}
    if out.kind == "png":
        data = {"image/png": base64.b64encode(out.content).decode(), "text/plain": out.plain}
    else:
        data = {"text/html": out.content, "text/plain": out.plain}
    return {"output_type": "display_data", "metadata": {}, "data": data}
