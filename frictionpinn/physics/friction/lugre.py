"""LuGre friction: bristles with stiffness, damping, the Stribeck effect and viscous friction."""

import sympy as sp

from ..base import ALPHA, MU_C, MU_S, SIGMA_0, SIGMA_1, SIGMA_2, V_S, FrictionLaw, stribeck_curve


class LuGre(FrictionLaw):
    """F = sigma_0 z + sigma_1 z' + sigma_2 v with z' = v - sigma_0 |v| z / g(v, N).

    g = F_c + (F_s - F_c) exp(-|v/v_s|^alpha), F_c = mu_c N, F_s = mu_s N.
    Units: z in the system's unit of slip, sigma_0 in force per slip, sigma_1 and sigma_2 in force per slip velocity.
    Source: Canudas de Wit, Olsson, Astrom and Lischinsky, IEEE Trans. Automatic Control 40 (1995).
    """

    name = "lugre"
    parameters = (SIGMA_0, SIGMA_1, SIGMA_2, MU_C, MU_S, V_S, ALPHA)
    memory = True

    def capacity(self, c, p):
        return stribeck_curve(c, p)

    def bristle_rate(self, c, p):
        return c.v - p.sigma_0 * sp.Abs(c.v) * c.z / self.capacity(c, p)

    def force(self, c, p):
        return p.sigma_0 * c.z + p.sigma_1 * c.zdot + p.sigma_2 * c.v

    def constraints(self, p):
        return (p.mu_s - p.mu_c,)
