"""A sensor that shows a signal late."""

from ..effect import Effect, applied, given, sensed, strength
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

    def equivalents(self, system, law):
        """All that is predicted late, or all that drives early: no clock tells which."""
        whole = {name: key for key, names in sensed(system).items() for name in names}  # the largest group of each
        late = {whole[name] for c in system.free for name in c.signals if name in whole}
        early = {f"sensor_delay_{whole[name]}": -1.0 for name in given(system)}
        early |= {f"delay_{name}": 1.0 for name in applied(system)}
        if system.massless or len(late) != 1 or len(early) != 1:
            return {}
        return {(f"sensor_delay_{late.pop()}", other): factor for other, factor in early.items()}
