"""A sensor with an offset."""

from ..effect import Effect, given, predicted, strength


class SensorBias(Effect):
    """Measured y = true y + bias_y for every measured signal y, driven coordinates' too; each alone.

    Units: of the signal.
    Neutral: bias_y = 0.
    Occurs: with zero errors of encoders and gyros, charge amplifiers, gravity in an accelerometer.
    Experiment: rest at a known place.
    """

    name = "sensor_bias"
    whole = True

    def make_parameters(self, system, law):
        units = predicted(system) | {name: unit for name, (unit, _) in given(system).items()}
        return tuple(strength(f"bias_{y}", unit, f"offset of {y}", group=y) for y, unit in units.items())

    def replace(self, system, law, p):
        return {symbol: symbol - getattr(p, f"bias_{y}") for y, (_, symbol) in given(system).items()}

    def sensor(self, system, signal, y, p):
        return y + getattr(p, f"bias_{signal}")
