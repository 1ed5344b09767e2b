"""Sensitivities at many shapes of an effect at once, against those of one shape after another."""

import numpy as np
import pytest

from frictionpinn.numerics.paths import InputPath
from frictionpinn.numerics.simulate import Simulator
from frictionpinn.numerics.tangent import Tangent
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.contacts import law_named
from frictionpinn.physics.mechanism import Mechanism

LUGRE = {"sigma_0": 1e5, "sigma_1": 300.0, "sigma_2": 0.4, "mu_c": 0.25, "mu_s": 0.4, "v_s": 0.01}
SHAPES = {
    ("ripple_friction_sin", "ripple_friction_cos"): [{"ripple_wavelength": w} for w in (0.01, 0.03, 0.2)],
    ("vibration_sin", "vibration_cos"): [{"vibration_frequency": f} for f in (1.0, 7.3)],
    ("low_speed",): [{"low_speed_scale": s} for s in (0.01, 0.1)],
    ("spring_stiffness",): [{"spring_rest": s} for s in (-0.1, 0.0, 0.1)],
}


def swing(effects, steady=True):
    system = SYSTEMS["pob"](m_b=0.5, m_L=1.0, d=0.25, J_L=0.042, g=9.81)
    t = np.linspace(0.0, 0.5, 201)
    theta = 1.1 * np.sin(6 * t)
    signals = {"theta": theta, "omega": 6.6 * np.cos(6 * t), "alpha": -39.6 * np.sin(6 * t)}
    simulator = Simulator(Mechanism(system, LAWS["lugre"](), effects))
    path = InputPath.from_signals(simulator.mechanism, t, signals)
    start = {} if steady else {"z": 1e-6}
    run = simulator.simulate(t, path, LUGRE, start, z0="steady", strict=True)
    return simulator, path, run


@pytest.mark.parametrize("steady", [True, False])
def test_shapes_at_once_as_one_after_another(steady):
    simulator, path, run = swing(("ripple", "vibration", "low_speed", "spring_force", "sensor_scale"), steady)
    tangent = Tangent(simulator, run, path, LUGRE, steady=steady)
    for strengths, shapes in SHAPES.items():
        found, k = tangent.respond(strengths, shapes), len(strengths)
        for j, shape in enumerate(shapes):
            alone = simulator.differentiate(run, path, LUGRE | shape, strengths, steady=steady)
            assert set(found) == set(alone)
            for name, values in alone.items():
                own = found[name][:, j * k : (j + 1) * k]
                assert np.abs(own - values).max() <= 1e-9 * max(np.abs(values).max(), 1e-12), (name, shape)


def test_shapes_of_an_effect_at_one_of_two_contacts():
    law = law_named({"motor": "dahl", "load": "coulomb_viscous"}, "friction")
    mechanism = Mechanism(SYSTEMS["two_mass"](), law, ("low_speed@load",))
    p = {"motor.sigma_0": 50.0, "motor.mu_c": 0.1, "load.mu_c": 0.3, "load.sigma_2": 0.02}
    t, simulator = np.linspace(0.0, 0.3, 31), Simulator(mechanism)
    path = InputPath.from_signals(mechanism, t, {"tau": 1.2 * np.sin(12 * t)})
    start = {"motor.z": 1e-4}
    run = simulator.simulate(t, path, p, start, z0="steady", strict=True)
    shapes = [{"load.low_speed_scale": s} for s in (0.2, 2.0)]
    found = Tangent(simulator, run, path, p, steady=()).respond(["load.low_speed"], shapes)
    for j, shape in enumerate(shapes):
        alone = simulator.differentiate(run, path, p | shape, ["load.low_speed"], steady=())
        assert set(found) == set(alone) and np.abs(alone["omega_l"]).max() > 1e-4
        for name, values in alone.items():
            assert np.abs(found[name][:, [j]] - values).max() <= 1e-9 * max(np.abs(values).max(), 1e-12), (name, shape)


def test_what_acts_in_a_sensor_or_by_a_delay_is_not_answered():
    simulator, _, _ = swing(("ripple", "sensor_bias", "sensor_delay"))
    assert Tangent.answers(simulator, ("ripple_sin", "ripple_cos"))
    assert not Tangent.answers(simulator, ("bias_x",))
    assert not Tangent.answers(simulator, ("sensor_delay_x",))
