"""Coulomb and viscous friction, the customary first model of a drive."""

from ..base import MU_C, SIGMA_2, V_T, FrictionLaw, sign_smooth


class CoulombViscous(FrictionLaw):
    """F = mu_c N sign(v) + sigma_2 v, the sign regularised over v_t, see :func:`frictionpinn.physics.base.sign_smooth`.

    Units: F in the system's unit of force, sigma_2 in force per slip velocity.
    Source: Armstrong-Helouvry, Dupont and Canudas de Wit, Automatica 30 (1994).
    """

    name = "coulomb_viscous"
    parameters = (MU_C, SIGMA_2, V_T)

    def capacity(self, c, p):
        return p.mu_c * c.N

    def force(self, c, p):
        return p.mu_c * c.N * sign_smooth(c.v, p.v_t) + p.sigma_2 * c.v
