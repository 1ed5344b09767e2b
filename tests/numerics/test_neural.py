"""Systems whose friction is a torch module, against the compiled simulator with the same friction as a law."""

import numpy as np
import pytest
import sympy as sp
import torch

from frictionpinn.errors import UserError
from frictionpinn.numerics.neural import integrate_with_network
from frictionpinn.numerics.paths import InputPath
from frictionpinn.numerics.simulate import ContactLost, SimulationFailed, Simulator
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.mechanism import Mechanism
from frictionpinn.physics.system import TIME

T = np.arange(101) / 400
P = {"mu_c": 0.3, "sigma_2": 0.4, "v_t": 5e-3}


class Smooth(torch.nn.Module):
    """The law ``coulomb_viscous`` as a module."""

    def forward(self, v_slip, normal, a_frictionless):
        assert v_slip.shape == normal.shape == a_frictionless.shape
        assert v_slip.dtype == torch.float64
        x = v_slip / P["v_t"]
        return P["mu_c"] * normal * torch.tanh(x + x**3 / 3) + P["sigma_2"] * v_slip


CASES = {
    "pob": {"theta": sp.rad(50) * sp.sin(2 * sp.pi * TIME)},
    "sdob": {"y": 0.21 + 0.02 * sp.sin(9 * TIME), "force": 9 * sp.sin(7 * TIME)},
    "drive": {"force": sp.sin(7 * TIME)},
    "pendulum": {"tau": 6 * sp.sin(7 * TIME)},
    "damper": {"x": 0.01 * sp.sin(9 * TIME)},
}


def mechanism(system):
    return Mechanism(SYSTEMS[system](), LAWS["coulomb_viscous"]())


@pytest.mark.parametrize("system", CASES)
def test_a_network_equal_to_a_law_moves_as_the_law_does(system):
    path = InputPath.from_expressions(mechanism(system), T, CASES[system])
    expected = Simulator(mechanism(system)).simulate(T, path, P)
    result = integrate_with_network(mechanism(system).system, Smooth(), T, path)
    np.testing.assert_allclose(result.v, expected.v, atol=2e-5)
    np.testing.assert_allclose(result.F, expected.F, atol=5e-3 * np.abs(expected.F).max())
    assert set(result.signals) == set(expected.signals)


def test_trials_integrated_together_equal_trials_integrated_alone():
    swings = [{"theta": sp.rad(a) * sp.sin(2 * sp.pi * TIME)} for a in (35, 50, 65)]
    paths = [InputPath.from_expressions(mechanism("pob"), T, swing) for swing in swings]
    together = integrate_with_network(mechanism("pob").system, Smooth(), T, paths, [{}, {"v": 0.1}, {"x": 1.0}])
    alone = integrate_with_network(mechanism("pob").system, Smooth(), T, paths[1], {"v": 0.1})
    assert len(together) == 3
    assert together[2].q[0] == 1.0
    np.testing.assert_allclose(together[1].v, alone.v, atol=2e-5)


def test_a_network_in_single_precision_works():
    network = torch.nn.Sequential(torch.nn.Linear(3, 8), torch.nn.Tanh(), torch.nn.Linear(8, 1))

    def friction(*signals):
        return network(torch.stack(signals, dim=-1).float()).squeeze(-1)

    result = integrate_with_network(SYSTEMS["drive"](), friction, T, {"force": np.sin(7 * T)})
    assert np.isfinite(result.v).all()
    assert result.v.dtype == float


def test_loss_of_contact_names_the_time():
    swing = InputPath.from_expressions(mechanism("pob"), T, {"theta": sp.rad(50) * sp.cos(3 * sp.pi * TIME)})
    with pytest.raises(ContactLost, match=r"contact lost at t = 0\.1"):
        integrate_with_network(SYSTEMS["pob"](), Smooth(), T, swing)


def test_values_that_are_not_finite_are_named():
    with pytest.raises(SimulationFailed, match="not finite"):
        integrate_with_network(SYSTEMS["drive"](), lambda v, n, a: v / 0.0, T, {})


def test_a_normal_force_that_the_friction_decides_is_refused():
    with pytest.raises(UserError, match="normal force depends on accelerations"):
        integrate_with_network(SYSTEMS["pob"](driven=()), Smooth(), T, {})


def test_an_unknown_state_is_refused():
    with pytest.raises(UserError, match=r"y0\.w"):
        integrate_with_network(SYSTEMS["drive"](), Smooth(), T, {}, {"w": 1.0})
