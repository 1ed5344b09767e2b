"""An input force whose gain is not the declared one."""

from ..effect import Effect, applied, strength


class GainError(Effect):
    """u becomes (1 + gain_error_u) u for every input force u that acts.

    Units: dimensionless.
    Neutral: gain_error_u = 0.
    Occurs: with motor constants, amplifiers and force sensors.
    Experiment: constant speed and acceleration together: alone, either hides in friction or in mass.
    """

    name = "gain_error"
    whole = True

    def applies(self, system, law, others=()):
        return bool(applied(system))

    def make_parameters(self, system, law):
        return tuple(
            strength(f"gain_error_{name}", "1", f"relative error of {name}", -0.99, group=name)
            for name in applied(system)
        )

    def replace(self, system, law, p):
        return {u: (1 + getattr(p, f"gain_error_{name}")) * u for name, u in applied(system).items()}
