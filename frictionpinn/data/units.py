"""Conversion of recorded columns to SI units."""

from __future__ import annotations

import re
from functools import cache
from typing import Any

import numpy as np

from frictionpinn.errors import UserError, nearest

DIMENSIONLESS = ("", "1", "-", "dimensionless")

# Names offered where a unit is unknown or has the wrong dimension.
_COMMON = (
    *("m", "cm", "mm", "um", "in", "ft", "m/s", "mm/s", "cm/s", "in/s", "ft/s", "m/s^2", "cm/s^2", "mm/s^2", "in/s^2"),
    *("rad", "deg", "turn", "mrad", "rad/s", "deg/s", "rpm", "turn/s", "mrad/s", "rad/s^2", "deg/s^2", "turn/s^2"),
    *("N", "kN", "mN", "lbf", "kip", "kgf", "N*m", "mN*m", "kN*m", "in*lbf", "ft*lbf", "s", "ms", "us", "min"),
    *("kg", "g", "lb", "N/m", "N/mm", "kN/mm", "lbf/in", "N*m/rad", "N*s/m", "N*m*s/rad", "kg*m^2"),
    *("V", "mV", "A", "mA", "K", "degC", "Pa", "kPa", "MPa", "W", "dimensionless", "percent"),
)
_SPELLED_OUT = ("meter", "millimeter", "inch", "radian", "degree", "newton", "kilonewton", "pound", "second", "volt")

# Spellings that pint reads as something else, or not at all.
_SPELLING = {"Nm": "N*m", "mNm": "mN*m", "kNm": "kN*m", "°/s": "deg/s", "-": "dimensionless", "1": "dimensionless"}

ROTARY = {"m": "rad", "m/s": "rad/s", "m/s^2": "rad/s^2", "N": "N*m"}  # what a linear axis measures, and one that turns

# A pound is a mass to pint; recorders of force write "lb" all the same.
_AS_FORCE = re.compile(r"\b(?:lbs?|pounds?)\b")


@cache
def registry() -> Any:
    """Return the one pint registry of the process, made on first use because making it takes a while."""
    import pint

    return pint.UnitRegistry()


def to_si(values: np.ndarray, unit: str, signal_unit: str, where: str) -> np.ndarray:
    """Convert ``values`` from ``unit`` to the SI unit of a signal.

    Args:
        values: array of any shape, in ``unit``.
        unit: unit of the values ("mm/s", "deg", "kip"); "SI" leaves the values as they are. A pound is read as
            pound-force where the signal is a force, a torque or a stiffness, and "g" as standard gravity where it
            is an acceleration.
        signal_unit: SI unit that the signal wants ("m/s", "N*m", "" for none).
        where: what the error shall name, such as ``units.force``.

    Returns:
        Array of the same shape, float64, in ``signal_unit``.

    Raises:
        UserError: the unit is unknown, or has another dimension than the signal.
    """
    values = np.asarray(values, dtype=float)
    unit, signal_unit = str(unit).strip(), str(signal_unit).strip()
    if unit == "SI" or unit == signal_unit or (unit in DIMENSIONLESS and signal_unit in DIMENSIONLESS):
        return values
    target = _parse(signal_unit, signal_unit, where)
    source = _matching(unit, target, signal_unit, where)
    # An angle has no dimension: 1/min, Hz and counts would pass for radians, and a factor of 2 pi would be lost.
    if _angles(target) > 0 and _angles(source) != _angles(target):
        raise UserError(
            "a unit without an angle where the signal turns",
            where=where,
            received=repr(unit),
            allowed=_allowed(target),
            fix="write turn, turn/s or rpm where it counts revolutions; of an encoder's counts write rad, and rad per "
            "count in gains",
        )
    return np.asarray(registry().Quantity(values, source).to(target).magnitude, dtype=float)


def _matching(unit: str, target: Any, signal_unit: str, where: str) -> Any:
    """Return the pint unit with the dimension of ``target`` that ``unit`` means."""
    source = _parse(unit, signal_unit, where)
    if source.dimensionality == target.dimensionality:
        return source
    readings = [_AS_FORCE.sub("lbf", unit)]
    if unit in ("g", "G"):
        readings.append("standard_gravity")
    for reading in readings:
        other = _parse(reading, signal_unit, where)
        if other.dimensionality == target.dimensionality:
            return other
    turns = (
        signal_unit in ROTARY and source.dimensionality == registry().parse_units(ROTARY[signal_unit]).dimensionality
    )
    rotary = "; an axis that turns, in rad and N m, is system=joint" if turns else ""
    raise UserError(
        f"unit has the wrong dimension: {_dimension(source)} where the signal needs {_dimension(target)}",
        where=where,
        received=repr(unit),
        allowed=_allowed(target),
        fix=f"correct the unit, or the column that this signal reads{rotary}",
    )


def _parse(unit: str, signal_unit: str, where: str) -> Any:
    spelled = _SPELLING.get(unit, unit).replace("·", "*").replace("⋅", "*")
    # "m/s2" and "kg m2" are common in file headers.
    spelled = re.sub(r"\brev\b", "turn", spelled)
    powers = re.sub(r"(?<=[A-Za-z])(\d)", r"**\1", spelled)
    for text in dict.fromkeys((spelled, powers)):
        parsed = _try_parse(text)
        if parsed is not None:
            return parsed
    names = of_dimension(signal_unit)
    raise UserError(
        "unknown unit",
        where=where,
        received=repr(unit),
        allowed=", ".join(names) or "any unit that pint knows",
        fix=nearest(unit, names) or nearest(unit, (*_COMMON, *_SPELLED_OUT)) or "write the unit as in mm/s, N*m or deg",
    )


@cache
def _try_parse(text: str) -> Any:
    if len(text) > 60:
        return None
    try:
        return registry().Unit(text)
    except Exception:  # pint's parser raises errors of many kinds on malformed text; all mean "no such unit"
        return None


def _angles(unit: Any) -> int:
    """Power of the angle in a unit: 1 of rpm, 0 of 1/min, -1 of N*m/rad."""
    items = registry().Quantity(1.0, unit).to_root_units().unit_items()
    return int({str(name): power for name, power in items}.get("radian", 0))


def _dimension(unit: Any) -> str:
    return str(unit.dimensionality)


def _allowed(target: Any) -> str:
    return ", ".join(_like(target)) or str(target)


def _like(target: Any) -> list[str]:
    angular = "radian" in str(target)
    names = [name for name in _COMMON if _try_parse(name).dimensionality == target.dimensionality]
    if target.dimensionless:
        return [name for name in names if angular == (name not in ("dimensionless", "percent"))]
    return names


def of_dimension(signal_unit: str) -> list[str]:
    """Common names of units with the dimension of a signal's SI unit; none for a unit that pint does not know."""
    target = _try_parse(_SPELLING.get(signal_unit, signal_unit))
    return [] if target is None else _like(target)


def like(unit: str, signal_unit: str) -> bool:
    """Whether a unit can be that of a signal with this SI unit."""
    try:
        to_si(np.zeros(0), unit, signal_unit, "")
    except UserError:
        return False
    return True
