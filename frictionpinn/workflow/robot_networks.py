"""Training of networks for a robot's joints (``train.py system=robot``): from a configuration to ``result.json``."""

from __future__ import annotations

import logging
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import lightning as L
import numpy as np

from ..data.module import TrajectoryData
from ..errors import UserError, choose
from ..evaluate.picture import save_png
from ..models import MODELS, JointNetworks, JointTrial
from ..models.parameter_estimator import with_bristle
from ..models.start import NEXT_TO_NONE, complete, data_scales, default_start
from ..physics.base import at_contact
from ..physics.mechanism import Mechanism
from ..physics.robot_joint import RobotJoint
from ..report.robot import torques_over_time
from ..robots.balance import as_text
from ..robots.identify import identify, relative_errors
from ..robots.least_squares import Solution
from ..robots.networks import OFFSET, Trained, joint_trials, kernel_of, law_values, start, weights
from ..robots.recording import TORQUE_AT
from ..show import readable_unit
from .build import Config, mapping, seed_of
from .dashboard import show_figures, show_hyper_parameters
from .experiment import common_options
from .manifest import write_json
from .provenance import commit, versions
from .result import final_losses
from .robot_bench import EVERYWHERE, Bench, bench, defaults, refuse_others
from .train import trained

log = logging.getLogger(__name__)
COULOMB_VISCOUS = "coulomb_viscous"


def train_robot(cfg: Config, folder: Path, begin: float) -> dict[str, Any]:
    """Train a network for each joint of a robot, all at once; write checkpoints, a figure and ``result.json``.

    Args:
        begin: of the run, by ``time.perf_counter``.

    Raises:
        UserError: anything that the user can mend.
    """
    _check(cfg)
    law = cfg["model"]["name"].startswith("pe")
    b, plain = _bench(cfg, cfg["friction"]), None
    for own in b.model.laws if law else ():
        with_bristle(own.name)
    if any(own.name != COULOMB_VISCOUS for own in b.model.laws):
        plain = _bench(cfg, {"name": COULOMB_VISCOUS}, quiet=True).model
    fitted, held_out = b.trials
    began = time.perf_counter()
    solution = start(b.model, fitted, TORQUE_AT[cfg["robot"]["torque"]])
    baseline = identify(b.model if plain is None else plain, fitted)
    log.info(f"identified {b.robot.name} on {', '.join(b.fitted.names)} in {time.perf_counter() - began:.1f} s")
    splits = {"train": list(b.fitted.names), "validation": [], "held_out": list(b.held_out.names)}
    trials = joint_trials(solution, [*fitted, *held_out], splits, law)
    data = TrajectoryData(b.fitted, trials, splits, cfg["data"].get("steps_per_epoch", 1))
    L.seed_everything(seed_of(cfg), workers=False, verbose=False)
    model = _networks(cfg, solution, [t for t in trials if t.name in b.fitted.names], law)
    data.prepare_for(model)
    trainer, told = trained(cfg, folder, data, model, _parameters(solution, model), begin)
    result = _result(cfg, b, solution, baseline, model, told)
    result["training"]["loss"] = final_losses(model, data.train_batch(model.device))
    ours = Trained.of(solution, model)
    shown = (held_out or fitted)[0]
    lines = {"error of Coulomb + viscous friction": baseline.model.recorded(shown) - shown.tau,
             f"error with {model.hparams['name'].upper()} in every joint": ours.torque(shown) - shown.tau}  # fmt: skip
    (folder / "figures").mkdir(parents=True, exist_ok=True)
    picture = save_png(torques_over_time(solution.model, shown, lines), folder / "figures" / "torques.png")
    show_figures(trainer.loggers, {"torques": picture}, trainer.global_step)
    show_hyper_parameters(trainer.loggers, cfg, folder, result, trainer.global_step)
    for logger in trainer.loggers:
        logger.experiment.close()  # type: ignore[attr-defined]
    write_json(folder / "result.json", result)
    log.info(_summary(result, folder))
    return result


def _check(cfg: Config) -> None:
    """Raise :class:`UserError` for what networks of joints cannot be."""
    refuse_others("", cfg, EVERYWHERE, defaults("train", cfg))
    if str(cfg["model"].get("bristle", "load")) != "load":
        raise UserError("the bristle of a joint starts from the identified one", where="model.bristle",
                        received=cfg["model"]["bristle"], allowed="load")  # fmt: skip
    for key, value in (("ensemble", 1), ("refine", False), ("rollout", False)):
        if cfg.get(key, value) != value:
            raise UserError("a robot has networks of windows, one for each joint", where=key, received=cfg[key],
                            allowed=str(value).lower(), fix="leave it out")  # fmt: skip
    if cfg["model"].get("memory", "windows") != "windows":
        raise UserError("a robot has networks of windows, one for each joint", where="model.memory",
                        received=cfg["model"]["memory"], allowed="windows")  # fmt: skip


def _bench(cfg: Config, friction: Config, quiet: bool = False) -> Bench:
    """The robot with a law and an offset in every joint, which networks that are odd in the motion cannot say."""
    logger, before = logging.getLogger("frictionpinn"), logging.getLogger("frictionpinn").level
    logger.setLevel(logging.ERROR if quiet else before)
    try:
        return bench({**cfg, "friction": friction, "diagnose": {"declared": [OFFSET]}})
    finally:
        logger.setLevel(before)


def _networks(cfg: Config, solution: Solution, train: list[JointTrial], law: bool) -> JointNetworks:
    """The variant of the configuration at every joint."""
    choose(cfg["model"]["name"], MODELS, "model")
    own: dict[str, dict[str, Any]] = {}
    for k, joint in enumerate(solution.model.names):
        scales = data_scales([trial.at(joint) for trial in train])
        if law:
            own[joint] = {"scales": scales, "law": _law(cfg, solution, k, scales)}
        else:  # what is learned is as large as what the identified friction leaves
            own[joint] = {"scales": scales | {"force": float(solution.sigmas[k])}}
    context = {"system": "robot", "robot": solution.model.robot.name}
    share = cfg["model"].get("share", False)
    return JointNetworks(**common_options(cfg), context=context, contacts=own, share=share,
                         balance=[float(x) for x in weights(solution, solution.trials)],
                         kernel=[float(x) for x in kernel_of(solution.trials[0])])  # fmt: skip


def _law(cfg: Config, solution: Solution, k: int, scales: Mapping[str, float]) -> dict[str, Any]:
    """The law of a joint, from its identified values."""
    model, friction = solution.model, cfg["friction"]
    law, known = model.laws[k], {par.name for par in model.laws[k].parameters}
    bounds, fixed = ({n: v for n, v in mapping(friction, key, "friction").items() if n in known and v is not None}
                     for key in ("bounds", "fixed"))  # fmt: skip
    given = {n: max(law_values(model, k)[n], NEXT_TO_NONE * usual) for n, usual in default_start(law, scales).items()}
    begin, limits = complete(law, given, bounds, scales)
    return {"name": law.name, "start": begin, "bounds": {n: list(pair) for n, pair in limits.items()}, "fixed": fixed,
            "tie_sigma1": bool(friction.get("tie_sigma1", False))}  # fmt: skip


def _parameters(solution: Solution, model: JointNetworks) -> dict[str, dict[str, Any]]:
    """Value, unit and start of every parameter of the joints' laws."""
    values, table = model.physical(), dict[str, dict[str, Any]]()
    for k, joint in enumerate(solution.model.names if values else ()):
        law, own = solution.model.laws[k], model.map_of(joint)
        mechanism = Mechanism(RobotJoint(bool(solution.model.robot.turns[k])), law)
        units = mechanism.units | dict.fromkeys(("mu_c", "mu_s"), mechanism.system.force_unit)  # at a normal force of 1
        for par in law.parameters:
            name = at_contact(joint, par.name)
            table[name] = {"value": values[name], "unit": units[par.name], "text": par.text,
                           "start": own.hparams["law"]["start"].get(par.name),
                           "trained": par.name in own.law_parameters.raw}  # type: ignore[operator, union-attr]  # fmt: skip
    return table


def _result(
    cfg: Config, b: Bench, solution: Solution, baseline: Solution, model: JointNetworks, told: Config
) -> dict[str, Any]:
    fitted, held_out = b.trials
    trials, ours = [*fitted, *held_out], Trained.of(solution, model)
    errors = {"coulomb_viscous": relative_errors(baseline.model, trials),
              "identified": relative_errors(solution.model, trials), "model": ours.errors(trials)}  # fmt: skip
    scored = [trial.name for trial in held_out or fitted]
    whole = {key: _over(table, scored, slice(None)) for key, table in errors.items()}
    joints = {joint: {"unit": _UNIT, **{key: _over(table, scored, k) for key, table in errors.items()}}
              for k, joint in enumerate(solution.model.names)}  # fmt: skip
    values = {**solution.model.values}
    for name, change in ours.change.items():
        values[name] = change + (0.0 if model.sees_rates and name.endswith(f".{OFFSET}") else values[name])
    return {
        "model": model.hparams["name"],
        "system": "robot",
        "arm": {"name": b.robot.name, "joints": dict(zip(solution.model.names, b.robot.joints, strict=True))},
        "data": {
            "name": cfg["data"]["name"],
            "source": b.fitted.source,
            "sha256": b.fitted.checksum,
            "samples": {"train": sum(len(t.t) for t in fitted), "validation": 0,
                        "held_out": sum(len(t.t) for t in held_out)},
            "trials": {"train": list(b.fitted.names), "validation": [], "held_out": list(b.held_out.names)},
        },
        "parameters": _parameters(solution, model),
        "force_error": {
            "on": "held-out trials" if held_out else "training trials (none held out)",
            "inputs": "the smoothed motion: torques from motion alone, behind the low-pass",
            "unit": _UNIT,
            **whole,
            "contacts": joints,
        },
        "torque_error": {trial.name: {key: [float(x) for x in table[trial.name]] for key, table in errors.items()}
                         for trial in trials},
        "training": {**told, "seconds": {key: round(value, 3) for key, value in told["seconds"].items()},
                     "seed": cfg["seed"]},
        "identified": as_text(solution.model.with_values(**values)),
        "versions": versions(),
        "commit": commit(),
        "config": cfg,
    }  # fmt: skip


_UNIT = {"rmse": "1", "mse": "1", "relative": "1"}


def _over(errors: Mapping[str, np.ndarray], scored: list[str], joints: Any) -> dict[str, Any]:
    """Relative torque error in the mean over trials and joints."""
    by_trial = {name: float(np.mean(errors[name][joints])) for name in scored}
    mean = float(np.mean(list(by_trial.values())))
    return {"rmse": mean, "mse": mean**2, "relative": mean, "reference": "measured torque", "reference_rms": 1.0,
            "by_trial": by_trial}  # fmt: skip


def _summary(result: Mapping[str, Any], folder: Path) -> str:
    """What a person wants to read after a training."""
    lines = []
    if result["parameters"]:
        lines.append(f"{'parameter':<18}{'value':>12}  {'unit':<12}{'identified':>12}")
        for name, p in result["parameters"].items():
            begun = f"{p['start']:>12.4g}" if p["trained"] else f"{'fixed':>12}"
            lines.append(f"{name:<18}{p['value']:>12.4g}  {readable_unit(p['unit']):<12}{begun}")
    held = result["data"]["trials"]["held_out"]
    lines.append("relative torque error in %, joint by joint, and their mean:")
    labels = {"coulomb_viscous": "Coulomb + viscous", "identified": "identified", "model": result["model"]}
    for name, table in result["torque_error"].items():
        lines.append(f"  {name} ({'held out' if name in held else 'fitted'})")
        for key, label in labels.items():
            own = [100 * x for x in table[key]]
            lines.append(f"    {label:<18}{''.join(f'{x:7.1f}' for x in own)}  {np.mean(own):7.2f}")
    t = result["training"]
    lines.append(f"{t['epochs']} epochs in {t['seconds']['training']:.1f} s; everything is in {folder}")
    return "\n".join(lines)
