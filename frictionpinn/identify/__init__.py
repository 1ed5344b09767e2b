"""Identification: parameters with their uncertainty from a recording, and what the recording can tell."""

from .bound import Bound, Ranked, bound, rank_experiments
from .likelihood import maximum_likelihood
from .problem import Problem
from .result import Estimate
from .uncertainty import Profile, profile

__all__ = [
    "Bound",
    "Estimate",
    "Problem",
    "Profile",
    "Ranked",
    "bound",
    "maximum_likelihood",
    "profile",
    "rank_experiments",
]
