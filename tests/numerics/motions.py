"""Every mechanism with parameters and a path of its driven coordinates, for the tests of the simulator."""

from functools import cache

from short_paths import LAW_VALUES, PATHS, T

from frictionpinn.numerics.paths import InputPath
from frictionpinn.numerics.simulate import Simulator
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.mechanism import Mechanism


@cache
def simulator(system, law, driven=None, effects=()):
    return Simulator(Mechanism(SYSTEMS[system](driven=driven), LAWS[law](), effects))


def values(law, **changed):
    return {par.name: LAW_VALUES[par.name] for par in LAWS[law].parameters} | changed


def path(sim, t=T, expressions=None):
    return InputPath.from_expressions(sim.mechanism, t, expressions or PATHS[sim.mechanism.system.name])
