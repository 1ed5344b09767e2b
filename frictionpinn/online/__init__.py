"""Online estimation: friction force and interval, one sample at a time, on surfaces that may change."""

import sys

from .. import Function
from .estimator import OnlineEstimator
from .reading import Reading
from .tuning import Tuning, tune

__all__ = ["OnlineEstimator", "Reading", "Tuning", "tune"]

sys.modules[__name__].__class__ = Function  # called, this is frictionpinn.online(...)
