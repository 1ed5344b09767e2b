"""Build the data and the model of a training from its configuration (plain values, as resolved by Hydra)."""

from __future__ import annotations

from ..data.contact import ContactTrial, contact_trials
from ..data.module import TrajectoryData
from ..data.split import split_trials
from ..errors import UserError, choose
from ..models import MODELS, FrictionModel
from ..models.start import complete, data_scales
from ..physics import LAWS, System
from .build import Config, at_one_rate, build_noise, build_recording, build_smoothing, mapping, seed_of


def build_data(cfg: Config, system: System) -> TrajectoryData:
    """Recording, noise, smoothing and split of the experiment."""
    clean = build_recording(cfg["data"], system)
    clean = at_one_rate(clean) if "model" in cfg else clean
    noisy = build_noise(cfg["noise"])(clean, seed_of(cfg))
    table = cfg["data"]
    splits = split_trials(clean.names, table.get("held_out"), table.get("validation"), table.get("training_trials"))
    offline, online = build_smoothing(cfg["smoothing"])
    trials = contact_trials(noisy, system, offline, online, splits["train"])
    _require_force(trials, splits["train"])
    return TrajectoryData(noisy, trials, splits, cfg["data"].get("steps_per_epoch", 1))


def _require_force(trials: list[ContactTrial], train: list[str]) -> None:
    if all(float(abs(trial.offline["friction_force"]).max()) == 0.0 for trial in trials if trial.name in train):
        raise UserError(
            "the motion implies no friction force at all",
            where="data",
            received="0 in every training sample",
            allowed="a recording in which friction acts",
            fix="check the mapping of columns and the system's parameters",
        )


def build_model(cfg: Config, system: System, data: TrajectoryData) -> FrictionModel:
    """The variant of the configuration; scales and unspecified start values come from the training trials."""
    model, friction = dict(cfg["model"]), cfg["friction"]
    kind = choose(model["name"], MODELS, "model")
    train = data.select("train")
    scales = data_scales(train)
    common = {key: model[key] for key in ("name", "inputs", "network", "loss")}
    given = mapping(model, "windows", "model")
    inputs = model["inputs"] if isinstance(model["inputs"], list) else []
    windows = {name: given.get(name, [[1, 0]]) for name in map(str, inputs)}
    common |= {"inputs": inputs, "windows": windows, "optimizer": cfg["optimizer"], "scales": scales}
    common["context"] = {"system": cfg["system"]["name"], "equations": system.equations, "values": dict(system.values)}
    if not model["name"].startswith("pe"):
        return kind(**common)
    law = choose(friction["name"], LAWS, "friction")()
    wanted, limits = mapping(friction, "start", "friction"), mapping(friction, "bounds", "friction")
    if cfg["system"].get("augmented"):
        from ..export.augmented import folded

        saved = folded(cfg["system"]["augmented"])[1]
        wanted = {name: saved.get(name) if wanted.get(name) is None else wanted[name] for name in wanted}
    start, bounds = complete(law, wanted, limits, scales)
    plain = {"name": law.name, "start": start, "bounds": {key: list(value) for key, value in bounds.items()}}
    plain |= {
        "fixed": {key: value for key, value in mapping(friction, "fixed", "friction").items() if value is not None},
        "tie_sigma1": bool(friction.get("tie_sigma1", False)),
    }
    return kind(**common, law=plain, bristle=model.get("bristle", "load"))
