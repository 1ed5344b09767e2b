"""Packages that only some exports need."""

from __future__ import annotations

import importlib.util

from ..errors import UserError


def require(extra: str, *packages: str) -> None:
    """Raise :class:`UserError` unless all packages of an extra are installed."""
    missing = [name for name in packages if importlib.util.find_spec(name) is None]
    if missing:
        raise UserError(
            "a package is missing",
            where="export",
            received=", ".join(missing),
            fix=f"pip install -c constraints.txt -e '.[{extra}]'",
        )
