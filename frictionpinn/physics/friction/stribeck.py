"""Static friction with the Stribeck effect: a map from velocity and normal force to force."""

from ..base import ALPHA, MU_C, MU_S, SIGMA_2, V_S, V_T, FrictionLaw, sign_smooth, stribeck_curve


class Stribeck(FrictionLaw):
    """F = g(v, N) sign(v) + sigma_2 v with g = N (mu_c + (mu_s - mu_c) exp(-|v/v_s|^alpha)).

    Units: F in the system's unit of force, v_s in slip per second. The sign is regularised over v_t, see
    :func:`frictionpinn.physics.base.sign_smooth`.
    Source: Armstrong-Helouvry, Dupont and Canudas de Wit, Automatica 30 (1994).
    """

    name = "stribeck"
    parameters = (MU_C, MU_S, V_S, ALPHA, SIGMA_2, V_T)

    def capacity(self, c, p):
        return stribeck_curve(c, p)

    def force(self, c, p):
        return stribeck_curve(c, p) * sign_smooth(c.v, p.v_t) + p.sigma_2 * c.v

    def constraints(self, p):
        return (p.mu_s - p.mu_c,)
