"""Build what a recording comes from and goes through, from a configuration (plain values, as resolved by Hydra)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..data.check import check_sizes, check_trial
from ..data.noise import GaussianNoise, Noise, NoNoise, OutlierNoise, QuantisedNoise
from ..data.prepare import resample, thin
from ..data.read import read_recording, tells_starts
from ..data.recording import Recording
from ..data.sets import load_public
from ..data.simulated import simulate_recording
from ..data.thresholds import JITTER
from ..errors import UserError, choose, nearest
from ..numerics.kalman import KalmanFilter, KalmanSmoother
from ..numerics.smoothing import NoSmoothing, SavitzkyGolay, Smoother, SmoothingSpline
from ..physics import LAWS, SYSTEMS, FrictionLaw, System
from ..physics.base import at_contact
from ..physics.contacts import by_parameter, law_named, laws_of

Config = dict[str, Any]
NAMED = 8  # columns by name in a line

NOISE: dict[str, Callable[..., Noise]] = {
    "none": NoNoise,
    "gaussian": GaussianNoise,
    "quantised": QuantisedNoise,
    "outliers": OutlierNoise,
}
SMOOTHING: dict[str, tuple[Callable[..., Any], Callable[..., Any]]] = {
    "none": (NoSmoothing, lambda **options: NoSmoothing(causal=True, **options)),
    "savgol": (SavitzkyGolay, lambda **options: NoSmoothing(causal=True, **options)),
    "spline": (SmoothingSpline, lambda **options: NoSmoothing(causal=True, **options)),
    "kalman": (KalmanSmoother, KalmanFilter),
}


def mapping(cfg: Config, key: str, where: str) -> dict[str, Any]:
    """A table of the configuration, empty for null; :class:`UserError` for anything else."""
    value = cfg.get(key)
    if value is not None and not isinstance(value, dict):
        allowed = "a table such as {key: value}, or null"
        raise UserError("not a table", where=f"{where}.{key}", received=repr(value), allowed=allowed)
    return {str(name): item for name, item in (value or {}).items()}


def build_system(cfg: Config) -> System:
    """The system with the values of its parameters; with ``augmented``, the one that a diagnosis saved."""
    if cfg.get("augmented"):
        from ..export.augmented import folded

        return folded(cfg["augmented"])[0]
    if cfg["name"] == "robot":
        raise UserError("a robot in a command that does not know robots", where="system", received="robot",
                        allowed="check, train, identify, diagnose", fix="choose one of them")  # fmt: skip
    kind = choose(cfg["name"], SYSTEMS, "system", fix="name the file that defines it, extensions=[FILE.py]")
    imposed = bool(cfg.get("imposed")) and not kind.massless
    driven = cfg.get("driven")
    return kind(equations=cfg.get("equations", "lagrange"), driven=None if driven is None else tuple(driven),
                imposed=imposed, **(cfg.get("parameters") or {}))  # fmt: skip


def build_friction(cfg: Config, system: System) -> FrictionLaw:
    """The friction law of a system: ``name`` at every contact, but those that ``contacts`` gives one of their own.

    Raises:
        UserError: an unknown law or contact.
    """
    own = mapping(cfg, "contacts", "friction")
    if not own:
        return laws_of(system, law_named(cfg["name"], "friction"))
    everywhere = {contact.name: cfg["name"] for contact in system.contacts if len(system.contacts) > 1}
    return laws_of(system, law_named(everywhere | own, "friction"))  # type: ignore[arg-type]


def estimated_law(cfg: Config, system: System) -> FrictionLaw:
    """The law whose parameters are estimated without a network.

    Raises:
        UserError: an option of networks alone.
    """
    if cfg.get("tie_sigma1"):
        raise UserError("acts in trainings alone", where="friction.tie_sigma1", received=True,
                        fix="take the law that has sigma_1 = sqrt(sigma_0), friction=lugre_tied")  # fmt: skip
    return build_friction(cfg, system)


def law_table(cfg: Config, key: str, law: FrictionLaw) -> dict[str, Any]:
    """``start``, ``bounds`` or ``fixed`` of the friction law by parameter, without those that are null."""
    table, known = by_parameter(mapping(cfg, key, "friction"), law), {par.name for par in law.parameters}
    # What conf/friction says of a law that no contact has, where each was given one of its own.
    left_out = {par.name for par in LAWS[cfg["name"]].parameters} - known if cfg.get("contacts") else set()
    return {name: value for name, value in table.items() if value is not None and name not in left_out}


def build_noise(cfg: Config) -> Noise:
    """The noise that is added to a recording."""
    make = choose(cfg["name"], NOISE, "noise")
    return _make(make, {key: value for key, value in cfg.items() if key != "name"}, "noise")


def build_smoothing(cfg: Config) -> tuple[Smoother, Smoother]:
    """The smoother for training and the causal one for online use."""
    offline, online = choose(cfg["name"], SMOOTHING, "smoothing")
    makers = {"offline": offline, "online": online}
    two_sided, causal = (
        _make(make, mapping(cfg, key, "smoothing"), f"smoothing.{key}") for key, make in makers.items()
    )
    return two_sided, causal


def _make(make: Callable[..., Any], options: Any, where: str) -> Any:
    try:
        return make(**options)
    except TypeError as error:
        fix = str(error).rpartition("__init__() ")[2]
        raise UserError("options that do not fit", where=where, received=options, fix=fix) from error


def check_pairing(cfg: Config) -> None:
    """Raise :class:`UserError` where a public set is used with another system than its own."""
    wanted, name = cfg["data"].get("for_system"), cfg["system"]["name"]
    if wanted and wanted != name:
        raise UserError(
            "data of another system",
            where="data",
            received=f"{cfg['data']['name']} with system={name}",
            allowed=f"system={wanted}",
            fix=f"add system={wanted}",
        )


def build_recording(cfg: Config, system: System) -> Recording:
    """The recording before noise is added: simulated, from files, or a public set."""
    if cfg["name"] == "simulated":
        return simulated(cfg, system, cfg["trials"])
    if cfg["name"] == "csv":
        return _from_files(cfg, system)
    return load_public(cfg["name"], **(cfg.get("options") or {}))


def simulated(cfg: Config, system: System, trials: Sequence[Mapping[str, Any]]) -> Recording:
    """Trials of the mechanism that ``data=simulated`` simulates, its effects included."""
    effects, truth = cfg.get("effects") or {}, dict(cfg["truth"])
    for name, table in effects.items():
        contact = name.partition("@")[2]
        truth |= {at_contact(contact, key): value for key, value in (table or {}).items()}
    obeyed = simulated_system(cfg, system)
    return simulate_recording(obeyed, cfg["friction"], truth, trials, float(cfg["rate_hz"]), tuple(effects))


def simulated_system(cfg: Config, system: System) -> System:
    """The system that simulated data obey: with the equations ``data.equations``, where they are given."""
    values: dict[str, Any] = dict(system.values)
    return type(system)(equations=cfg.get("equations") or system.equations, driven=system.driven, **values)


def _paths(given: Any) -> list[str]:
    """Paths as text, one or several."""
    return [str(item) for item in given] if isinstance(given, list) else [str(given)]


def _from_files(cfg: Config, system: System) -> Recording:
    from ..data.tables import columns_of

    known = system.signal_units
    allowed = {**known, "start": "s"}
    trial_column = cfg.get("trial_column")
    present = columns_of(_paths(cfg["path"])[0], cfg.get("delimiter"))
    given = mapping(cfg, "columns", "data")
    for name in given:
        choose(name, allowed, "data.columns")
    columns = {name: column for name, column in given.items() if column not in (None, "")}
    by_name = not columns  # what is left out alone (x: null) leaves the others as they are found
    if by_name:
        columns = {name: name for name in allowed if name in present and name not in given}
    if by_name or "t" in present:
        columns.setdefault("t", "t")
    if trial_column not in (None, "trial", *present):
        raise UserError("unknown column", where="data.trial_column", received=repr(trial_column),
                        allowed=f"{', '.join(present)}, or null: each file is a trial",
                        fix=nearest(trial_column, present) or "use one of the columns present")  # fmt: skip
    if trial_column is not None and trial_column not in present:
        trial_column = None
    marks: dict[str, Any] = {"delimiter": cfg.get("delimiter"), "decimal": cfg.get("decimal")}
    if by_name and "start" in columns and not tells_starts(_paths(cfg["path"]), trial_column, **marks):
        del columns["start"]
    if by_name and present[:1] == ["c1"] and not set(known).intersection(present):
        raise UserError("no header row", where=_paths(cfg["path"])[0], received=f"numbers in {len(present)} columns",
                        allowed="a first row that names the columns, or their places: c1 is the first",
                        fix=f"say data.columns={{t: c1, {system.moving[0].signals[0]}: c2, ...}}")  # fmt: skip
    _require_motion(columns, system, present)
    recording = read_recording(
        _paths(cfg["path"]),
        columns=columns,
        units=mapping(cfg, "units", "data") or {"default": "SI"},
        signal_units=known,
        trial_column=trial_column,
        gains=mapping(cfg, "gains", "data"),
        **marks,
    )
    check_sizes(recording)
    named = [str(column) for column in (*columns.values(), trial_column)]
    read = {*named, *(column.partition("[")[0] for column in named)}  # the column itself, or one that holds lists
    ignored = [name for name in present if name not in read]
    used = [name if str(column) == name else f"{name} from {column}" for name, column in columns.items()]
    told = f"columns used: {', '.join(used)}" + (f"; ignored: {few(ignored)}" if ignored else "")
    recording = replace(recording, notes=(told,))
    return _limited(recording, cfg.get("rate_hz"), cfg.get("max_samples"))


def few(names: Sequence[str]) -> str:
    """Names for a sentence, the first ones of many."""
    return ", ".join(names[:NAMED]) + (f" and {len(names) - NAMED} more" if len(names) > NAMED else "")


def at_one_rate(recording: Recording) -> Recording:
    """The trials at the slowest one's rate, where theirs differ by more than clocks do: networks count samples."""
    rates = [1.0 / float(np.median(np.diff(trial.t))) for trial in recording.trials]
    if max(rates) <= (1 + JITTER) * min(rates):
        return recording
    told = f"trials recorded at {min(rates):.4g} to {max(rates):.4g} Hz: all at {min(rates):.4g} Hz (data.rate_hz)"
    trials = [resample(thin(trial, min(rates)), min(rates)) for trial in recording.trials]
    return replace(recording, trials=tuple(trials), notes=(*recording.notes, told))


def _limited(recording: Recording, rate_hz: Any, max_samples: Any) -> Recording:
    """The recording at a lower rate where one is wanted; refused where it has more samples than one batch may have."""
    for key, value in (("rate_hz", rate_hz), ("max_samples", max_samples)):
        if value is not None and (isinstance(value, bool) or not isinstance(value, int | float) or not value > 0):
            raise UserError(
                "not a number above 0", where=f"data.{key}", received=repr(value), allowed="above 0, or null"
            )
    if rate_hz is not None:
        recording = replace(recording, trials=tuple(thin(trial, float(rate_hz)) for trial in recording.trials))
        for trial in recording.trials:
            check_trial(trial, f"{recording.source} at {rate_hz:g} Hz")
    if max_samples is not None and len(recording) > max_samples:
        raise UserError(
            "more samples than one batch may have",
            where=recording.source,
            received=f"{len(recording)} samples long",
            allowed=f"up to data.max_samples = {max_samples}",
            fix="lower its rate with data.rate_hz, or cut it; a training holds all samples in memory at once",
        )
    return recording


def _require_motion(columns: dict[str, Any], system: System, present: Sequence[str]) -> None:
    for coordinate in system.moving:
        if not any(name in columns for name in coordinate.signals):
            raise UserError(
                f"no signal of coordinate {coordinate.name} in the recording",
                where="data.path",
                received=f"columns {few(present)}",
                allowed=f"at least one of {', '.join(coordinate.signals)}",
                fix=f"name its column, for example data.columns.{coordinate.signals[0]}=my_column",
            )
    if system.massless and not any(item.name in columns for item in system.inputs):
        raise UserError(
            "no measured force in the recording",
            where="data.path",
            received=f"columns {few(present)}",
            allowed=", ".join(item.name for item in system.inputs),
            fix="name its column",
        )


def seed_of(cfg: Config) -> int:
    """The seed, checked."""
    seed = cfg["seed"]
    if isinstance(seed, bool) or not isinstance(seed, int) or not 0 <= seed < 2**32:
        raise UserError("impossible seed", where="seed", received=repr(seed), allowed="a whole number from 0")
    return seed
