"""Compensators by name, from conf/control, for an identified axis."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import sympy as sp

from ..errors import UserError, choose
from ..online.check import parameter_vector
from ..physics import CONTACT, LAWS
from ..physics.mechanism import Mechanism
from .compensator import Compensator, check_axis

NOTHING = "none"


def build_compensator(
    config: Mapping[str, Any], mechanism: Mechanism, parameters: Mapping[str, float], **loop: Any
) -> Compensator | None:
    """The compensator that a file of conf/control describes, or None where it is to add nothing.

    Args:
        config: name; friction (a law in the place of the identified one, ``none`` for no law, null for the identified
            one with its effects); transition (v_t of a law that has one, as a share of v_s); adapt and spread by
            parameter, those that the axis lacks or that are 0 left out; disturbance and limit in units of the dry
            friction (per root of a second); bandwidth in Hz; gain.
        mechanism, parameters: as identified, SI units.
        loop: interval, delay and resolution, see :class:`Compensator`.

    Raises:
        UserError: an unknown law, one whose parameters are not among those given, a mechanism that is no axis.
    """
    if config["name"] == NOTHING:
        return None
    check_axis(mechanism)
    level, values, own = dry_friction(mechanism, parameters), dict(parameters), mechanism
    if config["friction"] == NOTHING:
        own, values = Mechanism(mechanism.system, LAWS["coulomb"]()), dict(parameters) | {"mu_c": 0.0}
    elif config["friction"] is not None:
        own = Mechanism(mechanism.system, choose(config["friction"], LAWS, "control.friction")())
    names = {par.name: par for par in own.parameters}
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
        **loop,
    )


def dry_friction(mechanism: Mechanism, parameters: Mapping[str, float]) -> float:
    """Dry friction at the edge of sliding, in the system's unit of force: the scale of a compensator's numbers."""
    law, system = mechanism.law, mechanism.system
    names = [par.name for par in mechanism.parameters]
    vector = parameter_vector(mechanism, names, {name: parameters[name] for name in names if name in parameters})
    values = dict(zip(names, vector.tolist(), strict=True))
    rest = {symbol: 0 for c in system.moving for symbol in c.symbols} | {item.symbol: 0 for item in system.inputs}
    capacity = sp.sympify(law.capacity(CONTACT, law.symbols)).subs({CONTACT.v: 0}).subs(CONTACT.N, system.N.subs(rest))
    return float(capacity.subs({par.symbol: values[par.name] for par in mechanism.parameters}))
