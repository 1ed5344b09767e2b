"""Simulators with only the effects that a fit needs."""

import numpy as np
import pytest

from frictionpinn.diagnose.parts import Parts
from frictionpinn.numerics.paths import InputPath
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.mechanism import Mechanism

LUGRE = {"sigma_0": 1e5, "sigma_1": 300.0, "sigma_2": 0.4, "mu_c": 0.25, "mu_s": 0.4, "v_s": 0.01}


@pytest.fixture(scope="module")
def parts():
    system, law = SYSTEMS["pob"](m_b=0.5, m_L=1.0, d=0.25, J_L=0.042, g=9.81), LAWS["lugre"]()
    return Parts(Mechanism(system, law), Mechanism(system, law, ("ripple", "drag", "dwell")))


def values(parts, **others):
    defaults = {par.name: par.value for par in parts.tested.parameters} | parts.tested.system.values
    return defaults | LUGRE | others


def names(simulator):
    return [effect.name for effect in simulator.mechanism.effects]


def test_effects_are_part_where_free_or_not_neutral(parts):
    assert names(parts.of(("mu_c",), values(parts))) == []
    assert names(parts.of(("mu_c", "drag"), values(parts))) == ["drag"]
    assert names(parts.of(("mu_c", "drag"), values(parts, ripple_sin=0.1))) == ["ripple", "drag"]


def test_a_part_is_made_once(parts):
    assert parts.of(("drag",), values(parts)) is parts.of(("mu_s", "drag"), values(parts))


def test_a_part_moves_as_the_whole_does(parts):
    p = values(parts, drag=0.5)
    t = np.linspace(0.0, 0.5, 201)
    signals = {"theta": 1.1 * np.sin(6 * t), "omega": 6.6 * np.cos(6 * t), "alpha": -39.6 * np.sin(6 * t)}
    runs = []
    for simulator in (parts.whole, parts.of((), p)):
        runs.append(simulator.simulate(t, InputPath.from_signals(simulator.mechanism, t, signals), p, z0="steady"))
    assert names(parts.of((), p)) == ["drag"]
    assert np.abs(runs[0].v - runs[1].v).max() < 1e-5
