"""What every test shares: one thread, no display, the public recordings where they lie, a folder of its own."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

os.environ["MPLBACKEND"] = "Agg"
# Before torch is imported: the workers of pytest-xdist would otherwise contend for the cores.
os.environ["OMP_NUM_THREADS"] = os.environ["MKL_NUM_THREADS"] = "1"

_MEASURED = Path(__file__).resolve().parents[2] / "shared" / "measured"
if not os.environ.get("FRICTIONPINN_DATA") and _MEASURED.is_dir():
    os.environ["FRICTIONPINN_DATA"] = str(_MEASURED)


@pytest.fixture
def workdir(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty temporary folder that is the current one, so that outputs/ of a run lands there."""
    monkeypatch.chdir(tmp_path)
    return tmp_path
