"""Dry friction that drifts through a session."""

from ..effect import Effect, strength


class Drift(Effect):
    """The law sees N (1 + drift t), t the time of the session: 0 where its first trial begins, it runs on through all.

    So the law's own parameters are those at the start of the session. Heat counts as time: a contact that warms at
    constant power drifts linearly at first.

    Units: drift per second.
    Neutral: drift = 0.
    Occurs: while a mechanism warms up, runs in, wears or loses lubricant.
    Experiment: the same motion repeated early and late in one session.
    """

    name = "drift"
    parameters = (strength("drift", "1/s", "relative change of dry friction per second"),)

    def load(self, N, c, p):
        return N * (1 + p.drift * c.session)
