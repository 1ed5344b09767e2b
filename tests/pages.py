"""What every page that a result writes has to have."""

from __future__ import annotations

import re


def assert_reads_everywhere(page: str) -> None:
    """On a phone, in the dark, read aloud: and nothing is fetched from elsewhere."""
    assert '<meta name="viewport" content="width=device-width' in page and 'lang="en"' in page
    assert "prefers-color-scheme: dark" in page and "color-scheme: light dark" in page
    assert page.count("<table") == page.count('<div class="wide"><table') == page.count("</table></div>") > 0
    assert all("scope=" in head for head in re.findall(r"<th\b[^>]*>", page))
    assert all("alt=" in image for image in re.findall(r"<img\b[^>]*>", page, re.S))
    assert not re.search(r'(?:src|href)="?http', page)
