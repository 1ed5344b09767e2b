"""Dry friction with a level of its own in some trials."""

import sympy as sp

from ..effect import Effect, strength

TRIALS = 10  # of a session, from the first, whose levels may differ


class TrialLevel(Effect):
    """The law sees N (1 + trial_level_k) in trial k of the session, k = 1 to 10; each is tested on its own.

    So the law's own parameters are those of the trials without a level. Drift changes all trials one after another.

    Units: dimensionless.
    Neutral: every trial_level_k = 0.
    Occurs: where between trials somebody cleaned, lubricated or tightened, or clamped another specimen.
    Experiment: the same motion in every trial, and trials before and after a pause in which nobody touched anything.
    """

    name = "trial_level"
    parameters = tuple(
        strength(f"trial_level_{k}", "1", f"relative change of dry friction in trial {k}", -1.0, group=str(k))
        for k in range(1, TRIALS + 1)
    )

    def load(self, N, c, p):
        levels = [(getattr(p, par.name), sp.Eq(c.trial, k)) for k, par in enumerate(self.parameters, 1)]
        return N * (1 + sp.Piecewise(*levels, (0, True)))
