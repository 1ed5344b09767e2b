"""Rollout of a tabulated sliding force: with LuGre's own table it is LuGre's motion."""

import numpy as np
import sympy as sp
from scipy.interpolate import CubicSpline

from frictionpinn.evaluate.characteristics import mobility
from frictionpinn.models.in_motion import LAW, law_values
from frictionpinn.numerics.codegen import pointer
from frictionpinn.numerics.paths import InputPath
from frictionpinn.numerics.simulate import Simulator
from frictionpinn.numerics.stick_slip import bristle_rollout
from frictionpinn.numerics.torch_functions import contact_signals
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.mechanism import Mechanism
from frictionpinn.physics.system import TIME

T, STEPS = np.arange(401) / 400, 32
LUGRE = {"sigma_0": 1e5, "sigma_1": 316.23, "sigma_2": 0.4, "mu_c": 0.3, "mu_s": 0.6, "v_s": 1e-3}


def test_a_bristle_that_settles_to_coulomb_friction_moves_as_the_simulated_law():
    system = SYSTEMS["pob"]()
    mechanism = Mechanism(system, LAWS["lugre"]())
    path = InputPath.from_expressions(mechanism, T, {"theta": sp.rad(50) * sp.sin(2 * sp.pi * TIME)})
    expected = Simulator(mechanism).simulate(T, path, LUGRE)
    seen = contact_signals(system, expected.signals)
    fine = np.linspace(0, T[-1], (len(T) - 1) * STEPS + 1)
    A, N = (CubicSpline(T, seen[name])(fine) for name in ("a_frictionless", "normal_force"))
    loads = np.linspace(1.0, 40.0, 5)
    table, grid = np.tile(0.3 * loads, (3, 1)), np.array([-2.0, 2.0, loads[0], loads[1] - loads[0]])
    p = law_values(LUGRE | {"peak": 1.0, "peak_velocity": 1e-3})
    kernels = (pointer(LAW.kernels.rate), pointer(LAW.kernels.force))
    force, slip = bristle_rollout(
        *kernels, table, grid, A, N, fine[1], mobility(system), 0.0, expected.F[0], 0.0, 1.0, p, STEPS
    )
    assert np.sqrt(np.mean((slip - expected.v_slip) ** 2)) < 2e-3 * np.abs(expected.v_slip).max()
    assert np.sqrt(np.mean((force - expected.F) ** 2)) < 0.02 * np.abs(expected.F).max()
