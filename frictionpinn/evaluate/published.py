"""The published figures, from one data file, put beside ours."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from omegaconf import OmegaConf

FILE = Path(__file__).with_name("published.yaml")


def published() -> dict[str, Any]:
    """What the paper prints: source, system, and force_mse by trajectory, kind and model (N^2)."""
    return OmegaConf.to_container(OmegaConf.load(FILE))  # type: ignore[return-value]


def add_published(result: dict[str, Any], model: str, system: str | None) -> dict[str, Any]:
    """Return the result of an evaluation with ``published`` in each force_mse of the model that the paper has.

    Args:
        result: with ``errors`` by trajectory and candidate.
        model: name of the model.
        system: that was evaluated; None for a model transferred from another system, which the paper scores otherwise.
    """
    table = published()
    result["published"] = {"source": table["source"], "note": "the paper's trajectories are not published"}
    if system != table["system"]:
        return result
    for name, kinds in table["force_mse"].items():
        for kind, values in kinds.items():
            mine = result["errors"].get(name, {}).get("model", {}).get(kind, {})
            if model in values and "force_mse" in mine:
                mine["force_mse"]["published"] = values[model]
    return result
