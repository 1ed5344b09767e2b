"""Which trials train, validate and are held out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ..errors import UserError, nearest


def split_trials(
    names: Sequence[str],
    held_out: Sequence[Any] | None,
    validation: Sequence[Any] | None = None,
    training: int | None = None,
) -> dict[str, list[str]]:
    """Names of the trials to train on, to validate on and to hold out; never parts of one trial.

    ``held_out`` None holds out the last trial where there are several. ``training`` is how many of the others to train
    on, spread evenly over them; None: all.

    Raises:
        UserError: a name that no trial has, one trial in two splits, nothing left to train on, more trials than there
            are.
    """
    held = [names[-1]] if held_out is None and len(names) > 1 else _parts(_names(held_out), names)
    valid = _parts(_names(validation), names)
    for key, chosen in (("held_out", held), ("validation", valid)):
        for name in chosen:
            if name not in names:
                raise UserError(
                    "no such trial",
                    where=f"data.{key}",
                    received=name,
                    allowed=", ".join(names),
                    fix=nearest(name, names) or "use the names of the trials",
                )
    train = [name for name in names if name not in held and name not in valid]
    if set(held) & set(valid) or not train:
        raise UserError(
            "splits overlap or leave nothing to train on",
            where="data.held_out, data.validation",
            received=f"{held}, {valid}",
            allowed="disjoint trials, at least one left to train on",
            fix=f"the recording has the trials {', '.join(names)}",
        )
    return {"train": _spread(train, training), "validation": valid, "held_out": held}


def _spread(names: list[str], count: int | None) -> list[str]:
    """So many of the names, spread evenly: of five, one is the third, two the second and fourth."""
    if count is None:
        return names
    if isinstance(count, bool) or not isinstance(count, int) or not 1 <= count <= len(names):
        raise UserError(
            "impossible number of trials",
            where="data.training_trials",
            received=count,
            allowed=f"1 to {len(names)}, or null for all",
        )
    return [names[int((k + 0.5) * len(names) / count)] for k in range(count)]


def _parts(chosen: list[str], names: Sequence[str]) -> list[str]:
    """The names, or those of the parts into which a trial was cut at gaps: lap[0], lap[1], ..."""
    found = [[other for other in names if other.startswith(f"{name}[")] if name not in names else [] for name in chosen]
    return [part for name, parts in zip(chosen, found, strict=True) for part in parts or [name]]


def _names(chosen: Any) -> list[str]:
    """Names as text; one name alone counts as a list of one."""
    chosen = [chosen] if isinstance(chosen, str | int | float) else chosen or ()
    return [str(name) for name in chosen]
