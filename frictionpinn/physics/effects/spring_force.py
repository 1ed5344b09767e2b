"""A spring along the slip direction."""

from ..effect import Effect, hidden, strength
from ..scan import Scan


class SpringForce(Effect):
    """F = F_law + spring_stiffness (s - spring_rest), s the slip position.

    Units: spring_stiffness in force per slip, spring_rest in the unit of slip.
    Neutral: spring_stiffness = 0.
    Occurs: with cables, hoses, bellows and flexures.
    Experiment: slow motion over the whole stroke: the force climbs with position, in both directions alike.
    """

    name = "spring_force"
    parameters = (
        strength("spring_stiffness", "{F}/{L}", "stiffness of a spring along the slip direction"),
        hidden("spring_rest", "{L}", "position where it is relaxed", 0.0, Scan("place", 0, 1, 3, "linear"), -1e9),
    )

    def applies(self, system, law, others=()):
        return system.slip_position is not None

    def force(self, c, p, law):
        return p.spring_stiffness * (c.s - p.spring_rest)
