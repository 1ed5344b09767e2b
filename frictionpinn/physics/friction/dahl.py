"""Dahl friction: presliding hysteresis without the Stribeck effect."""

import sympy as sp

from ..base import MU_C, SIGMA_0, FrictionLaw


class Dahl(FrictionLaw):
    """F = sigma_0 z with z' = v - sigma_0 |v| z / (mu_c N).

    Units: z in the system's unit of slip, sigma_0 in force per slip.
    Source: P. R. Dahl, A solid friction model, Aerospace Corp. TOR-158 (1968).
    """

    name = "dahl"
    parameters = (SIGMA_0, MU_C)
    memory = True

    def capacity(self, c, p):
        return p.mu_c * c.N

    def bristle_rate(self, c, p):
        return c.v - p.sigma_0 * sp.Abs(c.v) * c.z / self.capacity(c, p)

    def force(self, c, p):
        return p.sigma_0 * c.z
