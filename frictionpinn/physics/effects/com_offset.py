"""A centre of mass that is not where it was declared."""

from ..effect import Effect, strength


class CentreOfMassOffset(Effect):
    """The lever arm d of a swinging body becomes d + com_along, its angle grows by com_across / d.

    So the centre of mass lies com_along further out and com_across (along the arc) beside its declared line.

    Units: m.
    Neutral: com_along = 0, com_across = 0.
    Occurs: with swinging bodies that carry a load, a motor or a cable.
    Experiment: slow and fast swings through large angles.
    """

    name = "com_offset"
    whole = True

    def applies(self, system, law, others=()):
        return system.lever is not None

    def make_parameters(self, system, law):
        along = "centre of mass beyond its declared distance"
        across = "centre of mass beside its declared line, towards positive angles"
        return (
            strength("com_along", "m", along, -0.9 * system.values[system.lever[0]], group="along"),
            strength("com_across", "m", across, group="across"),
        )

    def replace(self, system, law, p):
        arm, angle = getattr(p, system.lever[0]), getattr(system.s, system.lever[1])
        return {arm: arm + p.com_along, angle: angle + p.com_across / arm}
