"""Stops that a search moves past samples."""

from __future__ import annotations

import numpy as np
import pytest

from frictionpinn.data.noise import GaussianNoise
from frictionpinn.data.recording import Recording, Trial
from frictionpinn.data.simulated import simulate_trials
from frictionpinn.identify import Problem, maximum_likelihood
from frictionpinn.numerics.descent import levenberg_marquardt
from frictionpinn.numerics.jumps import Jump
from frictionpinn.numerics.quadratic import SAME_MINIMUM, Piece, State
from frictionpinn.numerics.simulate import Simulator
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.mechanism import Mechanism


@pytest.mark.parametrize("seed", range(40))
def test_stops_end_where_samples_and_all_the_rest_of_each_trial_want_them(seed):
    # A trial's own unknown is when it stops, in samples: told to +- ``sure`` by all else, and by the samples it passes.
    rng, n, true = np.random.default_rng(seed), 120, 60.5
    height, sure, trials = rng.uniform(2, 5), rng.uniform(2, 12), int(rng.integers(1, 4))
    told = rng.normal(true, sure, trials).clip(20, 100)
    y = np.where(np.arange(n) < true, height, 0.0) + rng.standard_normal((trials, n))

    def cost(k: int, time: float) -> float:
        return 0.5 * float(
            np.sum((np.where(np.arange(n) < time, height, 0.0) - y[k]) ** 2) + ((time - told[k]) / sure) ** 2
        )

    def evaluate(u, locals_, derivatives, **_):
        pieces, one, none = [], np.eye(1), np.zeros((1, 1))
        for k, (time,) in enumerate(locals_):
            model, curve = np.where(np.arange(n) < time, height, 0.0), one / sure**2
            at = int(np.ceil(time)) - 1
            jump = Jump(model, model - y[k], at, time - at, np.ones(1))
            slopes = 1e3 * u, np.array([time - told[k]]) / sure**2
            pieces.append(Piece(cost(k, time) + 500 * float(u[0]) ** 2, {}, 1e3 * one, none, curve, *slopes,
                                rows=(1.0, 1.0, 0.0), jumps=(jump,), smooth=(curve, slopes[1])))  # fmt: skip
        return State(np.asarray(u, float), tuple(locals_), tuple(pieces))

    first = evaluate(np.ones(1), [np.array([x]) for x in told], True)
    found = levenberg_marquardt(evaluate, first, (np.array([-9.0]), np.array([9.0]))).state
    for k, piece in enumerate(found.pieces):
        lowest = min(cost(k, time) for time in np.arange(15.0, 105.0, 0.25))
        assert piece.cost < lowest + SAME_MINIMUM + 0.3  # how far between two samples is left to the descent
    assert found.u[0] == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize(
    ("system", "law", "truth", "trial"),
    [
        ("drive", "coulomb_viscous", {"mu_c": 3.0, "sigma_2": 2.0}, {"force": "6*sin(5*t)"}),
        ("pendulum", "coulomb", {"mu_c": 0.4}, {"tau": "1.5*sin(4.3*t)", "initial": {"theta": 2.0}}),
    ],
)
def test_the_derivative_of_a_stops_time_moves_it_by_as_many_samples(system, law, truth, trial):
    mechanism = Mechanism(SYSTEMS[system](), LAWS[law]())
    recording = simulate_trials(mechanism, truth, [{"duration": 2.0, **trial}], 2000.0)
    levels = dict.fromkeys(recording.trials[0].signals, 0.1)
    problem = Problem(
        mechanism, recording, free=("mu_c",), fixed={k: truth[k] for k in truth if k != "mu_c"}, sigmas=levels
    )
    u = problem.space.to_search({"mu_c": truth["mu_c"]})
    models = problem.models_at(u)
    evaluate = problem.evaluator(models)
    at = evaluate(u, (models[0].local,), True)
    assert at.pieces[0].jumps
    for jump in at.pieces[0].jumps:
        for shift in (-6, 6):
            H = np.linalg.inv(at.pieces[0].smooth[0])
            step = H @ jump.slopes * shift / (jump.slopes @ H @ jump.slopes)
            moved = evaluate(u, (models[0].local + step,), True)
            nearest = min((other.at for other in moved.pieces[0].jumps), key=lambda k: abs(k - jump.at - shift))
            assert abs(nearest - jump.at - shift) <= 1


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize(("law", "truth"), [
    ("coulomb_viscous", {"mu_c": 3.0, "sigma_2": 2.0}),
    ("stribeck", {"mu_c": 3.0, "mu_s": 4.5, "v_s": 0.02, "sigma_2": 2.0}),
])  # fmt: skip
def test_no_sample_of_an_imposed_motions_force_is_left_on_the_wrong_side_of_a_reversal(law, truth, seed):
    # The velocity's noise hides on which side of zero a sample is, and the force jumps there by 30 standard deviations.
    mechanism = Mechanism(SYSTEMS["damper"](), LAWS[law]())
    trials = [{"duration": 3.7, "x": f"0.05*sin({w}*t) + 0.01*sin({2.7 * w}*t + {w})"} for w in (2.1, 3.3)]
    noisy = GaussianNoise(0.05)(simulate_trials(mechanism, truth, trials, 100.0), seed)
    found = maximum_likelihood(mechanism, noisy)
    left = np.concatenate([found.minimum.state.left("force")]) / found.sigmas["force"]
    assert np.abs(left).max() < 6


def test_the_log_of_a_servo_that_pauses_is_identified_within_a_budget():
    # At rest the force is what the last motion left in the bristles, which the declared law does not know.
    system, rate = SYSTEMS["drive"](imposed=True, M=5.0), 250.0
    truth, trials = {"mu_c": 8.0, "mu_s": 8.0, "sigma_0": 4e5, "sigma_1": 100.0, "sigma_2": 12.0, "v_s": 1e-2}, []
    t = np.arange(1000) / rate
    for sign in (1.0, -1.0):
        v, a = np.zeros((2, len(t)))
        for begin, length, speed in ((0.3, 0.8, 0.3), (1.4, 0.6, -0.2), (2.4, 0.9, -0.25)):
            share = (t - begin) / length
            moves = (share >= 0) & (share < 1)
            v[moves] = sign * speed * np.sin(np.pi * share[moves]) ** 2
            a[moves] = sign * speed * np.pi / length * np.sin(2 * np.pi * share[moves])
        motion = {"x": np.cumsum(v) / rate, "v": v, "a": a}
        run = Simulator(Mechanism(system, LAWS["lugre"]())).simulate(t, motion, truth)
        trials.append(Trial(str(len(trials)), t, {name: run.signals[name] for name in (*motion, "force")}))
    noisy = GaussianNoise(0.01)(Recording(tuple(trials), {}), 0)
    found = maximum_likelihood(Mechanism(system, LAWS["coulomb_viscous"]()), noisy)
    assert found.n_simulations < 1400  # 1676 from a coarse resolution on
    for name in ("mu_c", "sigma_2"):
        assert found.values[name] == pytest.approx(truth[name], rel=0.03)
