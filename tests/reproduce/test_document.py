"""The page of the reproduction is what its result files say."""

from __future__ import annotations

from pathlib import Path

from frictionpinn.reproduce.document import document

ROOT = Path(__file__).resolve().parents[2]


def test_every_number_of_the_page_comes_from_the_result_files():
    assert (ROOT / "docs" / "paper.md").read_text(encoding="utf-8") == document(ROOT / "docs" / "paper")


def test_every_figure_that_the_page_shows_is_there():
    page = (ROOT / "docs" / "paper.md").read_text(encoding="utf-8")
    shown = [part.split(")")[0] for part in page.split("](")[1:] if ".png)" in part]
    assert shown and all((ROOT / "docs" / name).is_file() for name in shown)
