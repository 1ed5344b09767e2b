"""The friction models as LightningModules: bb1, bb2, pe1, pe2."""

from .base import FrictionModel
from .black_box import BlackBox
from .ensemble import FrictionEnsemble
from .features import Features
from .parameter_estimator import ParameterEstimator

MODELS = {"bb1": BlackBox, "bb2": BlackBox, "pe1": ParameterEstimator, "pe2": ParameterEstimator}

__all__ = ["MODELS", "BlackBox", "Features", "FrictionEnsemble", "FrictionModel", "ParameterEstimator"]
