"""Coulomb (dry) friction."""

from ..base import MU_C, V_T, FrictionLaw, sign_smooth


class Coulomb(FrictionLaw):
    """F = mu_c N sign(v), the sign regularised over v_t, see :func:`frictionpinn.physics.base.sign_smooth`.

    Units: F in the system's unit of force, v in its unit of slip per second, mu_c dimensionless.
    Source: C. A. Coulomb, Theorie des machines simples (1785); regularised as in any multibody code.
    """

    name = "coulomb"
    parameters = (MU_C, V_T)

    def capacity(self, c, p):
        return p.mu_c * c.N

    def force(self, c, p):
        return p.mu_c * c.N * sign_smooth(c.v, p.v_t)
