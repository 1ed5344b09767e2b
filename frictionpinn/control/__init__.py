"""Friction compensation in a closed loop: a torque to add beside a controller, and its interval."""

from .compensator import Command, Compensator
from .loop import Loop, Plant, close
from .pid import Controller, Gains, tuned
from .references import REFERENCES, reference

__all__ = ["REFERENCES", "Command", "Compensator", "Controller", "Gains", "Loop", "Plant", "close", "reference",
           "tuned"]  # fmt: skip
