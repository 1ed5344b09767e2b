"""Numbers in words, as every report says them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ..show import estimated, interval

LEAST_CHANCE = -100  # decimal logarithm: no noise is known so well that smaller ones differ


def number(value: float | None, ci95: Sequence[float | None] = ()) -> str:
    """Four significant digits, more where the 95 % interval is so narrow."""
    return "?" if value is None else estimated(value, ci95)


def span(ci95: Sequence[float | None]) -> str:
    """A 95 % interval in words."""
    return interval(ci95) if None not in ci95 else "not told by these data"


def chance(log10_p: float) -> str:
    """A chance from its decimal logarithm: 1e-38; what is below any that a model of noise could tell has no figure."""
    return f"below 1e{LEAST_CHANCE:d}" if log10_p < LEAST_CHANCE else f"{10.0**log10_p:.1g}"


def share(told: Mapping[str, Any]) -> str:
    """A share with its 95 % interval, in per cent."""
    if told["value"] is None:
        return "?"
    value, low, high = (f"{100 * x:.0f}" for x in (told["value"], *told["ci95"]))
    return f"{value} % ({low} to {high} %)"


def spaced(name: str) -> str:
    return name.replace("_", " ")
