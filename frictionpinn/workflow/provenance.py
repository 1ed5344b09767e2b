"""What a result depends on: versions of packages, commit of the source."""

from __future__ import annotations

import importlib.metadata
import platform
import subprocess
from pathlib import Path

from .. import __version__

PACKAGES = ("torch", "lightning", "hydra-core", "numpy", "scipy", "sympy", "numba")


def versions() -> dict[str, str]:
    """Versions of what a result depends on."""
    found = {name: importlib.metadata.version(name) for name in PACKAGES}
    return {"frictionpinn": __version__, "python": platform.python_version(), **found}


def commit() -> str | None:
    """Commit of the source tree, with "+changes" where it is modified; None outside a repository."""

    def git(*arguments: str) -> str:
        root = Path(__file__).resolve().parents[2]
        return subprocess.run(("git", *arguments), cwd=root, capture_output=True, text=True, check=True).stdout.strip()

    try:
        return git("rev-parse", "HEAD") + ("+changes" if git("status", "--porcelain", "--untracked-files=no") else "")
    except (OSError, subprocess.CalledProcessError):
        return None
