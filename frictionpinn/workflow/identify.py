"""Estimators beside each other: the same data, bounds, starts and simulator; parameters, time, simulations, force."""

from __future__ import annotations

import logging
import time
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from ..data.findings import listed
from ..data.recording import Recording
from ..data.split import split_trials
from ..errors import UserError, check_processes, choose
from ..evaluate.estimate_figures import residuals_figure
from ..evaluate.estimators import error_against_time, table
from ..evaluate.picture import save_png
from ..evaluate.style import squared
from ..evaluate.trajectory import Trajectory, simulate, simulation_error
from ..evaluate.yardsticks import Candidate
from ..identify.result import Estimate
from ..numerics.simulate import Simulator
from ..physics import LAWS, System, extensions
from ..physics.base import beside, plain_name
from ..physics.contacts import by_parameter, law_named, laws_of
from ..physics.mechanism import Mechanism
from ..progress import Steps
from ..show import plain
from .build import Config, build_friction, build_noise, build_recording, build_system, estimated_law, law_table, seed_of
from .configs import called
from .estimate import ESTIMATORS, NETWORKS, estimate, given_start
from .experiment import build_data
from .manifest import write_json
from .provenance import commit, versions
from .threads import one_thread, silent
from .train import quiet
from .trajectories import build_trajectories, recorded_trajectories, transferred
from .vet import vet

log = logging.getLogger(__name__)
FIT, TIMES = "fit.png", "error_against_time.png"
TRACED = 15  # points of a search's way whose force error is computed


def identify(cfg: Config, folder: Path) -> dict[str, Any]:
    """Estimate the parameters by every method and seed; write ``result.json`` and figures, print the table.

    Args:
        cfg: resolved conf/identify.yaml.
        folder: of this run.

    Raises:
        UserError: anything that the user can mend.
    """
    if cfg["system"]["name"] == "robot":
        from . import robot

        return robot.identify(cfg, folder)
    folder.mkdir(parents=True, exist_ok=True)
    for name in (FIT, TIMES):  # of an earlier run in this folder
        (folder / name).unlink(missing_ok=True)
    result = compare(cfg, folder)
    written = [f"{FIT} (the fit over the measurement)"] if (folder / FIT).exists() else []
    if _takes_time(result):
        save_png(error_against_time({f"bounds: {cfg['bounds']['name']}": result}), folder / TIMES)
        written.append(TIMES)
    write_json(folder / "result.json", result | {"versions": versions(), "commit": commit(), "config": cfg})
    log.info(table(result))
    log.info(f"{listed([*written, 'result.json'])} are in {folder}")
    log.info(f"next: {called('diagnose')} with the same system, friction and data says what this law lacks")
    return result


def _takes_time(result: Mapping[str, Any]) -> bool:
    """Whether there is more than one point to draw of error against time: a search's way, methods or seeds."""
    traces = [run["trace"] for runs in result["methods"].values() for run in runs]
    return sum(seconds > 0 and bool(mse) for trace in traces for seconds, mse in trace) > 1


def compare(cfg: Config, folder: Path | None = None) -> dict[str, Any]:
    """Every method on every seed, in ``cfg["jobs"]`` processes.

    Args:
        cfg: resolved conf/identify.yaml.
        folder: where the fit of the first seed is drawn; None: nowhere.

    Returns:
        system, friction law, bounds, truth (where it is known), and for each method a list of one entry per seed with
        parameters, wall and processor time in s, simulations of the whole recording, and the mean square error of the
        friction force when the held-out trial is simulated with the estimate.
    """
    _check(cfg)
    jobs = cfg["jobs"]
    work = partial(one_seed, cfg, folder)
    if jobs > 1 and len(cfg["seeds"]) > 1:
        with one_thread(), ProcessPoolExecutor(jobs, mp_context=get_context("spawn"), initializer=silent) as pool:
            found = list(pool.map(work, cfg["seeds"]))
    else:
        found = [work(seed) for seed in cfg["seeds"]]
    system = build_system(cfg["system"])
    law = build_friction(cfg["friction"], system)
    shown = LAWS["lugre"]() if law.name == "lugre_tied" and len(system.contacts) == 1 else law
    names = [par.name for par in shown.parameters if not par.value]
    units = Mechanism(system, law).read_in | Mechanism(system, shown).read_in
    return {
        "system": system.name,
        "friction": law.name,
        "data": cfg["data"]["name"],
        "noise": cfg["noise"],
        "bounds": cfg["bounds"],
        "seeds": cfg["seeds"],
        "epochs": cfg["epochs"],
        "most_simulations": cfg["simulations"],
        "start": cfg["start"],
        "truth": by_parameter(cfg["data"]["truth"], law) if _knows_truth(cfg, system) else None,
        "units": {name: units[name] for name in names} | {"force_mse": squared(system.force_unit)},
        "methods": {method: [runs[method] for runs in found] for method in cfg["methods"]},
    }


def one_seed(cfg: Config, folder: Path | None, seed: int) -> dict[str, Any]:
    """Every method on one draw of the noise, the bounds and the start; of the first, the fit is drawn in the folder."""
    quiet()
    extensions.load(cfg.get("extensions") or ())  # in a process of its own
    cfg = cfg | {"seed": seed}
    system = build_system(cfg["system"])
    mechanism = Mechanism(system, build_friction(cfg["friction"], system))
    origin = cfg["start"]
    given = {} if origin is None or origin in NETWORKS else given_start(origin, mechanism)
    recording, trajectories = _recorded(cfg, system)
    bounds = bounds_of(cfg, seed)
    start = start_within(bounds, seed) if bounds else law_table(cfg["friction"], "start", mechanism.law)
    start = within(bounds, start | given) if given else start
    options: dict[str, Any] = {"bounds": bounds, "fixed": law_table(cfg["friction"], "fixed", mechanism.law)}
    options |= {"seed": seed, "epochs": cfg["epochs"]}
    estimate("least_squares", mechanism, recording, start=start, simulations=2, **options)  # compiles the equations
    simulations = np.inf if cfg["simulations"] is None else float(cfg["simulations"])
    scorer = Scorer(mechanism, options["fixed"], trajectories)
    result = {}
    methods = sorted(cfg["methods"], key=lambda method: method != origin)  # the network that the others start from
    if origin in NETWORKS and origin not in methods:
        methods = [origin, *methods]
    drawn = next((name for name in ESTIMATORS if name in cfg["methods"] and name not in NETWORKS), None)
    steps = Steps(len(methods))
    for method in methods:
        processor = time.process_time()
        found = estimate(method, mechanism, recording, start=start, simulations=simulations, **options)
        processor = time.process_time() - processor
        result[method] = _entry(found, processor, scorer, start) | {"seed": seed, "start": start, "bounds": bounds}
        steps.finish(f"seed {seed}, {method}: {found.seconds:.1f} s, {found.outcome}")
        if method == "maximum_likelihood":
            log.info(str(found))
        if method == drawn and folder is not None and seed == cfg["seeds"][0] and found.residuals:
            save_png(residuals_figure(found, recording), folder / FIT)
        start = within(bounds, start | found.values) if method == origin else start
    return {method: result[method] for method in cfg["methods"]}


def _recorded(cfg: Config, system: System) -> tuple[Recording, list[Trajectory]]:
    """The recording to identify from, and the trajectories that score the force; none with several contacts."""
    if len(system.contacts) > 1:
        noisy = build_noise(cfg["noise"])(build_recording(cfg["data"], system), seed_of(cfg))
        vet(cfg, system, noisy)
        table = cfg["data"]
        splits = split_trials(noisy.names, table.get("held_out"), table.get("validation"), table.get("training_trials"))
        return noisy.select(splits["train"]), []
    data = build_data(cfg, system)
    vet(cfg, system, data.recording)
    recording = data.recording.select(data.splits["train"])
    if cfg["data"]["name"] == "simulated":
        return recording, build_trajectories(transferred(cfg, None, None), system, data, {"seeds": []})
    return recording, recorded_trajectories(cfg, system, data)


class Scorer:
    """Mean square error of the force where a law with given parameters is simulated on trajectories."""

    def __init__(self, mechanism: Mechanism, fixed: Mapping[str, float], trajectories: list[Trajectory]):
        self.law, self.fixed, self.trajectories = mechanism.law.name, dict(fixed), trajectories
        self.simulator = Simulator(mechanism)
        forces = [item.force for item in trajectories]
        self.mean_square = float(np.mean(np.concatenate(forces) ** 2)) if forces else None  # a yardstick: no model

    def __call__(self, values: Mapping[str, float]) -> float | None:
        """None where a value is missing, the mechanism cannot be simulated, or there is nothing to compare with."""
        if not self.trajectories or not all(np.isfinite(value) for value in values.values()):
            return None
        p = self.fixed | dict(values)
        candidate = Candidate("", simulate=lambda path, y0: self.simulator.simulate(path.t, path, p, y0, z0="steady"))
        errors = [simulation_error(simulate(candidate, item), item) for item in self.trajectories]
        if any("force_mse" not in error for error in errors):
            return None
        weights = [len(item.force) for item in self.trajectories]
        return float(np.average([error["force_mse"]["value"] for error in errors], weights=weights))


def _entry(found: Estimate, processor: float, scorer: Scorer, start: Mapping[str, float]) -> dict[str, Any]:
    """What is kept of an estimate; ``trace``: processor time, s, and force error on the way, the start first."""
    values = dict(found.values)
    path = found.path
    # Parameters that the data do not tell are not reported, but where a search ended with them can be simulated.
    mse = scorer(path[-1].values if path else values)
    some: Any = np.unique(np.linspace(0, len(path) - 1, TRACED).astype(int)) if path else []
    scale = processor / max(found.seconds, 1e-9)
    trace = [[path[k].seconds * scale, scorer(path[k].values)] for k in some]
    if not trace and set(start) >= set(values):
        trace = [[0.0, scorer({name: start[name] for name in values})]]
    if "sigma_0" in values and "sigma_1" not in values and scorer.law == "lugre_tied":
        values["sigma_1"] = float(np.sqrt(values["sigma_0"]))
    return {
        "outcome": found.outcome,
        "values": {name: plain(value) for name, value in values.items()},
        "ci95": {name: [plain(value) for value in pair] for name, pair in found.ci95.items()},
        "advice": list(found.advice),
        "seconds": round(found.seconds, 3),
        "processor_seconds": round(processor, 3),
        "simulations": found.n_simulations,
        "force_mse": mse,
        "force_mean_square": scorer.mean_square,
        "trace": [*trace, [processor, mse]],
    }


def bounds_of(cfg: Config, seed: int) -> dict[str, list[float]]:
    """Bounds by name: around the truth as ``bounds`` says, else (and before it) those of the friction law."""
    law = build_friction(cfg["friction"], build_system(cfg["system"]))
    spec, given = cfg["bounds"], law_table(cfg["friction"], "bounds", law)
    if spec["low"] is None:
        return given
    names = [par.name for par in law.parameters if par.value is None]
    truth = by_parameter(cfg["data"]["truth"], law)
    moved = 10 ** np.random.default_rng([seed, 1]).uniform(-spec["shift"], spec["shift"], len(names))
    return {
        name: [float(truth[name] * spec["low"] * by), float(truth[name] * spec["high"] * by)]
        for name, by in zip(names, moved, strict=True)
    } | given


def start_within(bounds: Mapping[str, list[float]], seed: int) -> dict[str, float]:
    """A start for every bounded parameter, log-uniform; a static coefficient above the Coulomb one."""
    rng = np.random.default_rng([seed, 2])
    return within(bounds, {name: float(np.exp(rng.uniform(*np.log(pair)))) for name, pair in bounds.items()})


def within(bounds: Mapping[str, list[float]], start: Mapping[str, float]) -> dict[str, float]:
    """The start moved inside the bounds, the static coefficient above the Coulomb one."""
    moved = {name: float(np.clip(value, *bounds.get(name, (-np.inf, np.inf)))) for name, value in start.items()}
    for mu_s in (name for name in moved if plain_name(name) == "mu_s"):
        if (mu_c := beside(mu_s, "mu_c")) in moved:
            highest = bounds[mu_s][1] if mu_s in bounds else np.inf
            moved[mu_s] = min(max(moved[mu_s], 1.05 * moved[mu_c]), highest)
            moved[mu_c] = min(moved[mu_c], moved[mu_s] / 1.01)
    return moved


def _knows_truth(cfg: Config, system: System) -> bool:
    """Whether the data are simulated with parameters that the law to identify has."""
    table = cfg["data"]
    if table["name"] != "simulated":
        return False
    obeyed = laws_of(system, law_named(table["friction"], "data.friction"))
    law = build_friction(cfg["friction"], system)
    return all(obeyed.at(c.name).name in ("lugre", law.at(c.name).name) for c in system.contacts)


def _check(cfg: Config) -> None:
    methods = cfg["methods"]
    if not isinstance(methods, list) or not methods:
        raise UserError("no estimators", where="methods", received=repr(methods), allowed=", ".join(ESTIMATORS))
    for method in methods:
        choose(method, dict.fromkeys(ESTIMATORS), "methods")
    check_processes(cfg["jobs"], "jobs")
    seeds = cfg["seeds"]
    if not isinstance(seeds, list) or not seeds or any(not isinstance(s, int) or s < 0 for s in seeds):
        raise UserError("impossible seeds", where="seeds", received=repr(seeds), allowed="a list such as [0, 1, 2]")
    most = cfg["simulations"]
    if most is not None and (isinstance(most, bool) or not isinstance(most, int | float) or not most >= 1):
        raise UserError("impossible number", where="simulations", received=repr(most), allowed="at least 1, or null")
    system = build_system(cfg["system"])
    law, networks = estimated_law(cfg["friction"], system), [method for method in methods if method in NETWORKS]
    laws = [law.at(contact.name) for contact in system.contacts]
    if networks and not all(own.memory or own.name == "none" for own in laws):
        raise UserError("a network estimates a law with a bristle state", where="methods", received=networks[0],
                        allowed="maximum_likelihood and searches for this law",
                        fix=f"leave {networks[0]} out, or choose friction=lugre")  # fmt: skip
    for name, pair in law_table(cfg["friction"], "bounds", law).items():
        numbers = isinstance(pair, list) and len(pair) == 2 and all(isinstance(x, int | float) for x in pair)
        if not numbers or not 0 < pair[0] < pair[1]:
            raise UserError("impossible bounds", where=f"friction.bounds.{name}", received=pair,
                            allowed="[low, high] with 0 < low < high", fix="give the lower bound first")  # fmt: skip
    if cfg["bounds"]["low"] is not None and not _knows_truth(cfg, system):
        raise UserError(
            "bounds around a truth that is not known",
            where="bounds",
            received=f"{cfg['bounds']['name']} with data={cfg['data']['name']}",
            allowed="bounds=data",
            fix="add bounds=data, and friction.bounds where you know them",
        )
