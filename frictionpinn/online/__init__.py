"""Online estimation: friction force and interval, one sample at a time, on surfaces that may change."""

from .estimator import OnlineEstimator, Reading
from .tuning import Tuning, tune

__all__ = ["OnlineEstimator", "Reading", "Tuning", "tune"]
