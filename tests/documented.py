"""What the README and the pages of the documentation print: their blocks of code, which tests run."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGES = {
    str(path.relative_to(ROOT)): path.read_text(encoding="utf-8")
    for path in (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")))
}
PROSE = {name: text for name, text in PAGES.items() if not name.startswith("docs/tutorials/")}  # tutorials run whole


def blocks(language: str, containing: str, pages: dict[str, str] | None = None) -> list[str]:
    """Blocks of a language that contain a text, of the README first; tutorials, which run as a whole, left out."""
    found = []
    for text in (PROSE if pages is None else pages).values():
        found += re.findall(rf"^```{language}\n(.*?)^```", text, re.S | re.M)
    return [block for block in found if containing in block]


def block(language: str, containing: str) -> str:
    """The only such block, printed on one page or on several."""
    (text,) = set(blocks(language, containing))
    return text
