"""Colours and units that all figures and tables share."""

from __future__ import annotations

INK = {"reference": "#222222", "model": "#d1495b", "baseline": "#8d99ae", "band": "#e8ecf1"}
INK |= {"observer": "#00798c", "simulator": "#edae49"}


def squared(unit: str) -> str:
    """Unit of a mean square error."""
    return f"({unit})^2" if "*" in unit else f"{unit}^2"
