"""Simulators with only the effects that a fit needs."""

import numpy as np
import pytest
from test_diagnosis import recorded

from frictionpinn.diagnose.bench import Bench
from frictionpinn.numerics.paths import InputPath
from frictionpinn.physics import LAWS
from frictionpinn.physics.effects import effects_for
from frictionpinn.physics.mechanism import Mechanism


@pytest.fixture(scope="module")
def bench() -> Bench:
    system, made = recorded()
    law = LAWS["lugre"]()
    effects = effects_for(system, law, ["ripple", "drag", "dwell"])
    return Bench(Mechanism(system, law), effects, (), made.select(made.names[:2]), made.select(()))


def names(simulator):
    return [effect.name for effect in simulator.mechanism.effects]


def test_effects_are_part_where_free_or_not_neutral(bench):
    p = bench.base.values
    assert names(bench.part(("mu_c",), p)) == []
    assert names(bench.part(("mu_c", "drag"), p)) == ["drag"]
    assert names(bench.part(("mu_c", "drag"), p | {"ripple_sin": 0.1})) == ["ripple", "drag"]


def test_a_part_is_made_once(bench):
    p = bench.base.values
    assert bench.part(("drag",), p) is bench.part(("mu_s", "drag"), p)


def test_a_part_moves_as_the_whole_does(bench):
    p = bench.base.values | {"drag": 0.5}
    t = np.linspace(0.0, 0.5, 201)
    runs = []
    for simulator in (bench.simulator, bench.part((), p)):
        path = InputPath.from_signals(simulator.mechanism, t, {"force": 8 * np.sin(20 * t)})
        runs.append(simulator.simulate(t, path, p, z0="steady"))
    assert names(bench.part((), p)) == ["drag"]
    assert np.abs(runs[0].v - runs[1].v).max() < 1e-5 < np.abs(runs[0].v).max()
