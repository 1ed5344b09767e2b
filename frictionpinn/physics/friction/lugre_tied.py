"""LuGre friction whose bristle damping follows from the bristle stiffness, as the published table suggests."""

import sympy as sp

from ..base import ALPHA, MU_C, MU_S, SIGMA_0, SIGMA_2, V_S, Parameter
from .lugre import LuGre

INERTIA = Parameter("tied_inertia", "{F}*s^2/{L}", "ties the bristle's damping to its stiffness", value=1.0)


class TiedLuGre(LuGre):
    """LuGre with sigma_1 = sqrt(sigma_0 m), the bristle's damping ratio 1/2 on an inertia m (1 kg by default).

    In SI units and with m = 1 that is sigma_1 = sqrt(sigma_0), which the published values of PE1 and PE2 satisfy to
    every printed digit. Units: as LuGre; m in force times second squared per slip.
    Source: Ozmen, Hespanha and Byl, arXiv 2504.12441, the table of identified parameters.
    """

    name = "lugre_tied"
    parameters = (SIGMA_0, SIGMA_2, MU_C, MU_S, V_S, ALPHA, INERTIA)

    def force(self, c, p):
        return p.sigma_0 * c.z + sp.sqrt(p.sigma_0 * p.tied_inertia) * c.zdot + p.sigma_2 * c.v
