"""A mass that differs from the declared one."""

from ..effect import Effect, strength


class Payload(Effect):
    """m becomes m + payload_m for every mass m (unit kg) that acts; each is tested on its own.

    Units: kg.
    Neutral: payload_m = 0.
    Occurs: with tools, workpieces, cables and screws that nobody weighed.
    Experiment: acceleration, and for a mass that loads the contact constant speed too.
    """

    name = "payload"
    whole = True

    def applies(self, system, law, others=()):
        return bool(self.parameters_on(system, law))

    def make_parameters(self, system, law):
        return tuple(
            strength(f"payload_{m.name}", "kg", f"added to: {m.text}", -0.9 * system.values[m.name], group=m.name)
            for m in system.parameters
            if m.unit == "kg" and m.symbol in system.acting
        )

    def replace(self, system, law, p):
        names = [par.name.removeprefix("payload_") for par in self.parameters_on(system, law)]
        return {getattr(p, m): getattr(p, m) + getattr(p, f"payload_{m}") for m in names}
