"""The roles in docstrings (``:func:`check```) as code, for the reference."""

from __future__ import annotations

import re
from typing import Any

import griffe

ROLE = re.compile(r":(?:func|class|meth|mod|attr):`[~.]?([^`]+)`")


class Roles(griffe.Extension):
    """Replaces roles by the name alone, in code."""

    def on_object(self, *, obj: griffe.Object, **_: Any) -> None:
        """Rewrite an object's docstring before it is parsed."""
        if obj.docstring:
            obj.docstring.value = ROLE.sub(lambda match: f"`{match.group(1)}`", obj.docstring.value)
