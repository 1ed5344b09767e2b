"""Position, velocity and acceleration of a driven coordinate are one motion: the sensor of each can be wrong."""

import numpy as np
import pytest

from frictionpinn.data.noise import GaussianNoise
from frictionpinn.data.simulated import simulate_trials
from frictionpinn.identify import Problem, maximum_likelihood
from frictionpinn.numerics.spline_basis import choose_basis
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.mechanism import Mechanism

LAW = {"mu_c": 0.25, "sigma_2": 0.5, "v_t": 1e-4}
TRIALS = [{"duration": 1.5, "theta": f"{swing}*deg*sin(6.3*t + 0.3*sin(3*t))"} for swing in (40, 30)]
WRONG = {"bias_theta": 0.03, "bias_omega": 0.1, "bias_alpha": 0.8, "scale_omega": 0.05, "scale_alpha": -0.06,
         "scale_theta_omega_alpha": 0.04}  # fmt: skip


def mechanism() -> Mechanism:
    return Mechanism(SYSTEMS["pob"](), LAWS["coulomb_viscous"](), ("sensor_bias", "sensor_scale"))


def recorded(**wrong: float):
    return simulate_trials(mechanism(), LAW | wrong, TRIALS, 200.0)


@pytest.mark.parametrize("name", ["bias_alpha", "scale_omega"])
def test_a_wrong_sensor_of_a_driven_motion_changes_what_is_recorded_of_it_and_nothing_else(name):
    right, wrong = recorded().trials[0].signals, recorded(**{name: WRONG[name]}).trials[0].signals
    kind, _, signal = name.partition("_")
    shown = right[signal] * (1 + WRONG[name]) if kind == "scale" else right[signal] + WRONG[name]
    for own in right:
        assert wrong[own] == pytest.approx(shown if own == signal else right[own], abs=1e-6), own


@pytest.mark.parametrize("name", WRONG)
def test_it_is_found_with_the_friction(name):
    noisy = GaussianNoise(0.02)(recorded(**{name: WRONG[name]}), 0)
    free = ("mu_c", "sigma_2", name)
    estimate = maximum_likelihood(mechanism(), noisy, free=free, fixed={"v_t": LAW["v_t"]})
    truth = LAW | WRONG
    for own in free:
        assert abs(estimate.values[own] - truth[own]) < 4 * estimate.std[own], estimate
    assert estimate.std[name] < 0.25 * abs(WRONG[name]), estimate


def test_derivatives_of_the_likelihood_are_right_where_sensors_are_wrong():
    problem = Problem(mechanism(), recorded(**WRONG), free=(*LAW, *WRONG), sigmas=dict.fromkeys(
        ("x", "v", "a", "theta", "omega", "alpha"), 0.05))  # fmt: skip
    model = problem.trials[0]
    values = problem.fixed | LAW | WRONG
    names = (*(name for name in LAW if name != "v_t"), *WRONG)
    local = model.local + 0.02

    def cost(p, own) -> float:
        return model.evaluate(p, own, problem.sigmas, problem.loss, strict=True, rtol=1e-8, atol=1e-9).cost

    piece = model.evaluate(values, local, problem.sigmas, problem.loss, names, rtol=1e-8, atol=1e-9)
    for found, name in zip(piece.grad_g, names, strict=True):
        up, down = ({**values, name: values[name] + step} for step in (1e-6, -1e-6))
        assert found == pytest.approx((cost(up, local) - cost(down, local)) / 2e-6, rel=1e-3, abs=1e-3), name
    for j in (len(model.states) + 2, len(model.states) + 7):
        step = 1e-6 * (np.arange(len(local)) == j)
        numeric = (cost(values, local + step) - cost(values, local - step)) / 2e-6
        assert piece.grad_l[j] == pytest.approx(numeric, rel=1e-3)


@pytest.mark.parametrize(("factor", "offset"), [(1.0, 15.0), (1.1, 0.0)])
def test_a_wrong_sensor_is_not_taken_for_a_motion_that_no_spline_follows(factor, offset):
    t, generator = np.arange(800) / 400, np.random.default_rng(0)
    y = np.stack([np.sin(6 * t), 6 * np.cos(6 * t), -36 * np.sin(6 * t)])
    sigmas = 0.02 * y.std(axis=1)
    noisy = y + sigmas[:, None] * generator.standard_normal(y.shape)
    wrong = noisy * [[1.0], [1.0], [factor]] + [[0.0], [0.0], [offset]]
    right, found = choose_basis(t, noisy, sigmas, 200), choose_basis(t, wrong, sigmas, 200)
    assert found is not None and found.size <= 1.5 * right.size
