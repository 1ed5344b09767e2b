"""A sensor whose scale is wrong."""

from ..effect import Effect, given, sensed, strength


class SensorScale(Effect):
    """Measured y = (1 + scale_y) true y for every measured signal y, driven coordinates' too; each alone, and all
    signals of a coordinate together (scale_x_v_a), whose errors add.

    Units: dimensionless.
    Neutral: every scale = 0.
    Occurs: with wrong calibrations, gear ratios and encoder counts.
    Experiment: a known displacement, or two sensors of one motion.
    """

    name = "sensor_scale"
    whole = True

    def make_parameters(self, system, law):
        return tuple(
            strength(f"scale_{key}", "1", f"relative error of the scale of {', '.join(signals)}", -0.99, group=key)
            for key, signals in sensed(system).items()
        )

    def replace(self, system, law, p):
        return {symbol: symbol / self._factor(system, y, p) for y, (_, symbol) in given(system).items()}

    def sensor(self, system, signal, y, p):
        return self._factor(system, signal, p) * y

    def _factor(self, system, signal, p):
        return 1 + sum(getattr(p, f"scale_{key}") for key, signals in sensed(system).items() if signal in signals)
