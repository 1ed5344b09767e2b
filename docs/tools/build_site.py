"""Puts the documentation together in build/docs and builds the site from it: ``make docs``.

Pages are copied; tutorials run and get their outputs; figures and the gallery of effects are computed; equations
become MathML, so that no script from elsewhere is needed; links to files of the repository outside docs/ lead to
copies. What a page is computed from is remembered: it is computed anew only when that, or the package, has changed.
``--draft`` leaves out what takes time: tutorials without outputs, a gallery of headings, blank figures; links are
checked all the same, and the draft is in build/draft.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
DOCS, STAGE = ROOT / "docs", ROOT / "build" / "docs"
MEMORY = ROOT / "build" / "docs_made"  # what was computed, by the checksum of what it was computed from
LEFT_OUT = ("tools",)
BLOCK, INLINE = re.compile(r"^\$\$(.+?)\$\$$", re.S | re.M), re.compile(r"(?<![\w$\\])\$([^$\n]+?)\$(?!\d)")
CODE = re.compile(r"^```.*?^```|`[^`\n]+`", re.S | re.M)
LINK = re.compile(r"\]\(([^)\s#:]+)(#[^)]*)?\)")

sys.path[:0] = [str(ROOT), str(Path(__file__).parent)]


def main() -> None:
    """Stage and build; ends with MkDocs' exit status."""
    import reference

    draft = "--draft" in sys.argv
    os.environ["MPLBACKEND"] = "Agg"
    shutil.rmtree(STAGE, ignore_errors=True)
    copy_pages()
    if draft:
        stand_ins()
    else:
        made("figures", [DOCS / "tools" / "figures.py", *sorted((DOCS / "tools").glob("*_figures.py"))], figures)
        made("gallery", [DOCS / "tools" / "gallery.py", DOCS / "tools" / "beds.py"], gallery)
        for path in sorted((DOCS / "tutorials").glob("*.md")):
            made(path.stem, [path, DOCS / "tools" / "notebook.py"], lambda folder, path=path: tutorial(path, folder))
    reference.write(STAGE)
    for path in sorted(STAGE.rglob("*.md")):
        path.write_text(finished(path), encoding="utf-8")
    site = ROOT / "build" / ("draft" if draft else "site")
    environment = {**os.environ, "NO_MKDOCS_2_WARNING": "1", "DISABLE_MKDOCS_2_WARNING": "true"}
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "-d", str(site)], cwd=ROOT, env=environment
    )
    if done.returncode == 0:
        print(f"the site: {site / 'index.html'}; with search: python -m http.server -d build/{site.name}")
    sys.exit(done.returncode)


def copy_pages() -> None:
    """Everything under docs/ but the tools, and the changelog."""
    shutil.copytree(DOCS, STAGE, ignore=lambda folder, names: LEFT_OUT if Path(folder) == DOCS else ())
    shutil.copy(ROOT / "CHANGELOG.md", STAGE / "changes.md")


def made(name: str, sources: list[Path], make: Callable[[Path], None]) -> None:
    """Put what is computed into the stage: anew, or what it was when sources and package were the same."""
    tree = sorted([*(ROOT / "frictionpinn").rglob("*.py"), *(ROOT / "conf").rglob("*.yaml")])
    told = hashlib.sha256(b"".join(path.read_bytes() for path in [*sources, *tree])).hexdigest()
    folder, mark = MEMORY / name, MEMORY / f"{name}.json"
    if not mark.is_file() or json.loads(mark.read_text())["made from"] != told:
        start = time.perf_counter()
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        make(folder)
        mark.write_text(json.dumps({"made from": told}))
        print(f"{name}: {time.perf_counter() - start:.0f} s", flush=True)
    shutil.copytree(folder, STAGE, dirs_exist_ok=True)


def stand_ins() -> None:
    """Blank figures and a gallery of headings, to which links lead as to the real ones."""
    from figures import FIGURES
    from matplotlib.figure import Figure

    from frictionpinn.physics import EFFECTS

    for name in FIGURES:
        Figure(figsize=(1, 1)).savefig(STAGE / "concepts" / name)
    headings = [f"## {name} {{ #{name} }}" for name in EFFECTS]
    (STAGE / "effects.md").write_text("\n\n".join(["# Effects", *headings]), encoding="utf-8")


def figures(folder: Path) -> None:
    """The figures of the concepts."""
    from figures import draw_all

    draw_all(folder / "concepts")


def gallery(folder: Path) -> None:
    """The gallery of effects."""
    from gallery import write

    write(folder)


def tutorial(path: Path, folder: Path) -> None:
    """A tutorial with its outputs, and as a notebook."""
    from notebook import as_ipynb, page, run

    with tempfile.TemporaryDirectory() as scratch:
        shutil.copytree(ROOT / "examples", Path(scratch) / "examples")
        cells = run(path.read_text(encoding="utf-8"), Path(scratch))
    own = folder / "tutorials"
    own.mkdir()
    note = f"\n[This page as a notebook]({path.stem}.ipynb){{ download }}\n"
    (own / f"{path.stem}.ipynb").write_text(as_ipynb(cells), encoding="utf-8")
    (own / path.name).write_text(page(cells, path.stem, own / "made") + note, encoding="utf-8")


def finished(path: Path) -> str:
    """A page with MathML for its LaTeX, and with copies of the files of the repository that it links to."""
    text = path.read_text(encoding="utf-8")
    kept: list[str] = []

    def keep(match: re.Match) -> str:
        kept.append(match.group())
        return f"\0{len(kept) - 1}\0"

    text = CODE.sub(keep, text)
    text = BLOCK.sub(lambda m: f'<div class="equation">{mathml(m.group(1), "block")}</div>', text)
    text = INLINE.sub(lambda m: mathml(m.group(1), "inline"), text)
    text = LINK.sub(lambda m: f"]({near(path, m.group(1))}{m.group(2) or ''})", text)
    return re.sub("\0(\\d+)\0", lambda m: kept[int(m.group(1))], text)


def mathml(latex: str, display: str) -> str:
    """LaTeX as MathML, which browsers show by themselves."""
    from latex2mathml.converter import convert

    return " ".join(convert(latex.strip(), display=display).split("\n"))


def near(page: Path, target: str) -> str:
    """A link's target in the stage: as it is, or a copy of the repository's file that it means."""
    place = DOCS / page.relative_to(STAGE)
    meant = (ROOT / target if place.name == "changes.md" else place.parent / target).resolve()
    if not meant.is_file() or meant.is_relative_to(DOCS) or not meant.is_relative_to(ROOT):
        return target
    copy = STAGE / "files" / meant.relative_to(ROOT)
    copy.parent.mkdir(parents=True, exist_ok=True)
    shutil.copy(meant, copy)
    return os.path.relpath(copy, page.parent)


if __name__ == "__main__":
    main()
