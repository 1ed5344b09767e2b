"""Dry friction that differs by direction."""

from ..effect import Effect, direction, strength


class Asymmetry(Effect):
    """The law sees N (1 + asymmetry sign(v)).

    Units: asymmetry dimensionless: 0.05 is 5 % more dry friction forwards and 5 % less backwards.
    Neutral: asymmetry = 0.
    Occurs: with worn or directional surfaces, seals, misaligned guides, belts.
    Experiment: both directions at the same speeds and loads.
    """

    name = "asymmetry"
    signed = True
    parameters = (strength("asymmetry", "1", "share by which dry friction is higher forwards", -0.99, 0.99),)

    def load(self, N, c, p):
        return N * (1 + p.asymmetry * direction(c, p))
