"""Effects are estimated with the friction: their strengths may be zero, their shapes are searched over the data."""

import numpy as np
import pytest
import sympy as sp

from frictionpinn.data.noise import GaussianNoise
from frictionpinn.data.recording import Recording, Trial
from frictionpinn.identify import Problem, bound, maximum_likelihood, rank_experiments
from frictionpinn.numerics.paths import InputPath
from frictionpinn.numerics.simulate import Simulator
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.effects import applicable
from frictionpinn.physics.mechanism import Mechanism
from frictionpinn.physics.system import TIME as t

CASES = {
    "pob": (
        ("lugre", ("constant_force",)),
        {"sigma_0": 1e5, "sigma_1": 316.0, "sigma_2": 0.4, "mu_c": 0.3, "mu_s": 0.6, "v_s": 1e-3},
        {"constant_force": 0.4},
        [{"theta": sp.rad(65) * sp.sin(2 * sp.pi * t)}, {"theta": sp.rad(57) * sp.sin(2 * sp.pi * t)}],
        {},
    ),
    "drive": (
        ("coulomb_viscous", ("constant_force", "presliding")),
        {"M": 95.0, "mu_c": 20.0, "sigma_2": 200.0, "v_t": 1e-4},
        {"constant_force": -3.0, "presliding": 1.0, "presliding_length": 2e-4},
        [{"force": 40 * sp.sin(4 * sp.pi * t)}, {"force": 60 * sp.sin(8 * sp.pi * t) + 10 * sp.sin(sp.pi * t)}],
        {},
    ),
    "damper": (
        ("coulomb_viscous", ("presliding", "asymmetry", "backlash")),
        {"mu_c": 1e4, "sigma_2": 0.0, "v_t": 1e-4},
        {"presliding": 1.0, "presliding_length": 2e-3, "asymmetry": 0.13, "backlash_gap": 2e-3},
        [{"x": 0.02 * sp.cos(2 * sp.pi * t)}, {"x": 0.01 * sp.cos(3 * sp.pi * t)}],
        {},
    ),
    "pendulum": (
        ("coulomb_viscous", ("drag",)),
        {"mu_c": 0.02, "sigma_2": 0.01, "v_t": 1e-3},
        {"drag": 0.01},
        [{"tau": 0 * t}, {"tau": 0 * t}],
        {"theta": np.pi + 1.5, "omega": 0.0},
    ),
}


def mechanism_of(system: str) -> Mechanism:
    law, effects = CASES[system][0]
    return Mechanism(SYSTEMS[system](), LAWS[law](), effects)


def recorded(system: str, level: float = 0.01) -> tuple[Mechanism, dict[str, float], Recording]:
    """A mechanism with effects, its parameters, and a noisy recording of it."""
    mechanism, (_, law, effects, expressions, y0) = mechanism_of(system), CASES[system]
    trials, simulator = [], Simulator(mechanism)
    for k, expression in enumerate(expressions):
        times = np.arange(801) / 200
        path = InputPath.from_expressions(mechanism, times, expression)
        run = simulator.simulate(times, path, law | effects, {k: float(v) for k, v in y0.items()}, z0="steady")
        signals = {name: run.signals[name] for name in mechanism.system.signal_units if name != "t"}
        trials.append(Trial(str(k), times, signals))
    clean = Recording(tuple(trials), {})
    return mechanism, law | effects, GaussianNoise(level)(clean, 0)


@pytest.mark.parametrize("system", CASES)
def test_strength_and_shape_of_effects_are_found_with_the_friction(system):
    mechanism, truth, noisy = recorded(system)
    fixed = {name: value for name, value in truth.items() if name == "v_t" or value == 0.0}
    estimate = maximum_likelihood(mechanism, noisy, free=[name for name in truth if name not in fixed], fixed=fixed)
    assert estimate.outcome == "converged", estimate
    for name in CASES[system][2]:
        low, high = estimate.ci95[name]
        reach = 2 * (high - low)
        assert low - reach <= truth[name] <= high + reach, estimate
        assert estimate.values[name] == pytest.approx(truth[name], rel=0.15), estimate


@pytest.mark.parametrize("system", CASES)
def test_every_strength_has_a_size_and_shows_in_the_signals(system):
    law = CASES[system][0][0]
    plain = Mechanism(SYSTEMS[system](), LAWS[law]())
    beside = () if plain.law.memory else ("presliding",)
    full = Mechanism(plain.system, plain.law, applicable(plain.system, plain.law, beside))
    _, truth, noisy = recorded(system)
    free = [par.name for par in full.parameters if par.neutral is not None]
    own = {par.name for par in (*plain.system.parameters, *plain.law.parameters)}
    problem = Problem(full, noisy, free=free, fixed={k: v for k, v in truth.items() if k in own}, inputs="fixed")
    sizes = problem.space.scales
    assert np.isfinite(sizes).all() and (sizes > 0).all()
    u = problem.space.to_search(np.array([0.0 if n != "presliding" else 0.1 for n in problem.names]))
    state = problem.evaluator(problem.trials)(u, [m.local[: m.size(False)] for m in problem.trials], True)
    information = sum(piece.gg for piece in state.pieces)
    assert np.isfinite(information).all()
    silent = {name for name, value in zip(problem.names, information.diagonal(), strict=True) if value == 0}
    # No torque acts there, and all that is late together has only begun otherwise.
    idle = {"pendulum": {"delay_tau", "gain_error_tau", "sensor_delay_theta_omega_alpha"}}
    absent = {f"trial_level_{k}" for k in range(len(noisy.trials) + 1, 11)}
    assert silent == idle.get(system, set()) | absent


def test_an_effect_that_is_not_there_ends_at_nothing_with_an_upper_limit():
    mechanism, truth, noisy = recorded("drive")
    with_drag = Mechanism(mechanism.system, mechanism.law, ("constant_force", "presliding", "drag"))
    fixed = {name: value for name, value in truth.items() if name not in ("mu_c", "sigma_2")}
    estimate = maximum_likelihood(with_drag, noisy, free=("mu_c", "sigma_2", "drag"), fixed=fixed)
    low, high = estimate.ci95["drag"]
    assert low <= 0 < high or estimate.values["drag"] == 0
    at_full_speed = max(np.abs(trial.signals["v"]).max() for trial in noisy.trials)
    assert high * at_full_speed**2 < 0.3 * truth["mu_c"]


def test_all_of_the_dry_friction_in_presliding_is_a_limit_and_not_an_error():
    mechanism, truth, noisy = recorded("damper")
    fixed = {name: value for name, value in truth.items() if name not in ("mu_c", "presliding", "presliding_length")}
    estimate = maximum_likelihood(mechanism, noisy, free=("mu_c", "presliding", "presliding_length"), fixed=fixed)
    assert estimate.outcome == "converged"
    low, high = estimate.ci95["presliding"]
    assert 0.95 < low <= estimate.values["presliding"]
    assert high >= 1.0


def test_bound_tells_what_an_effect_and_the_friction_share():
    mechanism, truth, noisy = recorded("pendulum")
    found = bound(mechanism, noisy, truth, free=("mu_c", "sigma_2", "drag"), fixed={"v_t": truth["v_t"]})
    assert 0 < found.relative["drag"] < 0.1
    i, j = found.names.index("sigma_2"), found.names.index("drag")
    assert found.correlation[i, j] < -0.9


def test_a_motion_too_rough_for_a_spline_is_taken_as_measured_and_said():
    mechanism, rng, times = recorded("damper")[0], np.random.default_rng(0), np.arange(2001) / 200
    x = 0.01 * np.cos(9 * times) + 2e-4 * np.cumsum(rng.standard_normal(len(times)))
    v = np.gradient(x, times)
    rough = Trial("rough", times, {"x": x, "v": v, "a": np.gradient(v, times), "force": 1e4 * np.tanh(v / 1e-3)})
    estimate = maximum_likelihood(Mechanism(mechanism.system, LAWS["coulomb"]()), Recording((rough,), {}))
    assert any("as measured" in sentence for sentence in estimate.advice)


def test_an_experiment_is_planned_for_the_strength_of_an_effect():
    mechanism, truth, _ = recorded("drive")
    levels = {"x": 1e-4, "v": 1e-3, "a": 0.05, "force": 0.5}
    candidates = [{"duration": 2.0, "force": "25*sin(2*pi*t)"}, {"duration": 2.0, "force": "90*sin(2*pi*t)"}]
    ranked = rank_experiments(
        mechanism, truth, candidates, rate_hz=100.0, sigmas=levels, target="sigma_2", free=("mu_c", "sigma_2"),
        fixed={k: v for k, v in truth.items() if k not in ("mu_c", "sigma_2")},
    )  # fmt: skip
    assert ranked[0].candidate == candidates[1]  # faster sliding tells viscous friction
    assert "gain" in str(ranked[0])


def test_the_strength_that_is_zero_has_a_bound_in_its_own_unit():
    mechanism, truth, noisy = recorded("pendulum")
    found = bound(mechanism, noisy, truth | {"drag": 0.0}, free=("mu_c", "drag"), fixed=truth)
    assert found.relative["drag"] == np.inf
    assert 0 < found.covariance[1, 1] ** 0.5 < 0.01
    assert "drag" in str(found)


def test_the_inertia_of_a_mechanism_declared_without_any_is_estimated():
    mechanism, times = Mechanism(SYSTEMS["damper"](), LAWS["coulomb_viscous"](), ("inertia",)), np.arange(801) / 200
    path = InputPath.from_expressions(mechanism, times, {"x": 0.02 * sp.cos(9 * t)})
    run = Simulator(mechanism).simulate(times, path, {"mu_c": 3.0, "sigma_2": 20.0, "inertia": 0.5})
    signals = {name: run.signals[name] for name in ("x", "v", "a", "force")}
    noisy = GaussianNoise(0.02)(Recording((Trial("1", times, signals),), {"x": "m"}), 0)
    low, high = maximum_likelihood(mechanism, noisy, free=("mu_c", "sigma_2", "inertia")).ci95["inertia"]
    assert low < 0.5 < high and high - low < 0.1
