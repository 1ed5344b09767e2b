"""What an evaluation compares: the model, observers, classical laws, simulators with their own friction."""

from __future__ import annotations

import logging

from ..data.module import TrajectoryData
from ..evaluate.network_observer import NetworkObserver, applies
from ..evaluate.observers import Known, identify, observers
from ..evaluate.simulators import simulators
from ..evaluate.yardsticks import Candidate, candidates
from ..models import FrictionModel
from ..physics import LAWS, System
from .build import Config
from .rollout import load_in_motion

log = logging.getLogger(__name__)


def build_methods(
    cfg: Config,
    trained: Config,
    away: Config,
    home: System,
    system: System,
    model: FrictionModel,
    data: TrajectoryData,
    local: TrajectoryData,
) -> dict[str, Candidate]:
    """The model first, then what it is measured against, by key.

    Args:
        cfg: of the evaluation: substeps, integrator, identify, simulators.
        trained, away: configurations of the training and of the system that is evaluated.
        home, system: that was trained on, that is evaluated.
        model: trained.
        data: the training's data, from which parameters come.
        local: data of the system that is evaluated (the same where nothing is transferred), to which what is not
            friction is tuned: noise levels, smoothness of the inputs.
    """
    train = data.select("train")
    in_motion = load_in_motion(cfg["run"], model)
    found = candidates(model, system, train, int(cfg["substeps"]), cfg.get("integrator"), in_motion)
    if applies(system, model):
        label = f"{model.hparams['name'].upper()} in the equation of motion, corrected"
        found["network_observer"] = Candidate(label, NetworkObserver(system, model, local.select("train")))
    recording = local.recording.select(local.splits["train"])
    found |= observers(system, recording, _known(cfg, trained, away, home, model, data))
    if trained["data"]["name"] != "simulated":
        del found["force_balance"]  # it is what the others are compared with
    elif system.name == home.name:
        found |= simulators(cfg["simulators"], system, train)
    return found


def _known(
    cfg: Config, trained: Config, away: Config, home: System, model: FrictionModel, data: TrajectoryData
) -> dict[str, Known]:
    """What every observer knows, by key: identified, the model's own, the truth."""
    law, known = trained["friction"]["name"], dict[str, Known]()
    if cfg["identify"]:
        log.info("identifying by maximum likelihood on the training trials")
        found = identify(home, law, data.recording.select(data.splits["train"]))
        known |= {"identified": found} if found else {}
    if model.physical():
        own = model.hparams["law"]["name"]
        label = f"observer, {model.hparams['name'].upper()}'s {LAWS[own].__name__}"
        known["observer"] = Known(label, own, model.physical())
    if away["data"].get("truth"):
        truth = dict(away["data"]["truth"])
        known["observer_truth"] = Known("observer that knows the truth", away["data"]["friction"], truth)
    return known
