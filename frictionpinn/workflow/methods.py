"""What an evaluation compares: the model, observers, classical laws, simulators with their own friction."""

from __future__ import annotations

import logging
from typing import Any

from ..data.module import TrajectoryData
from ..evaluate.network_observer import NetworkObserver, applies
from ..evaluate.observers import Known, identify, observers, observers_at_contacts
from ..evaluate.simulators import simulators
from ..evaluate.yardsticks import Candidate, candidates, candidates_at_contacts
from ..models import FrictionModel
from ..physics import LAWS, System
from ..physics.contacts import by_parameter, law_named, laws_of
from .build import Config, build_friction
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
) -> dict[str, dict[str, Candidate]]:
    """Contact -> the model first, then what it is measured against, by key.

    Args:
        cfg: of the evaluation: substeps, integrator, identify, simulators.
        trained, away: configurations of the training and of the system that is evaluated.
        home, system: that was trained on, that is evaluated.
        model: trained.
        data: the training's data, from which parameters come.
        local: data of the system that is evaluated (the same where nothing is transferred), to which what is not
            friction is tuned: noise levels, smoothness of the inputs.
    """
    train, recording = data.select("train"), local.recording.select(local.splits["train"])
    if model.contacts != ("",):
        at_contacts = candidates_at_contacts(model, system, train)
        seen = observers_at_contacts(system, recording, _known(cfg, trained, away, home, system, model, data))
        for contact, table in at_contacts.items():
            table |= seen[contact]
            if trained["data"]["name"] != "simulated":
                del table["force_balance"]  # it is what the others are compared with
        return at_contacts
    in_motion = load_in_motion(cfg["run"], model)
    found = candidates(model, system, train, int(cfg["substeps"]), cfg.get("integrator"), in_motion)
    if applies(system, model):
        label = f"{model.hparams['name'].upper()} in the equation of motion, corrected"
        found["network_observer"] = Candidate(label, NetworkObserver(system, model, local.select("train")))
    found |= observers(system, recording, _known(cfg, trained, away, home, system, model, data))
    if trained["data"]["name"] != "simulated":
        del found["force_balance"]  # it is what the others are compared with
    elif system.name == home.name:
        found |= simulators(cfg["simulators"], system, train)
    return {"": found}


def _known(
    cfg: Config, trained: Config, away: Config, home: System, system: System, model: FrictionModel, data: TrajectoryData
) -> dict[str, Known]:
    """What every observer knows, by key: identified, the model's own, the truth."""
    several, known = model.contacts != ("",), dict[str, Known]()
    law: Any = trained["friction"]["name"]
    if several:
        declared = build_friction(trained["friction"], home)
        law = {contact.name: declared.at(contact.name).name for contact in home.contacts}
    if cfg["identify"]:
        log.info("identifying by maximum likelihood on the training trials")
        found = identify(home, law, data.recording.select(data.splits["train"]))
        known |= {"identified": found} if found else {}
    if model.physical():
        own = law if several else model.hparams["law"]["name"]
        kind = "laws" if several else LAWS[own].__name__
        label = f"observer, {model.hparams['name'].upper()}'s {kind}"
        known["observer"] = Known(label, own, model.physical())
    if away["data"].get("truth"):
        obeyed, truth = away["data"]["friction"], dict(away["data"]["truth"])
        if several:
            laws = laws_of(system, law_named(obeyed, "data.friction"))
            obeyed, truth = {contact.name: laws.at(contact.name).name for contact in system.contacts}, by_parameter(
                truth, laws)  # fmt: skip
        told = "law's truth, not the effects" if away["data"].get("effects") else "truth"
        known["observer_truth"] = Known(f"observer that knows the {told}", obeyed, truth)
    return known
