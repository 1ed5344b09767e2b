"""An input force that acts later than recorded."""

from ..effect import Effect, applied, strength
from ..scan import Scan


class Delay(Effect):
    """u(t) becomes u(t - delay_u) for every input force u: the path is shifted, not expanded in the delay.

    Where the motion is imposed and the force is what a simulation predicts, that is shown ahead of time instead.

    Units: s; negative where the recorded force itself is late (a filtered sensor).
    Neutral: delay_u = 0.
    Occurs: between command and current, with filters and clocks that differ.
    Experiment: steps and fast reversals of the force.
    """

    name = "delay"
    whole = True

    def applies(self, system, law, others=()):
        return bool(self._forces(system))

    def make_parameters(self, system, law):
        scan = Scan("interval", 0.5, 20, 5)
        return tuple(
            strength(f"delay_{name}", "s", f"delay of {name}", group=name, scan=scan) for name in self._forces(system)
        )

    def delays(self, system, law):
        sign = -1.0 if system.massless else 1.0
        return {name: {f"delay_{name}": sign} for name in self._forces(system)}

    def _forces(self, system):
        return [item.name for item in system.inputs] if system.massless else list(applied(system))
