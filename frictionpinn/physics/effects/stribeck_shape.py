"""Another shape of the Stribeck curve."""

from ..effect import Effect, strength


class StribeckShape(Effect):
    """alpha becomes alpha + stribeck_shape in exp(-|v/v_s|^alpha); for laws with the Stribeck effect.

    Units: dimensionless.
    Neutral: stribeck_shape = 0.
    Occurs: with surfaces and lubricants whose friction falls more gently (-1) or more abruptly than a Gaussian.
    Experiment: constant speeds around v_s, closely spaced.
    """

    name = "stribeck_shape"
    parameters = (strength("stribeck_shape", "1", "change of the Stribeck exponent", -1.9, 2.0),)

    def applies(self, system, law, others=()):
        return any(par.name == "alpha" for par in law.parameters)

    def replace(self, system, law, p):
        return {p.alpha: p.alpha + p.stribeck_shape}
