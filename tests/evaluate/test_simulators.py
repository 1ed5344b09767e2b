"""Simulators' own friction: the right motion where Coulomb friction acts, a fit within bounds, what is left out."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

from frictionpinn.data.contact import ContactTrial
from frictionpinn.errors import UserError
from frictionpinn.evaluate import simulators as module
from frictionpinn.evaluate.simulators import BULLET, SIMULATORS, fit, simulators
from frictionpinn.evaluate.yardsticks import simulated_law
from frictionpinn.numerics.paths import InputPath
from frictionpinn.numerics.simulate import Simulator
from frictionpinn.numerics.simulation import ContactLost
from frictionpinn.numerics.torch_functions import contact_signals
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.mechanism import Mechanism
from frictionpinn.physics.system import TIME

POB = SYSTEMS["pob"]()
T = np.arange(161) / 400
COULOMB = {"mu_c": 0.3, "v_t": 1e-3}
OWN = {
    "mujoco": {"friction": 0.3, "solreffriction": 0.01, "solref": 1e-3, "compliance": 0.5, "damping": 1e-4},
    "pybullet": {"lateralFriction": 0.3, "linearDamping": 1e-4},
}


def coulomb():
    mechanism = Mechanism(POB, LAWS["coulomb"]())
    path = InputPath.from_expressions(mechanism, T, {"theta": sp.rad(55) * sp.sin(2 * sp.pi * TIME)})
    return path, Simulator(mechanism).simulate(T, path, COULOMB)


@pytest.mark.parametrize("name", SIMULATORS)
def test_coulomb_friction_moves_the_box_as_the_derived_equations_say(name):
    pytest.importorskip(SIMULATORS[name][0])
    path, expected = coulomb()
    found = SIMULATORS[name][3](POB, path, {}, OWN[name])
    assert np.sqrt(np.mean((found.q - expected.q) ** 2)) < 0.05 * np.abs(expected.q).max()
    assert np.mean((found.F - expected.F) ** 2) < 0.03 * np.mean(expected.F**2)
    np.testing.assert_allclose(found.N, expected.N, rtol=1e-6)
    assert set(found.signals) >= {"x", "v", "a", "theta", "omega", "alpha"}


@pytest.mark.parametrize("name", SIMULATORS)
def test_a_box_that_stands_still_takes_the_load_of_the_link(name):
    pytest.importorskip(SIMULATORS[name][0])
    mechanism = Mechanism(POB, LAWS["coulomb"]())
    path = InputPath.from_expressions(mechanism, T, {"theta": sp.rad(10) * sp.sin(2 * sp.pi * TIME)})
    found = SIMULATORS[name][3](POB, path, {}, OWN[name])
    held = contact_signals(POB, {**path.signals, **dict.fromkeys(("x", "v", "a"), 0 * T)})["friction_force"]
    assert np.abs(found.F - held)[5:].max() < 0.05 * np.abs(held).max()


def test_the_fit_finds_the_friction_that_acts():
    pytest.importorskip("pybullet")
    _, run = coulomb()
    signals = {**run.signals, "tau": 0 * T}
    trial = ContactTrial("1", T, contact_signals(POB, signals), {}, {}, {}, {}, signals)
    fitted = fit(lambda *args: SIMULATORS["pybullet"][3](POB, *args), BULLET, POB, [trial])
    assert fitted["lateralFriction"] == pytest.approx(0.3, rel=0.03)


def test_contact_that_is_lost_is_told():
    pytest.importorskip("mujoco")
    mechanism = Mechanism(POB, LAWS["coulomb"]())
    path = InputPath.from_expressions(mechanism, T, {"theta": sp.rad(50) * sp.cos(4 * sp.pi * TIME)})
    with pytest.raises(ContactLost):
        SIMULATORS["mujoco"][3](POB, path, {}, OWN["mujoco"])


def test_other_systems_have_none_and_unknown_names_are_told():
    assert simulators(["mujoco", "pybullet"], SYSTEMS["drive"](), []) == {}
    with pytest.raises(UserError, match="did you mean 'mujoco'"):
        simulators(["mujco"], POB, [])


def test_a_simulator_that_is_not_installed_is_left_out_with_a_word(monkeypatch, caplog):
    monkeypatch.setattr(module.importlib.util, "find_spec", lambda name: None)
    assert simulators(["mujoco"], POB, []) == {}
    assert "MuJoCo is not installed" in caplog.text


def test_a_law_simulated_along_an_imposed_motion_has_its_friction_alone():
    system, truth = SYSTEMS["drive"](imposed=True, M=2.0), {"mu_c": 3.0, "sigma_2": 4.0}
    t = np.linspace(0, 1, 201)
    signals = {"x": 0.05 * np.sin(6 * t), "v": 0.3 * np.cos(6 * t), "a": -1.8 * np.sin(6 * t)}
    path = InputPath.from_signals(Mechanism(system, LAWS["coulomb_viscous"]()), t, signals)
    found = simulated_law(system, "coulomb_viscous", truth)(path, {})
    slides = np.abs(signals["v"]) > 1e-3
    wanted = 3.0 * np.sign(signals["v"]) + 4.0 * signals["v"]
    np.testing.assert_allclose(found.F[slides], wanted[slides], atol=1e-6)
