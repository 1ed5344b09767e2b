"""frictionpinn: learn friction from state data through the equation of motion."""

__version__ = "0.1.0"
