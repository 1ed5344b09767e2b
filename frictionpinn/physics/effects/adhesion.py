"""Friction without load."""

from ..effect import Effect, load_varies, strength


class Adhesion(Effect):
    """The law sees N + adhesion: friction is left where the normal force goes to zero.

    Units: adhesion in the system's unit of force.
    Neutral: adhesion = 0.
    Occurs: with clean, soft, wet or magnetic surfaces, and where a preload was not declared.
    Experiment: the same motion under several loads, or a load that swings.
    """

    name = "adhesion"
    parameters = (strength("adhesion", "{F}", "attraction that adds to the normal force", 0.0),)

    def applies(self, system, law, others=()):
        return load_varies(system)

    def load(self, N, c, p):
        return N + p.adhesion
