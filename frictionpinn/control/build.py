"""Compensators by name, from conf/control, for an identified axis."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..errors import UserError, choose, nearest
from ..online.check import finite
from ..physics import LAWS
from ..physics.mechanism import Mechanism
from .compensator import Compensator, check_axis, dry_friction

NOTHING = "none"
OPTIONS = ("name", "friction", "transition", "adapt", "spread", "disturbance", "bandwidth", "limit", "gain", "uneven",
           "cells")  # fmt: skip


def build_compensator(
    config: Mapping[str, Any], mechanism: Mechanism, parameters: Mapping[str, float], **loop: Any
) -> Compensator | None:
    """The compensator that a file of conf/control describes, or None where it is to add nothing.

    Args:
        config: name; friction (a law in the place of the identified one, ``none`` for no law, null for the identified
            one with its effects); transition (v_t of a law that has one, as a share of v_s); adapt and spread by
            parameter, those that the axis lacks or that are 0 left out; disturbance and limit in units of the dry
            friction (per root of a second); bandwidth in Hz; uneven and cells, see :class:`Compensator`; gain.
        mechanism, parameters: as identified, SI units.
        loop: interval, delay, resolution and stroke, see :class:`Compensator`.

    Raises:
        UserError: an unknown law, one whose parameters are not among those given, a mechanism that is no axis.
    """
    if config["name"] == NOTHING:
        return None
    check_axis(mechanism)
    for key in config:
        if key not in OPTIONS:
            raise UserError("unknown key", where="control", received=key, allowed=", ".join(OPTIONS),
                            fix=nearest(key, OPTIONS))  # fmt: skip
    for key in ("adapt", "spread"):
        if not isinstance(config[key], Mapping):
            raise UserError("no table by parameter", where=f"control.{key}", received=config[key],
                            allowed="a number by parameter, such as {mu_c: 0.1}")  # fmt: skip
    for key, least in (("limit", "above 0"), ("disturbance", "from 0"), ("transition", "above 0")):
        value = config[key]  # told as it was given, before it is multiplied
        if not (value is None and key == "transition") and not (
            finite(value) and (value > 0 or (value == 0 and least == "from 0"))
        ):
            raise UserError("impossible value", where=key, received=value, allowed=f"a number {least}")
    level, own = dry_friction(mechanism, parameters), mechanism
    values = {name: value for name, value in (mechanism.system.values | dict(parameters)).items() if value is not None}
    if not level > 0:
        raise UserError("no dry friction", where="parameters", received=f"{level:g} {mechanism.system.force_unit}",
                        allowed="above 0: it is the unit of limit and disturbance")  # fmt: skip
    if config["friction"] == NOTHING:
        own, values = Mechanism(mechanism.system, LAWS["coulomb"]()), values | {"mu_c": 0.0}
    elif config["friction"] is not None:
        own = Mechanism(mechanism.system, choose(config["friction"], LAWS, "control.friction")())
    names = {par.name: par for par in own.parameters}
    if config["transition"] is not None and config["friction"] is None and "v_t" not in names:
        raise UserError("an option that nothing reads", where="transition", received=config["transition"],
                        allowed="with a law that has v_t, beside a v_s", fix="leave it out")  # fmt: skip
    if config["transition"] is not None and "v_t" in names and "v_s" in values:
        values["v_t"] = config["transition"] * values["v_s"]
    values = {name: value for name, value in values.items() if name in names}
    lacking = [par.name for par in own.law.parameters if par.value is None and par.name not in values]
    if lacking:
        raise UserError("law without its parameters", where="control.friction", received=own.law.name,
                        allowed=f"a law whose parameters were identified; {', '.join(lacking)} were not",
                        fix=f"identify with friction={own.law.name}, or take another arm")  # fmt: skip
    adapt = {name: rate for name, rate in config["adapt"].items() if values.get(name, 0.0) > 0.0}
    return Compensator(
        own,
        values,
        adapt=adapt,
        spread={name: share for name, share in config["spread"].items() if name in adapt},
        disturbance=config["disturbance"] * level,
        bandwidth=config["bandwidth"],
        limit=config["limit"] * level,
        gain=config["gain"],
        uneven=config["uneven"],
        cells=config["cells"],
        **loop,
    )
