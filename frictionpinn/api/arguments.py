"""What callers from Python may give wrongly, told in one line: configurations are checked as they are read."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from math import isfinite
from numbers import Integral, Real
from typing import Any

from ..data.recording import Recording
from ..errors import UserError, nearest
from ..identify.result import Estimate
from ..physics.mechanism import Mechanism

Values = Mapping[str, float] | Estimate


def mechanism_given(given: object) -> Mechanism:
    """A mechanism, as it is.

    Raises:
        UserError: it is something else.
    """
    if not isinstance(given, Mechanism):
        raise UserError("no mechanism", where="mechanism", received=repr(given)[:60],
                        allowed="a system with its law, such as fp.mechanism('drive', 'lugre')")  # fmt: skip
    return given


def recording_given(given: object) -> Recording:
    """A recording, as it is.

    Raises:
        UserError: it is something else.
    """
    if not isinstance(given, Recording):
        raise UserError(
            "not a recording",
            where="recording",
            received=repr(given)[:60],
            allowed="what fp.read or fp.simulate returns",
            fix="read the file first, fp.read(path, system)",
        )
    return given


def number_given(given: object, where: str, least: float = -float("inf")) -> float:
    """A finite number.

    Raises:
        UserError: it is none, or not above ``least``.
    """
    number = float(given) if isinstance(given, Real) and not isinstance(given, bool) else float("nan")
    if not isfinite(number) or not number > least:
        more = f" above {least:g}" if isfinite(least) else ""
        raise UserError("not a number", where=where, received=repr(given), allowed=f"a finite number{more}")
    return number


def seed_given(given: object) -> int:
    """A seed.

    Raises:
        UserError: it is none.
    """
    if isinstance(given, bool) or not isinstance(given, Integral) or not 0 <= int(given) < 2**32:
        raise UserError("impossible seed", where="seed", received=repr(given), allowed="a whole number from 0")
    return int(given)


def table_given(given: object, where: str, allowed: Collection[str] | None = None) -> dict[str, Any]:
    """Numbers by name, or by contact and name; none of None.

    Raises:
        UserError: no table, a name that is not ``allowed``, or a value that is no number.
    """
    if given is None:
        return {}
    if not isinstance(given, Mapping):
        raise UserError("no table", where=where, received=repr(given), allowed="numbers by name, {'mu_c': 0.3}")
    for name in given:
        if allowed is not None and name not in allowed:
            raise UserError("unknown name", where=where, received=repr(name), allowed=", ".join(allowed),
                            fix=nearest(name, allowed))  # fmt: skip
    at = {str(name): f"{where}.{name}" for name in given}
    return {name: table_given(value, at[name]) if isinstance(value, Mapping) else number_given(value, at[name])
            for name, value in zip(at, given.values(), strict=True)}  # fmt: skip


def bounds_given(given: object, where: str) -> dict[str, Any]:
    """Pairs of numbers by name, or None; none of None.

    Raises:
        UserError: no table, or an entry that is no such pair.
    """
    if given is None:
        return {}
    if not isinstance(given, Mapping):
        raise UserError("no table", where=where, received=repr(given), allowed="{'mu_c': [0.1, 0.5]}")
    for name, pair in given.items():
        if pair is None:
            continue
        if not isinstance(pair, list | tuple) or len(pair) != 2:
            raise UserError("impossible bounds", where=f"{where}.{name}", received=repr(pair), allowed="[low, high]")
        for value in pair:
            if isinstance(value, bool) or not isinstance(value, Real):
                raise UserError("not a number", where=f"{where}.{name}", received=repr(value), allowed="[low, high]")
    return dict(given)


def names_given(given: object, where: str) -> list[str]:
    """A list of names; a text is one of them and no list of letters.

    Raises:
        UserError: something else.
    """
    if isinstance(given, str) or not isinstance(given, Iterable):
        raise UserError("not a list of names", where=where, received=repr(given), allowed=f"[{given!r}]")
    return [str(name) for name in given]


def values_of(values: object) -> dict[str, float]:
    """Parameters by name, of an estimate too.

    Raises:
        UserError: something else.
    """
    found = values.values if isinstance(values, Estimate) else values
    if not isinstance(found, Mapping):
        raise UserError("no parameters", where="parameters", received=found, allowed="values by name, or an estimate")
    return dict(found)
