"""The paper's table of identified parameters, with its bounds and tie, and with bounds of a decade and none."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ..evaluate.estimators import error_against_time
from ..evaluate.published import published
from ..workflow.build import Config
from ..workflow.estimate import default_config
from ..workflow.identify import compare

PROTOCOLS = {
    "near": ("bounds=near", "friction=lugre_tied"),
    "decade": ("bounds=decade", "friction=lugre"),
}
TITLES = {
    "near": "bounds ±20 % around the truth, σ1 = √σ0",
    "decade": "bounds of a decade, σ1 free",
}


def run(options: Config, root: Path, results: Path, jobs: int) -> dict[str, Any]:
    """Every estimator under both protocols; the figure of error against time."""
    cfg = options["identification"]
    found = {}
    for name, overrides in PROTOCOLS.items():
        config = default_config(list(overrides), "identify") | {key: cfg[key] for key in cfg} | {"jobs": jobs}
        found[name] = compare(config)
    shown = {TITLES[name]: result for name, result in found.items()}
    error_against_time(shown).savefig(results / "identification.png", dpi=120)
    return {"protocols": found, "published": published()["identification"]}
