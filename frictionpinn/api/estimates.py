"""What recordings tell: parameters with their uncertainty, what a model lacks, the friction force online."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from typing import Any

from ..data.recording import Recording
from ..diagnose.diagnosis import Diagnosis
from ..errors import UserError, nearest
from ..evaluate.search_methods import METHODS
from ..identify.bound import Bound
from ..identify.bound import bound as cramer_rao
from ..identify.problem import Problem
from ..identify.result import Estimate
from ..online.estimator import OnlineEstimator
from ..physics import extensions
from ..physics.contacts import by_parameter
from ..physics.mechanism import Mechanism
from ..progress import clock
from ..workflow.configs import written
from ..workflow.diagnose import examine
from ..workflow.estimate import NETWORKS, estimate
from ..workflow.options import composed
from ..workflow.vet import admit
from .arguments import (
    Values,
    bounds_given,
    mechanism_given,
    names_given,
    number_given,
    recording_given,
    seed_given,
    table_given,
    values_of,
)


def fit(
    mechanism: Mechanism,
    recording: Recording,
    *,
    method: str = "maximum_likelihood",
    start: Mapping[str, float] | str | None = None,
    seed: int = 0,
    check: str = "refuse",
    **options: Any,
) -> Estimate:
    """Estimate the parameters of a mechanism's friction law, and of effects that ``free`` names.

    Args:
        mechanism: system, friction law, effects.
        recording: what was measured, SI units, noise included.
        method: "maximum_likelihood", "least_squares", "nelder_mead", "genetic", "pe1" or "pe2".
        start: start values by name, SI units; "pe1" or "pe2"; or the folder of a training. Without, from the data.
        seed: of what is random.
        check: "refuse" a recording that :func:`check` finds wrong, or "warn" and go on.
        options: as in the configurations: ``free``, ``fixed={"v_s": 1e-3}``, ``bounds={"mu_c": [0.1, 0.5]}``,
            ``sigmas`` (noise standard deviations by signal), ``inputs``, ``initial``, ``windows`` (s), ``loss``; of
            networks ``epochs``, of searches ``simulations``.

    Returns:
        Values, 95 % intervals and covariance (n, n), SI units, and in words what the recording does not tell.

    Raises:
        UserError: a recording that contradicts itself or the system; names, bounds or signals that do not fit; a model
            that cannot be simulated on these data.

    Examples:
        >>> import frictionpinn as fp
        >>> model = fp.mechanism("drive", "coulomb_viscous")
        >>> trials = [{"duration": 1.0, "force": "8*sin(2*pi*t)"}]
        >>> log = fp.simulate(model, {"mu_c": 3.0, "sigma_2": 2.0}, trials, rate_hz=200, noise=0.01)
        >>> fitted = fp.fit(model, log)
        >>> fitted.outcome, round(fitted.values["mu_c"], 1)
        ('converged', 3.0)
    """
    extensions.load()
    known_options("fit", options, [*_parameters_of(Problem.__init__)[3:], "epochs", "simulations"])
    mechanism, recording = mechanism_given(mechanism), recording_given(recording)
    options, seed = _checked(options, recording), seed_given(seed)
    _read(method, start, options)
    _held(mechanism, options.get("free"), options.get("fixed") or {})
    if method in NETWORKS:
        _of_network(method, mechanism, options)
    admit(mechanism.system, recording, check, options.get("free") or ())
    with clock():
        return estimate(method, mechanism, recording, start=start, seed=seed, **options)


def _read(method: str, start: object, options: Mapping[str, Any]) -> None:
    """Raise :class:`UserError` for an option of another estimator: nothing would read it."""
    network = method in NETWORKS or (isinstance(start, str) and start in NETWORKS)
    readers = {"epochs": (network, NETWORKS), "simulations": (method in METHODS, METHODS)}
    for key, (reads, methods) in readers.items():
        if options.get(key) is not None and not reads:
            raise UserError(f"an option that method='{method}' does not read", where=f"fit({key})",
                            received=repr(options[key]), allowed=f"with method {', '.join(methods)}",
                            fix="leave it out, or take such a method")  # fmt: skip


def _held(mechanism: Mechanism, free: Collection[str] | None, fixed: Mapping[str, float]) -> None:
    """Raise :class:`UserError` for a parameter of the law that ``free`` leaves out and that has no value."""
    for par in mechanism.law.parameters if free is not None else ():
        if par.value is None and par.name not in (*free, *fixed):  # type: ignore[misc]
            raise UserError("a parameter that is neither free nor fixed", where=par.name, received="without a value",
                            fix=f"give fixed={{'{par.name}': ...}}, or name it in free, too")  # fmt: skip


def _of_network(method: str, mechanism: Mechanism, options: Mapping[str, Any]) -> None:
    """Raise :class:`UserError` for what a network cannot take into account: it would be left out without a word."""
    known = ("bounds", "fixed", "epochs")
    left = [f"effects={[e.name for e in mechanism.effects]}"] if mechanism.effects else []
    left += [f"{key}={value!r}" for key, value in options.items() if key not in known and value is not None]
    if left:
        raise UserError("a network estimates the parameters of the law alone", where=f"fit(method={method!r})",
                        received=", ".join(left), allowed=", ".join(known),
                        fix="leave it out, or take method='maximum_likelihood'")  # fmt: skip


def bound(mechanism: Mechanism, recording: Recording, values: Values, **options: Any) -> Bound:
    """The least standard errors that any estimator can reach on a recording, before any fit (Cramer-Rao).

    Args:
        mechanism: system, friction law, effects.
        recording: its times, inputs and noise count: simulated, or measured.
        values: parameters at which the bound holds, by name, SI units, or an estimate.
        options: ``sigmas`` (noise standard deviations by signal; without, from the recording), ``inputs``, ``free``,
            ``fixed``, ``initial``, ``windows``.

    Returns:
        Standard errors, covariance (n, n), SI units, and in words what cannot be told.

    Raises:
        UserError: a parameter without a value; a model that cannot be simulated at these values.

    Examples:
        >>> import frictionpinn as fp
        >>> model, truth = fp.mechanism("drive", "coulomb_viscous"), {"mu_c": 3.0, "sigma_2": 2.0}
        >>> log = fp.simulate(model, truth, [{"duration": 1.0, "force": "8*sin(2*pi*t)"}], rate_hz=200, noise=0.01)
        >>> fp.bound(model, log, truth).relative["mu_c"] < 0.01
        True
    """
    extensions.load()
    known_options("bound", options, _parameters_of(Problem.__init__)[3:])
    mechanism, recording = mechanism_given(mechanism), recording_given(recording)
    return cramer_rao(mechanism, recording, values_of(values), **_checked(options, recording))


def diagnose(
    mechanism: Mechanism,
    recording: Recording,
    *,
    held_out: Sequence[str] | None = None,
    start: Mapping[str, float] | None = None,
    bounds: Mapping[str, Sequence[float]] | None = None,
    fixed: Mapping[str, float] | None = None,
    check: str = "refuse",
    **options: Any,
) -> Diagnosis:
    """What a declared model lacks in a recording: effects with their sizes, or the variable on which the rest depends.

    Args:
        mechanism: the declared model; effects in it are declared, too.
        recording: what was measured, SI units.
        held_out: names of trials that no fit sees; by default the last, or the end of the only one.
        start: start values of the declared model's parameters, by name, SI units.
        bounds: lowest and highest values, by name, SI units.
        fixed: values that are held, by name, SI units.
        check: "refuse" a recording that :func:`check` finds wrong, or "warn" and go on.
        options: as in the section ``diagnose`` of conf/diagnose.yaml: ``effects=["drag", "delay"]``, ``worth``,
            ``most``, ``log10_p``, ``fallback``, ``free``, ``signals``, ``inputs``, ``initial``, ``windows``, ``loss``.

    Returns:
        The verdict with its evidence; ``.save(folder)`` writes the page and the augmented model.

    Raises:
        UserError: a recording that contradicts itself or the system; options that there are not; a declared model that
            cannot be fitted.

    Examples:
        >>> import frictionpinn as fp
        >>> drive = fp.system("drive")
        >>> truth = fp.mechanism(drive, "coulomb_viscous", ["constant_force"])
        >>> trials = [{"duration": 1.0, "force": "8*sin(2*pi*t)"}, {"duration": 1.0, "force": "9*sin(3*pi*t)"}]
        >>> values = {"mu_c": 3.0, "sigma_2": 2.0, "constant_force": 0.5}
        >>> log = fp.simulate(truth, values, trials, rate_hz=200, noise=0.01)
        >>> missing = fp.diagnose(fp.mechanism(drive, "coulomb_viscous"), log, effects=["constant_force"])
        >>> missing.verdict, [effect["name"] for effect in missing.to_dict()["effects"]]
        ('effect found', ['constant_force'])
    """
    extensions.load()
    mechanism, recording = mechanism_given(mechanism), recording_given(recording)
    system = mechanism.system
    defaults = composed("diagnose", ["data.path=recording"])
    known_options("diagnose", options, [key for key in defaults["diagnose"] if key != "declared"])
    cfg = composed("diagnose", ["data.path=recording", *(f"diagnose.{k}={written(v)}" for k, v in options.items())])
    admit(system, recording, check, cfg["diagnose"]["free"] or ())
    cfg["diagnose"]["declared"] = [effect.name for effect in mechanism.effects]
    cfg["data"] |= {"held_out": None if held_out is None else names_given(held_out, "held_out")}
    cfg["system"] = {"name": system.name, "equations": system.equations, "driven": list(system.driven),
                     "parameters": dict(system.values)}  # fmt: skip
    given = {"start": table_given(start, "start"), "fixed": table_given(fixed, "fixed")}
    mechanism.check_values(by_parameter(given["start"], mechanism.law), "start")
    cfg["friction"] = {"name": mechanism.law.name, "bounds": bounds_given(bounds, "bounds"), **given}
    with clock():
        return examine(cfg, mechanism, recording)


def online(
    mechanism: Mechanism,
    parameters: Values,
    recording: Recording,
    *,
    adapt: Mapping[str, float] | None = None,
    check: str = "refuse",
) -> OnlineEstimator:
    """An estimator of the friction force for a controller: one sample at a time, causal, with a 95 % interval.

    Args:
        mechanism: system, friction law, effects that do not act on sensors.
        parameters: by name, SI units, or an estimate.
        recording: training trials, from which noise levels and the smoothness of the inputs are taken.
        adapt: parameters that the surface may change -> relative change per square root of a second of sliding.
        check: "refuse" a recording that :func:`check` finds wrong, or "warn" and go on.

    Returns:
        An object with ``update(t, {signal: value})``, t in s, which returns force, low, high and status.

    Raises:
        UserError: a recording that contradicts itself or the system; a parameter without a value, mu_s below mu_c; an
            effect on sensors.

    Examples:
        >>> import frictionpinn as fp
        >>> model, truth = fp.mechanism("drive", "coulomb_viscous"), {"mu_c": 3.0, "sigma_2": 2.0}
        >>> log = fp.simulate(model, truth, [{"duration": 1.0, "force": "8*sin(2*pi*t)"}], rate_hz=200, noise=0.01)
        >>> estimator, trial = fp.online(model, truth, log), log.trials[0]
        >>> for k, t in enumerate(trial.t[:50]):
        ...     reading = estimator.update(t, {name: trial.signals[name][k] for name in estimator.signals})
        >>> reading.status, reading.low < reading.force < reading.high
        ('ok', True)
    """
    mechanism, recording = mechanism_given(mechanism), recording_given(recording)
    admit(mechanism.system, recording, check)
    return OnlineEstimator.fit(mechanism, values_of(parameters), recording, table_given(adapt, "adapt"))


def _checked(options: Mapping[str, Any], recording: Recording) -> dict[str, Any]:
    """Options of a problem, what they hold checked as far as a configuration would have."""
    signals = dict.fromkeys(name for trial in recording.trials for name in trial.signals)
    checks: dict[str, Callable[[Any], Any]] = {
        "free": lambda given: names_given(given, "free"),
        "fixed": lambda given: table_given(given, "fixed"),
        "bounds": lambda given: bounds_given(given, "bounds"),
        "sigmas": lambda given: table_given(given, "sigmas", signals),
        "windows": lambda given: number_given(given, "windows", least=0.0),
        "epochs": lambda given: _whole(given, "epochs"),
        "simulations": lambda given: given if given == float("inf") else number_given(given, "simulations", least=0.0),
    }
    return {key: checks[key](value) if key in checks and value is not None else value for key, value in options.items()}


def _whole(given: object, where: str) -> int:
    if number_given(given, where, least=0.0) != int(given):  # type: ignore[call-overload]
        raise UserError("not a whole number", where=where, received=repr(given), allowed="a whole number from 1")
    return int(given)  # type: ignore[call-overload]


def _parameters_of(function: Any) -> list[str]:
    return list(inspect.signature(function).parameters)


def known_options(function: str, options: Iterable[str], allowed: Sequence[str]) -> None:
    for key in options:
        if key not in allowed:
            raise UserError("unknown option", where=function, received=key, allowed=", ".join(allowed),
                            fix=nearest(key, allowed) or "use one of the allowed names")  # fmt: skip
