"""A sensor that shows a signal late."""

from ..effect import Effect, given, sensed, strength
from ..scan import Scan


class SensorDelay(Effect):
    """Measured y(t) = true y(t - sensor_delay_y) for every measured signal y, driven coordinates' too; each alone, and
    all signals of a coordinate together (sensor_delay_x_v_a).

    Units: s.
    Neutral: every sensor_delay = 0.
    Occurs: with filters, buses and cameras.
    Experiment: fast reversals.
    """

    name = "sensor_delay"
    whole = True

    def make_parameters(self, system, law):
        scan = Scan("interval", 0.5, 20, 5)
        return tuple(
            strength(f"sensor_delay_{key}", "s", f"delay of {', '.join(signals)}", group=key, scan=scan)
            for key, signals in sensed(system).items()
        )

    def delays(self, system, law):
        result = {}
        for key, signals in sensed(system).items():
            for y in signals:
                result.setdefault(y, {})[f"sensor_delay_{key}"] = -1.0 if y in given(system) else 1.0
        return result
