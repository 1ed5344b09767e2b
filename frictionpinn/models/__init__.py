"""The friction models as LightningModules: bb1, bb2, pe1, pe2."""

from collections.abc import Mapping
from typing import Any

from .base import FrictionModel
from .black_box import BlackBox
from .ensemble import FrictionEnsemble
from .features import Features
from .joints import JointNetworks, JointTrial
from .parameter_estimator import ParameterEstimator
from .several import SeveralContacts
from .state import StateModel
from .state_ensemble import StateEnsemble

MODELS = {"bb1": BlackBox, "bb2": BlackBox, "pe1": ParameterEstimator, "pe2": ParameterEstimator}


def rebuilt(hparams: Mapping[str, Any]) -> FrictionModel:
    """A model from the hyper-parameters of a checkpoint; its state is loaded afterwards."""
    if hparams.get("members"):
        return ensemble_of([rebuilt(item) for item in hparams["members"]])
    return kind_of(hparams)(**hparams)


def ensemble_of(members: list[FrictionModel]) -> FrictionEnsemble:
    """Members of one kind as one model."""
    return (StateEnsemble if isinstance(members[0], StateModel) else FrictionEnsemble)(members)


def kind_of(hparams: Mapping[str, Any]) -> type[FrictionModel]:
    """The class of a model: of a robot's joints, of several contacts, with a state, or with windows."""
    if hparams.get("kernel"):
        return JointNetworks
    if hparams.get("contacts"):
        return SeveralContacts
    return StateModel if hparams.get("state") else MODELS[hparams["name"]]


__all__ = [
    "MODELS",
    "BlackBox",
    "Features",
    "FrictionEnsemble",
    "FrictionModel",
    "JointNetworks",
    "JointTrial",
    "ParameterEstimator",
    "SeveralContacts",
    "StateEnsemble",
    "StateModel",
    "ensemble_of",
    "kind_of",
    "rebuilt",
]
