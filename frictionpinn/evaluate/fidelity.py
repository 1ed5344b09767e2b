"""How much closer than simulators' own friction ours comes to the truth, in simulation."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from ..show import readable_unit
from .simulators import SIMULATORS


def fidelity(errors: Mapping[str, Any]) -> dict[str, Any]:
    """Errors of each simulator's fitted friction over ours, by trajectory, simulator and what is ours.

    Ours are the identified law, where there is one, and the model of the run. Each entry holds both mean square errors
    of the force, both root mean square errors of the position, and their ratios (above 1: ours is closer).
    """
    table: dict[str, Any] = {}
    for name, methods in errors.items():
        for simulator in SIMULATORS:
            theirs = methods.get(simulator, {}).get("in_simulation", {})
            for own in ("identified", "model"):
                ours = methods.get(own, {}).get("in_simulation", {})
                if "force_mse" in theirs and "force_mse" in ours:
                    entry = {"label": methods[own]["label"], "force_mse": _ratio(theirs, ours, "force_mse")}
                    for signal in theirs.get("position_rms", {}):
                        pair = theirs["position_rms"], ours["position_rms"]
                        entry.setdefault("position_rms", {})[signal] = _ratio(*pair, signal)
                    table.setdefault(name, {}).setdefault(simulator, {})[own] = entry
    return table


def _ratio(theirs: Mapping[str, Any], ours: Mapping[str, Any], key: str) -> dict[str, Any]:
    a, b = theirs[key]["value"], ours[key]["value"]
    return {"simulator": a, "ours": b, "ratio": a / b if b > 0 else None, "unit": theirs[key]["unit"]}


def _compared(ratio: float) -> str:
    """Ours beside theirs, from their error over ours."""
    return f"{ratio:.3g} times less" if ratio >= 1 else f"{1 / ratio:.3g} times more"


def sentences(table: Mapping[str, Any]) -> Iterator[str]:
    """One sentence per trajectory, simulator and model of ours."""
    for name, found in table.items():
        for simulator, rows in found.items():
            for entry in rows.values():
                force, label = entry["force_mse"], SIMULATORS[simulator][1]
                moved = "".join(
                    f"; {signal} rms off by {pair['simulator']:.2g} and {pair['ours']:.2g} "
                    f"{readable_unit(pair['unit'])}"
                    for signal, pair in entry.get("position_rms", {}).items()
                )
                times = "" if force["ratio"] is None else f", {_compared(force['ratio'])}"
                yield (
                    f"{name}, in simulation: mean square error of the force {force['simulator']:.3g} "
                    f"{readable_unit(force['unit'])} with {label}'s own friction, fitted, and {force['ours']:.3g} with "
                    f"{entry['label']}{times}{moved}"
                )
