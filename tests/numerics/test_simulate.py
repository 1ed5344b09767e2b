"""The simulator against independent references: scipy's Radau and conserved quantities."""

import numpy as np
import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st
from motions import all_values, path, radau, simulator, values
from short_paths import EVERY, PATHS, SWING, T

from frictionpinn.errors import UserError
from frictionpinn.numerics.simulate import ContactLost, SimulationFailed, Steps
from frictionpinn.physics.system import TIME


@pytest.mark.parametrize("system, law", [("pob", "lugre"), ("pob", "dahl"), ("sdob", "lugre"), ("drive", "stribeck")])
def test_agrees_with_radau(system, law):
    sim = simulator(system, law)
    reference = radau(sim.mechanism, values(law), PATHS[system], T, np.zeros(len(sim.state_names)))
    result = sim.simulate(T, path(sim), values(law))
    assert np.abs(result.v[:, 0] - reference[1]).max() < 2e-5
    assert np.abs(result.q[:, 0] - reference[0]).max() < 1e-5


def test_agrees_with_radau_where_the_normal_force_depends_on_free_accelerations():
    sim = simulator("pob", "lugre", ())
    tau = {"tau": 0.3 * sp.sin(6 * TIME)}
    reference = radau(sim.mechanism, values("lugre"), tau, T, [0, 0.4, 0, 0, 0])
    result = sim.simulate(T, path(sim, expressions=tau), values("lugre"), {"theta": 0.4})
    assert np.abs(result.v[:, 0] - reference[2]).max() < 2e-5
    assert np.abs(result.v[:, 1] - reference[3]).max() < 5e-5


def test_results_are_consistent_with_the_law():
    sim, p = simulator("pob", "lugre"), values("lugre")
    result = sim.simulate(T, path(sim), p)
    np.testing.assert_allclose(
        result.F, p["sigma_0"] * result.z + p["sigma_1"] * result.zdot + p["sigma_2"] * result.v_slip, rtol=1e-12
    )
    s, theta, omega, alpha = sim.mechanism.system.values, *(result.signals[k] for k in ("theta", "omega", "alpha"))
    inertia = s["m_L"] * s["d"] * (alpha * np.cos(theta) - omega**2 * np.sin(theta))
    np.testing.assert_allclose((s["m_b"] + s["m_L"]) * result.signals["a"] + inertia, -result.F, atol=1e-6)


@pytest.mark.parametrize("system, law", EVERY)
def test_every_mechanism_simulates(system, law):
    sim = simulator(system, law)
    for z0 in (0.0, "steady"):
        result = sim.simulate(T, path(sim), all_values(sim), z0=z0)
        for array in (result.q, result.v, result.a, result.z, result.zdot, result.v_slip, result.N, result.F):
            assert np.isfinite(array).all()
        assert set(sim.mechanism.system.signal_units) - {"t"} <= set(result.signals)


@pytest.mark.parametrize("stiffness", [1e2, 1e6, 1e7])
@pytest.mark.parametrize("system", ["pob", "drive", "sdob", "damper"])
def test_softer_and_stiffer_bristles(system, stiffness):
    sim = simulator(system, "lugre")
    p = values("lugre", sigma_0=stiffness, sigma_1=np.sqrt(stiffness))
    result = sim.simulate(T, path(sim), p, z0="steady")
    assert np.isfinite(result.F).all()
    assert np.abs(result.F).max() < 1.5 * result.N.max()


def test_stiffer_bristles_agree_with_radau():
    sim, p = simulator("pob", "lugre"), values("lugre", sigma_0=1e6, sigma_1=1e3)
    reference = radau(sim.mechanism, p, PATHS["pob"], T, [0, 0, 0])
    assert np.abs(sim.simulate(T, path(sim), p).v[:, 0] - reference[1]).max() < 2e-5


@settings(max_examples=40, deadline=None)
@given(
    st.floats(2, 7), st.floats(0, 4), st.floats(0, 1.0), st.floats(0.05, 1.0), st.floats(1, 2), st.floats(-4, 0)
)  # fmt: skip
def test_any_lugre_parameters_give_a_finite_answer_or_a_reason(log_s0, log_s1, s2, mu_c, ratio, log_vs):
    sim = simulator("pob", "lugre")
    p = values(
        "lugre", sigma_0=10**log_s0, sigma_1=10**log_s1, sigma_2=s2, mu_c=mu_c, mu_s=ratio * mu_c, v_s=10**log_vs
    )
    try:
        assert np.isfinite(sim.simulate(T, path(sim), p).F).all()
    except SimulationFailed as error:
        pytest.fail(f"{error} for {p}")


# conserved quantities --------------------------------------------------------------------------------------------
def test_frictionless_pendulum_on_a_box_keeps_energy_and_momentum():
    sim = simulator("pob", "coulomb", ())
    t = np.arange(801) / 400
    result = sim.simulate(
        t, path(sim, t, {"tau": sp.Integer(0)}), {"mu_c": 0}, {"theta": 2.2, "v": 0.1}, rtol=1e-9, atol=1e-9
    )
    s = sim.mechanism.system.values
    (theta, v, omega) = (result.signals[name] for name in ("theta", "v", "omega"))
    moment = s["m_L"] * s["d"]
    potential = moment * s["g"] * np.cos(theta)
    kinetic = (
        (s["m_b"] + s["m_L"]) * v**2 + (s["J_L"] + moment * s["d"]) * omega**2
    ) / 2 + moment * v * omega * np.cos(theta)
    momentum = (s["m_b"] + s["m_L"]) * v + moment * omega * np.cos(theta)
    assert np.ptp(kinetic + potential) < 1e-6 * np.ptp(potential)
    assert np.ptp(momentum) < 1e-6 * np.abs(momentum).max()


def test_a_body_that_can_stick_stays_where_it_is_from_a_steady_start():
    sim = simulator("drive", "lugre")
    constant = path(sim, expressions={"force": sp.Rational(1, 2)})
    stuck = sim.simulate(T, constant, values("lugre"), z0="steady")
    assert np.abs(stuck.v).max() < 1e-12
    np.testing.assert_allclose(stuck.F, 0.5)
    assert np.abs(sim.simulate(T, constant, values("lugre")).v).max() > 1e-4


def test_a_sliding_body_starts_at_the_steady_friction_force():
    sim = simulator("drive", "lugre")
    result = sim.simulate(T, path(sim), values("lugre"), {"v": -0.5}, z0="steady")
    assert result.F[0] == pytest.approx(-0.3 - 0.4 * 0.5, rel=1e-6)


def test_replayed_steps_give_the_same_trajectory():
    sim = simulator("pob", "lugre")
    first = sim.simulate(T, path(sim), values("lugre"))
    again = sim.simulate(T, path(sim), values("lugre"), steps=first.steps)
    assert len(again.steps) == len(first.steps)
    np.testing.assert_allclose(again.v, first.v, atol=1e-6)
    once_more = sim.simulate(T, path(sim), values("lugre"), steps=again.steps)
    np.testing.assert_allclose(once_more.v, again.v, atol=1e-14)


# times, inputs and mistakes --------------------------------------------------------------------------------------
def test_times_need_not_be_uniform():
    sim = simulator("pob", "lugre")
    t = np.sort(np.concatenate([T, np.random.default_rng(0).uniform(0, T[-1], 40)]))
    uneven = sim.simulate(t, path(sim, t), values("lugre"))
    even = sim.simulate(T, path(sim), values("lugre"))
    np.testing.assert_allclose(uneven.v[np.isin(t, T)], even.v, atol=2e-5)


def test_sampled_inputs_equal_the_exact_path():
    sim = simulator("pob", "lugre")
    exact = sim.simulate(T, path(sim), values("lugre"))
    sampled = sim.simulate(T, {name: exact.signals[name] for name in ("theta", "omega", "alpha")}, values("lugre"))
    np.testing.assert_allclose(sampled.v, exact.v, atol=1e-9)


def test_path_of_an_expression_is_exact_between_samples():
    sim = simulator("pob", "lugre")
    inputs = path(sim)
    exact = sp.lambdify(TIME, [sp.diff(SWING, TIME, order) for order in range(3)])
    times = np.random.default_rng(1).uniform(0, T[-1], 50)
    errors = np.abs([inputs(time)[:3] - exact(time) for time in times]).max(axis=0)
    assert (errors < [1e-12, 1e-10, 1e-7]).all()


@pytest.mark.parametrize("law", ["lugre", "coulomb"])
def test_loss_of_contact_names_the_time(law):
    sim = simulator("pob", law)
    swing = {"theta": sp.rad(50) * sp.cos(3 * sp.pi * TIME)}
    with pytest.raises(ContactLost, match="contact lost at t = 0") as caught:
        sim.simulate(T, path(sim, expressions=swing), values(law))
    exact = path(sim, expressions=swing)
    s = sim.mechanism.system.values
    grid = np.linspace(0, T[-1], 4001)
    theta, omega, alpha, _ = np.array([exact(time) for time in grid]).T
    force = (s["m_b"] + s["m_L"]) * s["g"] - s["m_L"] * s["d"] * (alpha * np.sin(theta) + omega**2 * np.cos(theta))
    assert caught.value.time == pytest.approx(grid[np.argmax(force <= 0)], abs=2e-4)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "arguments, word",
    [
        ({"p": {"mu_k": 1.0}}, "mu_c"),
        ({"p": values("lugre", mu_c=np.nan)}, "finite"),
        ({"p": [1.0, 2.0]}, "number of values"),
        ({"p": {}}, "sigma_0"),
        ({"inputs": {}}, "theta"),
        ({"y0": {"vv": 0.0}}, "vv"),
        ({"sensitivities": ["mu_z"]}, "mu_z"),
        ({"z0": "resting"}, "steady"),
        ({"t": T[::-1]}, "increase"),
        ({"t": T[:1]}, "too few"),
        ({"t": T[:-1]}, "size"),
        ({"steps": Steps(np.array([0, 1]), np.full((2, 2), 1e-3), np.zeros((2, 4, 2)))}, "other times"),
    ],
)
def test_mistakes_are_named_in_one_line(arguments, word):
    sim = simulator("pob", "lugre")
    samples = dict.fromkeys(("theta", "omega", "alpha"), np.zeros(len(T)))
    with pytest.raises(UserError, match=word) as caught:
        sim.simulate(**({"t": T, "inputs": samples, "p": values("lugre")} | arguments))
    assert "\n" not in str(caught.value)
