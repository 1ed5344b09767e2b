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

MODELS = {"bb1": BlackBox, "bb2": BlackBox, "pe1": ParameterEstimator, "pe2": ParameterEstimator}


def rebuilt(hparams: Mapping[str, Any]) -> FrictionModel:
    """A model from the hyper-parameters of a checkpoint; its state is loaded afterwards."""
    if hparams.get("members"):
        return FrictionEnsemble.from_hparams(hparams)
    return kind_of(hparams)(**hparams)


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
    "StateModel",
    "kind_of",
    "rebuilt",
]
