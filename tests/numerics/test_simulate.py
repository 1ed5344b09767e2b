"""The simulator against independent references: scipy's Radau, conserved quantities, central differences."""

import os
import pickle
import subprocess
import sys
import time
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from frictionpinn.errors import UserError
from frictionpinn.numerics.paths import InputPath
from frictionpinn.numerics.simulate import ContactLost, SimulationFailed, Simulator, Steps
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.mechanism import Mechanism
from frictionpinn.physics.system import TIME

LAW_VALUES = {
    "sigma_0": 1e5,
    "sigma_1": 316.23,
    "sigma_2": 0.4,
    "mu_c": 0.3,
    "mu_s": 0.6,
    "v_s": 1e-3,
    "alpha": 2.0,
    "v_t": 1e-4,
    "tied_inertia": 1.0,
}
SWING = sp.rad(50) * sp.sin(2 * sp.pi * TIME)
T = np.arange(161) / 400
PATHS = {
    "pob": {"theta": SWING},
    "sdob": {"y": 0.21 + 0.02 * sp.sin(9 * TIME), "force": 9 * sp.sin(7 * TIME)},
    "drive": {"force": sp.sin(7 * TIME)},
    "pendulum": {"tau": 6 * sp.sin(7 * TIME)},
    "damper": {"x": 0.01 * sp.sin(9 * TIME)},
}
ALL = [(system, law) for system in SYSTEMS for law in LAWS]


@cache
def simulator(system, law, driven=None):
    return Simulator(Mechanism(SYSTEMS[system](driven=driven), LAWS[law]()))


def values(law, **changed):
    return {par.name: LAW_VALUES[par.name] for par in LAWS[law].parameters} | changed


def path(sim, t=T, expressions=None):
    return InputPath.from_expressions(sim.mechanism, t, expressions or PATHS[sim.mechanism.system.name])


def radau(mechanism, p, expressions, t, y0):
    """Reference state, shape (n_s, n): the implicit equations solved for w in every call of Radau."""
    z, zdot = sp.symbols("z zdot", real=True)
    free, memory = mechanism.free, mechanism.law.memory
    unknown = [c.symbols[2] for c in free] + ([zdot] if memory else [])
    state = [c.symbols[0] for c in free] + [c.symbols[1] for c in free] + ([z] if memory else [])
    given = {}
    for coordinate in mechanism.driven:
        for order, symbol in enumerate(coordinate.symbols):
            given[symbol] = sp.diff(expressions[coordinate.signals[0]], TIME, order)
    given |= {item.symbol: expressions.get(item.name, 0) for item in mechanism.system.inputs}
    given |= {par.symbol: p.get(par.name, mechanism.system.values.get(par.name)) for par in mechanism.parameters}
    given = {symbol: sp.sympify(value) for symbol, value in given.items()}
    rows = sp.Matrix(mechanism.residuals).subs(given)
    function = sp.lambdify([TIME, state, unknown], [list(rows), rows.jacobian(unknown).tolist()], "math", cse=True)

    def rate(t, y):
        w = np.zeros(len(unknown))
        for _ in range(4):
            residual, jacobian = function(t, y, w)
            w = w - np.linalg.solve(np.array(jacobian, float), np.array(residual, float))
        return w

    m = len(free)
    solution = solve_ivp(
        lambda t, y: [*y[m : 2 * m], *rate(t, y)], (t[0], t[-1]), y0, "Radau", t, rtol=1e-9, atol=1e-11, max_step=2e-3
    )
    return solution.y


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


@pytest.mark.parametrize("system, law", ALL)
def test_every_mechanism_simulates(system, law):
    sim = simulator(system, law)
    for z0 in (0.0, "steady"):
        result = sim.simulate(T, path(sim), values(law), z0=z0)
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


# sensitivities ---------------------------------------------------------------------------------------------------
STEPS = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)


def differences(sim, inputs, p, y0, name, steps, relative, **options):
    """Central differences of every output over the same steps, for one relative change of a parameter or state.

    Each comes with the error that roundoff in the output makes.
    """
    p, y0 = dict(zip(sim.parameter_names, sim.parameters(p), strict=True)), dict(y0)
    table, key = (y0, name[:-3]) if name.endswith("(0)") else (p, name)
    base = table.get(key, 0.0)
    h = relative * (abs(base) or 1e-2)
    runs = []
    for value in (base + h, base - h):
        table[key] = value
        try:
            runs.append(sim.simulate(inputs.t, inputs, p, y0, steps=steps, **options))
        except SimulationFailed:  # the recorded steps are too long for so large a change
            return {}
    outputs = ("N", "F", "z", "zdot", "v_slip", *(n for c in sim.mechanism.free for n in c.signals))
    above, below = ({name: quantity(run, name) for name in outputs} for run in runs)
    return {name: ((above[name] - below[name]) / (2 * h), 1e-15 * np.abs(above[name]).max() / h) for name in outputs}


def quantity(result, name):
    return result.signals[name] if name in result.signals else getattr(result, name)


@pytest.mark.parametrize("law", ["lugre", "dahl", "coulomb_viscous", "stribeck"])
@pytest.mark.parametrize("system", list(SYSTEMS))
def test_sensitivities_agree_with_central_differences(system, law):
    sim, p = simulator(system, law), values(law)
    inputs = path(sim)
    names = [*sim.parameter_names, *(f"{name}(0)" for name in sim.state_names)]
    y0 = dict.fromkeys(sim.state_names, 0.0) | {c.signals[1]: 0.1 for c in sim.mechanism.free}
    result = sim.simulate(T, inputs, p, y0, sensitivities=names)
    assert result.sensitivity_names == tuple(names)
    for j, name in enumerate(names):
        tables = [differences(sim, inputs, p, y0, name, result.steps, relative) for relative in STEPS]
        for output, derivatives in result.sensitivities.items():
            check(derivatives[:, j], [table[output] for table in tables if table], f"d {output} / d {name}")


def check(found, candidates, what):
    """Agreement to 1e-5 with the best of several central differences and their Richardson extrapolations.

    Truncation asks for a small change and roundoff for a large one: a regularised sign over 1e-4 m/s leaves little
    room between them.
    """
    pairs = pairwise(candidates)
    candidates = candidates + [((100 * b - a) / 99, noise_b) for (a, _), (b, noise_b) in pairs]
    scale = np.abs(found).max()
    assert any(np.abs(found - candidate).max() <= 1e-5 * scale + noise for candidate, noise in candidates), what


def test_sensitivities_follow_a_steady_start():
    sim, p = simulator("drive", "lugre"), values("lugre")
    inputs = path(sim, expressions={"force": sp.Rational(1, 2) + 3 * TIME})
    names = ["sigma_0", "mu_c", "preload"]
    result = sim.simulate(T, inputs, p, z0="steady", sensitivities=names)
    for j, name in enumerate(names):
        tables = [differences(sim, inputs, p, {}, name, result.steps, relative, z0="steady") for relative in STEPS]
        for output in ("v", "z", "F"):
            check(result.sensitivities[output][:, j], [table[output] for table in tables if table], name)


def test_sensitivity_to_the_input_path():
    sim, p = simulator("pob", "lugre"), values("lugre")
    bump = {"theta": sp.sin(5 * TIME) ** 2}
    inputs, direction = path(sim), path(sim, expressions=bump)
    result = sim.simulate(T, inputs, p, sensitivities=["mu_c"], directions={"bump": direction})
    h = 1e-6
    runs = [
        sim.simulate(
            T, InputPath(inputs.names, T, inputs.coefficients + s * direction.coefficients), p, steps=result.steps
        )
        for s in (h, -h)
    ]
    assert result.sensitivity_names == ("mu_c", "bump")
    for output in ("v", "a", "N", "F", "z"):
        expected = (quantity(runs[0], output) - quantity(runs[1], output)) / (2 * h)
        assert np.abs(result.sensitivities[output][:, 1] - expected).max() < 1e-5 * np.abs(expected).max()


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


# compiled code on disk -------------------------------------------------------------------------------------------
_SCRIPT = """
import time
from frictionpinn.numerics.simulate import Simulator
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.mechanism import Mechanism
import numpy as np
import frictionpinn.numerics.integrator
sim = Simulator(Mechanism(SYSTEMS["drive"](), LAWS["dahl"]()))
start = time.perf_counter()
sim.simulate(np.arange(10) / 400, {}, {"sigma_0": 1e4, "mu_c": 0.3}, sensitivities=["mu_c"])
print(time.perf_counter() - start)
"""


def run_script(**environment):
    return subprocess.run(
        [sys.executable, "-c", _SCRIPT], capture_output=True, text=True, env=os.environ | environment, check=True
    )


def test_a_second_process_starts_warm():
    run_script()
    assert float(run_script().stdout) < 1.0


def test_a_simulator_can_be_sent_to_another_process():
    sim = simulator("drive", "lugre")
    expected = sim.simulate(T, path(sim), values("lugre"))
    copy = pickle.loads(pickle.dumps(sim))
    np.testing.assert_array_equal(copy.simulate(T, path(sim), values("lugre")).v, expected.v)


def test_an_unwritable_cache_falls_back_to_a_temporary_folder(tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("")
    process = run_script(FRICTIONPINN_CACHE=str(blocked))
    assert float(process.stdout) > 0
    assert "cannot be written" in process.stderr


def test_processes_may_compile_the_same_mechanism_at_once(tmp_path):
    environment = os.environ | {"FRICTIONPINN_CACHE": str(tmp_path)}
    processes = [
        subprocess.Popen(
            [sys.executable, "-c", _SCRIPT], env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE
        )
        for _ in range(3)
    ]
    outcomes = [process.communicate(timeout=60) for process in processes]
    assert all(process.returncode == 0 for process in processes), outcomes
    assert not list(tmp_path.rglob("*.tmp"))


def test_a_simulation_takes_microseconds_per_sample():
    sim, t = simulator("pob", "lugre"), np.arange(801) / 400
    inputs = path(sim, t)
    spent = []
    for _ in range(5):
        start = time.perf_counter()
        sim.simulate(t, inputs, values("lugre"))
        spent.append(time.perf_counter() - start)
    assert min(spent) / len(t) < 50e-6
