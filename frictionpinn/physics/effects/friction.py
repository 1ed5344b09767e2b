"""Friction at a contact that was declared without any."""

from dataclasses import replace

from ..effect import Effect
from ..friction.coulomb_viscous import CoulombViscous

LAW, GROUPS = CoulombViscous(), {"mu_c": "Coulomb", "sigma_2": "viscous"}


class UndeclaredFriction(Effect):
    """F = mu_c N sign(v) + sigma_2 v, the law coulomb_viscous, where the declared law is none; each term is tested on
    its own, and with both they are that law.

    Units: those of the law.
    Neutral: mu_c = 0, sigma_2 = 0.
    Occurs: in the hinges, bearings and seals that nobody thought of.
    Experiment: constant speeds, slow and fast: Coulomb friction is the same, viscous friction climbs with the speed.
    """

    name = "friction"
    parameters = tuple(
        replace(par, value=0.0, neutral=0.0, group=GROUPS[par.name]) if par.value is None else replace(par, hidden=True)
        for par in LAW.parameters
    )

    def applies(self, system, law, others=()):
        return not law.parameters

    def force(self, c, p, law):
        return LAW.force(c, p)
