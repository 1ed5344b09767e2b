"""Checks of what an online estimator is given."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..errors import UserError, nearest
from ..physics.mechanism import Mechanism
from ..show import readable_unit


def finite(value: object) -> bool:
    """Whether a value is a finite number."""
    try:
        return bool(not isinstance(value, str) and np.ndim(value) == 0 and np.isfinite(float(value)))  # type: ignore[arg-type]
    except (TypeError, ValueError):
        return False


def check_above(name: str, value: float, least: float) -> None:
    """Raise :class:`UserError` for a value that is not a finite number above ``least``."""
    if not (finite(value) and value > least):
        raise UserError("impossible value", where=name, received=value, allowed=f"a number above {least:g}")


def check_least(name: str, value: float) -> None:
    """Raise :class:`UserError` for a value that is not a finite number from 0."""
    if not (finite(value) and value >= 0):
        raise UserError("impossible value", where=name, received=value, allowed="a number from 0")


def check_sensors(mechanism: Mechanism) -> None:
    """Raise :class:`UserError` where an effect changes what sensors show."""
    if mechanism.delays or dict(mechanism.outputs) != dict(mechanism.predictions):
        raise UserError(
            "effects on sensors or delays cannot be estimated online",
            where="effects",
            received=", ".join(effect.name for effect in mechanism.effects),
            allowed="effects that act on the mechanism",
            fix="correct the signals before they reach the estimator",
        )


def parameter_vector(mechanism: Mechanism, names: Sequence[str], given: Mapping[str, float]) -> np.ndarray:
    """All parameters in the order of ``names``, SI units; the system's own and the law's defaults where not given.

    Raises:
        UserError: an unknown name, a value that is missing or out of its range, static below Coulomb friction.
    """
    known = {par.name: par.value for par in mechanism.parameters} | mechanism.system.values
    for name in given:
        if name not in names:
            raise UserError(
                "unknown parameter", where=f"parameters.{name}", allowed=", ".join(names), fix=nearest(name, names)
            )
    values, ranges = known | dict(given), {par.name: par for par in mechanism.parameters}
    for name in names:
        value, par = values[name], ranges[name]
        if not finite(value):
            raise UserError("parameter without a finite value", where=f"parameters.{name}", received=value)
        if not par.low <= float(value) <= par.high:  # type: ignore[arg-type]
            unit = readable_unit(mechanism.system.unit(par))
            raise UserError("parameter out of its physical range", where=f"parameters.{name}", received=value,
                            allowed=f"{par.low:g} to {par.high:g} {unit}")  # fmt: skip
    mechanism.law.check_order(values, "parameters")  # type: ignore[arg-type]
    return np.array([float(values[name]) for name in names])  # type: ignore[arg-type]


def check_adapt(adapt: Mapping[str, float], names: Sequence[str], p: np.ndarray, covariance: np.ndarray | None) -> None:
    """Raise :class:`UserError` for a parameter that cannot follow a surface."""
    for name, rate in adapt.items():
        if name not in names:
            raise UserError(
                "unknown parameter", where=f"adapt.{name}", allowed=", ".join(names), fix=nearest(name, names)
            )
        if not (finite(rate) and rate >= 0) or p[list(names).index(name)] <= 0:
            raise UserError(
                "parameter that cannot adapt", where=f"adapt.{name}", received=rate, allowed="a rate of 0 or above "
                "for a parameter above 0",
            )  # fmt: skip
    n = len(adapt)
    if covariance is not None and (np.shape(covariance) != (n, n) or not np.isfinite(covariance).all()):
        raise UserError(
            "covariance that does not fit the parameters that adapt",
            where="covariance",
            received=f"shape {np.shape(covariance)}",
            allowed=f"shape ({n}, {n}), finite",
        )
