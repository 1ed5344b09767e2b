"""A constant force along the slip direction."""

from ..effect import Effect, strength


class ConstantForce(Effect):
    """F = F_law + constant_force.

    Units: constant_force in the system's unit of force.
    Neutral: constant_force = 0.
    Occurs: on a slope, with an amplifier or sensor offset, where a cable or a spring pulls evenly.
    Experiment: slow motion at constant speed both ways: the two friction forces differ by twice its value.
    """

    name = "constant_force"
    parameters = (strength("constant_force", "{F}", "constant force against positive slip"),)

    def force(self, c, p, law):
        return p.constant_force
