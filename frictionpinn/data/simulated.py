"""Simulated recordings: trials written in the configuration as functions of time."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from numbers import Real
from typing import Any

import numpy as np

from ..errors import UserError, nearest
from ..numerics.paths import InputPath
from ..numerics.session import Session
from ..numerics.simulate import Simulator
from ..physics import System
from ..physics.base import at_contact
from ..physics.contacts import by_parameter, law_named
from ..physics.effect import Effect
from ..physics.mechanism import Mechanism
from .excitation import parse_expression
from .recording import Recording, Trial

_OWN_KEYS = ("name", "duration", "initial", "constants", "start")


def simulate_recording(
    system: System,
    friction: str | Mapping[str, str],
    truth: Mapping[str, Any],
    trials: Sequence[Mapping[str, Any]],
    rate_hz: float,
    effects: Sequence[str | Effect] = (),
) -> Recording:
    """Simulate trials without noise.

    Args:
        system: the mechanism's system, with its parameters' values.
        friction: name of the friction law that acts; with several contacts one for all, or one for each by its name.
        truth: parameters of the law and of the effects, SI units; an effect whose strength is not given does nothing.
            With several contacts ``{"hinge": {"mu_c": 0.1}}``, see :func:`frictionpinn.physics.contacts.by_parameter`.
        trials: each has ``duration`` (s), an expression of time for every driven coordinate (its position) and, where
            there are any, inputs; optionally ``initial`` (state name -> value), ``constants``, ``name``, and ``start``,
            its time in the session (s): without it, it begins where the one before it ended.
        rate_hz: samples per second.
        effects: what acts beside system and law, by name or made already.

    Returns:
        Recording with every coordinate's position, velocity and acceleration and the inputs used; ``truth`` holds
        friction_force, normal_force, v_slip, z and z_rate, with several contacts ``hinge.friction_force``.

    Raises:
        UserError: an unknown signal, a missing path, parameters out of range, contact lost.
    """
    law = law_named(friction, "data.friction")
    mechanism = Mechanism(system, law, tuple(effects))  # type: ignore[arg-type]
    values = by_parameter(truth, mechanism.law)
    check_truth(mechanism, values)
    return simulate_trials(mechanism, values, trials, rate_hz)


def simulate_trials(
    mechanism: Mechanism, p: Mapping[str, float], trials: Sequence[Mapping[str, Any]], rate_hz: float
) -> Recording:
    """Simulate trials of a mechanism with its effects: as :func:`simulate_recording`, the signals as sensors show them.

    The path of a driven coordinate is its true motion; delays aside, which are those of the path as it is written.

    Args:
        mechanism: system, friction law and effects.
        p: parameters by name, SI units; those of the system and the effects have defaults.
        trials, rate_hz: as in :func:`simulate_recording`.
    """
    if not rate_hz > 0:
        raise UserError("impossible sampling rate", where="data.rate_hz", received=rate_hz, allowed="above 0 Hz")
    simulator, system = Simulator(mechanism), mechanism.system
    if not isinstance(trials, Sequence) or not trials or not all(isinstance(trial, Mapping) for trial in trials):
        allowed = "a list of tables such as [{duration: 2.0, theta: 'sin(t)'}]"
        raise UserError("no trials to simulate", where="data.trials", received=trials, allowed=allowed)
    result: list[Trial] = []
    for k, trial in enumerate(trials):
        before = result[-1].end if result else 0.0
        result.append(_trial(simulator, dict(p), trial, k, rate_hz, before or 0.0))
    names = [trial.name for trial in result]
    if len(set(names)) < len(names):
        raise UserError("two trials of one name", where="data.trials", received=", ".join(names), fix="name each once")
    digest = hashlib.sha256()
    for made in result:
        for name in sorted(made.signals):
            digest.update(np.ascontiguousarray(made.signals[name]).tobytes())
    units = {name: unit for name, unit in system.signal_units.items() if name in result[0].signals}
    return Recording(tuple(result), units, f"simulated {mechanism.name}", digest.hexdigest())


def check_truth(mechanism: Mechanism, truth: Mapping[str, float]) -> None:
    """Raise :class:`UserError` for parameters that law and effects have not, lack, or that are out of range."""
    law, own = mechanism.law, {par.name for par in mechanism.system.parameters}
    parameters = [par for par in mechanism.parameters if par.name not in own]
    names = [par.name for par in parameters]
    for name in truth:
        if name not in names:
            raise UserError(
                f"unknown parameter of friction law {law.name}",
                where=f"data.truth.{name}",
                received=truth[name],
                allowed=", ".join(names),
                fix=nearest(name, names),
            )
    for par in parameters:
        value = truth.get(par.name, par.value)
        if value is None or not par.low <= float(value) <= par.high:
            raise UserError(
                f"{par.text} missing or out of range",
                where=f"data.truth.{par.name}",
                received=value,
                allowed=f"{par.low:g} to {par.high:g}",
                fix="give its value in SI units",
            )
    law.check_order(truth, "data.truth")


def _trial(
    simulator: Simulator, truth: dict[str, float], spec: Mapping[str, Any], k: int, rate_hz: float, before: float
) -> Trial:
    """Trial k; it begins at the time ``before`` of the session, s, where it does not say otherwise."""
    mechanism, where = simulator.mechanism, f"data.trials[{k}]"
    duration = spec.get("duration")
    if isinstance(duration, bool) or not isinstance(duration, Real) or not np.isfinite(float(duration)):
        raise UserError("not a number", where=f"{where}.duration", received=repr(duration), allowed="seconds",
                        fix=f"give every trial its length, at least {10 / rate_hz:g} s")  # fmt: skip
    count = round(float(duration) * rate_hz)
    if count < 10:
        raise UserError(
            "trial too short",
            where=f"{where}.duration",
            received=f"{duration} s",
            allowed=f"at least {10 / rate_hz:g} s (10 samples)",
            fix="lengthen it or raise data.rate_hz",
        )
    start = _numbers({"start": spec.get("start", before)}, f"{where}.start")["start"]
    t = np.arange(count) / rate_hz
    driven = [c.signals[0] for c in mechanism.driven]
    inputs = [item.name for item in mechanism.system.inputs]
    constants = _numbers(spec.get("constants", {}), f"{where}.constants")
    expressions = {}
    for name, text in spec.items():
        if name in _OWN_KEYS:
            continue
        if name not in driven + inputs:
            raise UserError(
                "not a driven coordinate or an input of this system",
                where=f"{where}.{name}",
                received=repr(text),
                allowed=", ".join(driven + inputs),
                fix=nearest(name, driven + inputs) or "use one of the allowed names",
            )
        expressions[name] = parse_expression(str(text), f"{where}.{name}", constants)
    initial = _numbers(spec.get("initial", {}), f"{where}.initial")
    for name in initial:
        if name not in simulator.state_names:
            raise UserError("unknown name", where=f"{where}.initial.{name}", allowed=", ".join(simulator.state_names),
                            fix=nearest(name, simulator.state_names) or "use one of the allowed names")  # fmt: skip
    path = simulator.imposed(InputPath.from_expressions(mechanism, t, expressions, Session(start, k + 1)), truth)
    run = simulator.simulate(t, path, truth, initial, z0="steady")
    unused = {name for name in inputs if name not in expressions and name not in mechanism.predictions}
    signals = {name: values for name, values in run.signals.items() if name not in unused}
    truth_signals: dict[str, np.ndarray] = {}
    for contact in run.contacts:
        at = run.at(contact)
        values = {"friction_force": at.F, "normal_force": at.N, "v_slip": at.v_slip, "z": at.z, "z_rate": at.zdot}
        truth_signals |= {at_contact(contact, name): value for name, value in values.items()}
    return Trial(str(spec.get("name", k + 1)), t, signals, truth_signals, start, k + 1)


def _numbers(table: Any, where: str) -> dict[str, float]:
    try:
        return {key: float(value) for key, value in table.items()}
    except (AttributeError, TypeError, ValueError):
        fix = "write {name: number, ...}"
        raise UserError(
            "not a table of numbers", where=where, received=repr(table), allowed="numbers", fix=fix
        ) from None
