"""Build the data and the model of a training from its configuration (plain values, as resolved by Hydra)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..data.contact import ContactTrial, contact_trials
from ..data.input_noise import UNTOLD, input_noise
from ..data.module import TrajectoryData
from ..data.split import split_trials
from ..errors import UserError, choose
from ..evaluate.characteristics import mobility
from ..models import MODELS, FrictionModel, SeveralContacts, StateModel
from ..models.black_box_start import STARTS
from ..models.segments import compares_position, lengths
from ..models.start import complete, data_scales, known_start
from ..physics import LAWS, FrictionLaw, System
from ..physics.base import contact_of, plain_name
from ..physics.contacts import ContactLaws
from ..physics.force_balance import check_told
from .build import (
    Config,
    at_one_rate,
    build_friction,
    build_noise,
    build_recording,
    build_smoothing,
    law_table,
    mapping,
    seed_of,
)
from .configs import written

# What nothing reads of a network with windows, and as what it may stand there.
OF_STATE: dict[str, dict[str, Any]] = {
    "loss": {"through": None, "compare": None},
    "state": {"elements": 2, "gaps": False, "delay": False, "start": "law"},
}


def build_data(cfg: Config, system: System) -> TrajectoryData:
    """Recording, noise, smoothing and split of the experiment.

    Raises:
        UserError: several contacts whose friction forces the equations of motion do not tell apart.
    """
    contacts = frictional(cfg, system)
    clean = build_recording(cfg["data"], system)
    clean = at_one_rate(clean) if "model" in cfg else clean
    noisy = build_noise(cfg["noise"])(clean, seed_of(cfg))
    table = cfg["data"]
    splits = split_trials(clean.names, table.get("held_out"), table.get("validation"), table.get("training_trials"))
    offline, online = build_smoothing(cfg["smoothing"])
    trials = contact_trials(noisy, system, offline, online, splits["train"], contacts)
    _require_force(trials, splits["train"])
    return TrajectoryData(noisy, trials, splits, cfg["data"].get("steps_per_epoch", 1))


def frictional(cfg: Config, system: System) -> list[str] | None:
    """Names of the contacts that are not declared frictionless; None where the system has one contact.

    Raises:
        UserError: there is none, or the equations of motion do not tell their friction forces apart.
    """
    if len(system.contacts) == 1:
        return None
    law = build_friction(cfg["friction"], system)
    assert isinstance(law, ContactLaws)
    found = [contact for contact, own in law.laws.items() if own.name != "none"]
    if not found:
        raise UserError("no contact with friction", where="friction", received="none everywhere",
                        allowed="a law for one of " + ", ".join(law.laws))  # fmt: skip
    check_told(system, found)
    return found


def _require_force(trials: list[ContactTrial], train: list[str]) -> None:
    for contact in trials[0].contacts:
        own = [trial.at(contact).offline["friction_force"] for trial in trials if trial.name in train]
        if all(float(abs(force).max()) == 0.0 for force in own):
            raise UserError(
                "the motion implies no friction force at all",
                where="data",
                received=f"0 in every training sample{f', {contact}' if contact else ''}",
                allowed="a recording in which friction acts",
                fix="check the mapping of columns and the system's parameters",
            )


def build_model(cfg: Config, system: System, data: TrajectoryData) -> FrictionModel:
    """The variant of the configuration; scales and unspecified start values come from the training trials."""
    model = dict(cfg["model"])
    kind = choose(model["name"], MODELS, "model")
    train = data.select("train")
    common = common_options(cfg)
    common["context"] = {"system": cfg["system"]["name"], "equations": system.equations, "values": dict(system.values)}
    share = model.get("share", False)
    if not isinstance(share, bool):
        raise UserError("not a switch", where="model.share", received=repr(share), allowed="true or false")
    if len(system.contacts) > 1:
        own = {name: _map(cfg, system, name, [trial.at(name) for trial in train]) for name in train[0].contacts}
        for name, options in own.items() if remembers(model) else ():
            options["state"], more = _state(cfg, [trial.at(name) for trial in train])
            options["scales"] |= more
        return SeveralContacts(**common, contacts=own, balance=_balance_scales(train), share=share)
    if share:
        raise UserError("an option that nothing reads", where="model.share", received="true",
                        allowed="with several contacts", fix="leave it out")  # fmt: skip
    own = _map(cfg, system, "", train)
    if remembers(model):
        offline, _ = build_smoothing(cfg["smoothing"])
        positions = compares_position(cfg["model"]["loss"].get("compare"), train, system)
        noise = input_noise(data.recording, system, offline, train, positions)
        state, more = _state(cfg, train, mobility(system, train), noise)
        made = StateModel(**common, **own | {"scales": own["scales"] | more}, state=state)
        if made.through == "motion" and made.loss["force"] != "normalised":  # its residuals are in noises
            raise UserError("an option that nothing reads", where="model.loss.force", received=made.loss["force"],
                            allowed="normalised with model.loss.through=motion", fix="leave it out, or say "
                            "model.loss.through=balance")  # fmt: skip
        return made
    return kind(**common, **own)


def common_options(cfg: Config) -> dict[str, Any]:
    """What every map of a configuration has: inputs, windows, network, loss, optimizer."""
    model = cfg["model"]
    given = mapping(model, "windows", "model")
    inputs = model["inputs"] if isinstance(model["inputs"], list) else []
    windows = {name: given.get(name, [[1, 0]]) for name in map(str, inputs)}
    common = {key: model[key] for key in ("name", "network", "loss")}
    return common | {"inputs": inputs, "windows": windows, "optimizer": cfg["optimizer"]}


def remembers(model: Config) -> bool:
    """Whether the model has a state."""
    return choose(model.get("memory", "windows"), {"windows": False, "state": True}, "model.memory")


def check_memory(cfg: Config) -> None:
    """Raise :class:`UserError` where a network with a state cannot be what else is asked for, or is none."""
    if not remembers(cfg["model"]):
        _check_without_state(cfg["model"])
        return
    over_noise = cfg.get("ensemble", 1) != 1 and cfg.get("ensemble_over") == "noise"
    asked = {  # noise moves where a trial is cut: members would have errors of their inputs in other places
        "rollout": (cfg.get("rollout"), "it is simulated as it is trained", "rollout=false"),
        "ensemble_over": (over_noise, "its members are trained on the same samples", "ensemble_over=seed"),
    }
    for key, (wrong, why, allowed) in asked.items():
        if wrong:
            raise UserError(f"a network with a state: {why}", where="model.memory",
                            received=f"state with {key}={cfg[key]}", allowed=allowed,
                            fix="leave model.memory=windows")  # fmt: skip


def _check_without_state(model: Config) -> None:
    for section, name, neutral in ((key, *item) for key, table in OF_STATE.items() for item in table.items()):
        value = mapping(model, section, "model").get(name, neutral)
        if value != neutral:
            raise UserError("an option of networks with a state", where=f"model.{section}.{name}",
                            received=written(value), allowed=f"{written(neutral)} with model.memory=windows",
                            fix="say model.memory=state, or experiment=memory")  # fmt: skip


def _state(
    cfg: Config, train: Sequence[ContactTrial], mobility: float = 0.0, noise: dict | None = None
) -> tuple[dict[str, Any], dict[str, float]]:
    """Options of a :class:`StateModel`, and the scales that it needs beside those of every model.

    Without a mobility and ``noise`` (:func:`..data.input_noise.input_noise`) it follows the measured motion.
    """
    options = mapping(cfg["model"], "state", "model")
    elements = options.get("elements", 1)
    if isinstance(elements, bool) or not isinstance(elements, int) or elements < 1:
        raise UserError("impossible number of bristles", where="model.state.elements", received=repr(elements),
                        allowed="a whole number from 1")  # fmt: skip
    choose(options.get("start", "law"), STARTS, "model.state.start")
    load = np.concatenate([np.abs(trial.offline["normal_force"]) for trial in train])
    noise = dict(noise or UNTOLD)
    shape, ends = noise.pop("input_shape"), noise.pop("input_ends")
    scales = {
        "mobility": mobility,
        "load_low": float(load.min()),
        "load_high": float(load.max()),
        "fastest": max(float(np.abs(trial.offline["v_slip"]).max()) for trial in train),
        "step": float(np.median(np.diff(train[0].t))),
        **noise,
    }
    return options | {"lengths": lengths(train, noise["slip_noise"]), "input_shape": shape, "input_ends": ends}, scales


def _map(cfg: Config, system: System, contact: str, train: Sequence[ContactTrial]) -> dict[str, Any]:
    """What the model of one contact has of its own: scales and, of a PE, law and bristle."""
    model, friction = cfg["model"], cfg["friction"]
    scales = data_scales(train)
    if not model["name"].startswith("pe"):
        return {"scales": scales}
    law, tables = _law_of(friction, system, contact)
    wanted = tables["start"]
    if cfg["system"].get("augmented"):
        from ..export.augmented import folded

        known = known_start(law, folded(cfg["system"]["augmented"])[1], scales)
        wanted = {name: known.get(name) if value is None else value for name, value in wanted.items()}
    start, bounds = complete(law, wanted, tables["bounds"], scales)
    plain: dict[str, Any] = {
        "name": law.name,
        "start": start,
        "bounds": {key: list(value) for key, value in bounds.items()},
    }
    plain |= {
        "fixed": {key: value for key, value in tables["fixed"].items() if value is not None},
        "tie_sigma1": bool(friction.get("tie_sigma1", False)),
    }
    bristle = {} if remembers(model) else {"bristle": model.get("bristle", "load")}
    return {"scales": scales, "law": plain, **bristle}


def _law_of(friction: Config, system: System, contact: str) -> tuple[FrictionLaw, dict[str, dict[str, Any]]]:
    """The law of a contact, and ``start``, ``bounds`` and ``fixed`` of its parameters."""
    if not contact:
        law = choose(friction["name"], LAWS, "friction")()
        return law, {key: mapping(friction, key, "friction") for key in ("start", "bounds", "fixed")}
    laws = build_friction(friction, system)
    known = {par.name for par in laws.at(contact).parameters}
    tables: dict[str, dict[str, Any]] = {}
    for key in ("start", "bounds", "fixed"):
        tables[key] = {
            plain_name(name): value
            for name, value in law_table(friction, key, laws).items()
            if contact_of(name) == contact or (name not in known and not contact_of(name))
        }
    return laws.at(contact), tables


def _balance_scales(train: Sequence[ContactTrial]) -> list[float]:
    """Root mean square of what the implied friction forces add to each equation of motion."""
    parts = []
    for trial in train:
        assert trial.slopes is not None
        forces = np.stack([trial.at(name).offline["friction_force"] for name in trial.contacts], axis=1)
        parts.append(np.einsum("nik,nk->ni", trial.slopes, forces))
    return [float(scale) or 1.0 for scale in np.sqrt(np.mean(np.concatenate(parts) ** 2, axis=0))]
