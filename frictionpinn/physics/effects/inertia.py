"""Inertia along the slip direction that was not declared."""

from ..effect import Effect, strength


class Inertia(Effect):
    """F = F_law + inertia a, a the slip acceleration.

    Units: inertia in force per slip acceleration (kg, or kg m^2 for a joint).
    Neutral: inertia = 0.
    Occurs: rotors and gears reflected to the load, fixtures between contact and force sensor, fluid that moves along.
    Unlike a payload it has no weight.
    Experiment: fast accelerations.
    """

    name = "inertia"
    parameters = (strength("inertia", "{F}*s^2/{L}", "inertia along the slip direction"),)

    def force(self, c, p, law):
        return p.inertia * c.a
