"""Identification: parameters with their uncertainty from a recording, and what the recording can tell."""

from .bound import Bound, Ranked, bound, rank_experiments
from .likelihood import maximum_likelihood
from .problem import Problem
from .profile import Profile, profile
from .result import Estimate

__all__ = ["Bound", "Estimate", "Problem", "Profile", "Ranked", "bound", "maximum_likelihood", "profile",
           "rank_experiments"]  # fmt: skip
