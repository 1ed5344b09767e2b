"""The Stribeck effect, for a law without it."""

import sympy as sp

from ..effect import Effect, hidden, strength
from ..scan import Scan


class StribeckEffect(Effect):
    """The law sees N (1 + stribeck_rise exp(-(v / stribeck_speed)^2)): dry friction is higher near rest.

    For laws without mu_s; mu_s = mu_c (1 + stribeck_rise).

    Units: stribeck_rise dimensionless, stribeck_speed in slip per second.
    Neutral: stribeck_rise = 0.
    Occurs: in greased and boundary-lubricated contacts.
    Experiment: constant speeds from creep upwards, and force ramps from rest (breakaway).
    """

    name = "stribeck"
    parameters = (
        strength("stribeck_rise", "1", "static over Coulomb friction, minus 1", 0.0),
        hidden("stribeck_speed", "{L}/s", "Stribeck velocity", 1e-3, Scan("speed", 1e-3, 0.5, 12)),
    )

    def applies(self, system, law, others=()):
        return not any(par.name == "mu_s" for par in law.parameters)

    def load(self, N, c, p):
        return N * (1 + p.stribeck_rise * sp.exp(-((c.v / p.stribeck_speed) ** 2)))
