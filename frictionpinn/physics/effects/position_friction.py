"""Dry friction that depends on the position."""

import sympy as sp

from ..effect import Effect, hidden, strength
from ..scan import Scan


class PositionFriction(Effect):
    """The law sees N (1 + position_gradient (s - position_middle)
    + position_bump exp(-((s - position_place) / position_width)^2)), s the slip position.

    A diagnosis takes the middle of the stroke for position_middle: wherever positions are counted from, friction is
    then what the law says in the middle, and no gradient that a motion can have makes it negative there.

    Units: position_gradient per unit of slip, position_bump dimensionless, middle, place and width in the unit of slip.
    Neutral: position_gradient = 0, position_bump = 0.
    Occurs: in guides that are bent, worn, dirty or greased unevenly.
    Experiment: slow motion over the whole stroke, both ways: the friction, not the mean of both, varies with position.
    """

    name = "position_friction"
    parameters = (
        strength("position_gradient", "1/{L}", "relative change of dry friction along the stroke", group="gradient"),
        hidden(
            "position_middle",
            "{L}",
            "middle of the stroke",
            0.0,
            Scan("place", 0.5, 0.5, 1, "linear"),
            -1e9,
            "gradient",
        ),
        strength("position_bump", "1", "relative change of dry friction at one place", -1.0, group="bump"),
        hidden("position_place", "{L}", "that place", 0.0, Scan("place", 0.05, 0.95, 10, "linear"), -1e9, "bump"),
        hidden("position_width", "{L}", "half width of the place", 0.1, Scan("stroke", 0.05, 0.5, 4), group="bump"),
    )

    def applies(self, system, law, others=()):
        return system.slip_position is not None

    def load(self, N, c, p):
        gradient = p.position_gradient * (c.s - p.position_middle)
        bump = p.position_bump * sp.exp(-(((c.s - p.position_place) / p.position_width) ** 2))
        return N * (1 + gradient + bump)
