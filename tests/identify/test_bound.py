"""The Cramer-Rao bound, and the experiment that it recommends."""

from dataclasses import replace

import numpy as np
import pytest
from cases import case

from frictionpinn.data.noise import GaussianNoise
from frictionpinn.data.recording import Recording
from frictionpinn.data.simulated import simulate_recording, simulate_trials
from frictionpinn.errors import UserError
from frictionpinn.identify import bound, maximum_likelihood, rank_experiments
from frictionpinn.physics import SYSTEMS
from frictionpinn.physics.contacts import law_named
from frictionpinn.physics.mechanism import Mechanism

ALL = (0, 1, 2, 3, 4, 5)


def test_bound_of_the_protocol_is_the_published_one():
    mechanism, truth, clean, _, levels = case("pob", "lugre", ALL, 400.0)
    joint = bound(mechanism, clean, truth, sigmas=levels)
    expected = {"sigma_0": 2.7, "sigma_1": 1.7, "sigma_2": 2.2, "mu_c": 0.04, "mu_s": 12.0, "v_s": 14.0}
    for name, percent in expected.items():
        assert 100 * joint.relative[name] == pytest.approx(percent, rel=0.25)
    i, j = joint.names.index("mu_s"), joint.names.index("v_s")
    assert joint.correlation[i, j] == pytest.approx(-0.98, abs=0.01)
    assert any(text.startswith("mu_s and v_s move together") for text in joint.advice)
    known = bound(mechanism, clean, truth, sigmas=levels, inputs="known")
    assert all(known.relative[name] < joint.relative[name] for name in truth)


def test_bound_falls_with_the_square_root_of_the_data_and_grows_with_the_noise():
    mechanism, truth, clean, _, levels = case("drive", "dahl", (0, 1))
    once = bound(mechanism, clean, truth, sigmas=levels)
    copies = [t.__class__(t.name + c, t.t, t.signals) for t in clean.trials for c in "abcd"]
    four = bound(mechanism, Recording(tuple(copies), clean.units), truth, sigmas=levels)
    noisier = bound(mechanism, clean, truth, sigmas={name: 2 * value for name, value in levels.items()})
    for name in truth:
        assert four.relative[name] == pytest.approx(once.relative[name] / 2, rel=0.02)
        assert 1.2 < noisier.relative[name] / once.relative[name] < 2.1  # fewer knots suit noisier inputs


def test_parameters_without_effect_are_named():
    mechanism, truth, _, _, levels = case("pob", "lugre", (0,))
    sticking = [{"duration": 2.0, "theta": "20*deg*sin(2*pi*t)"}]
    clean = simulate_recording(mechanism.system, "lugre", truth, sticking, 200.0)
    found = bound(mechanism, clean, truth, sigmas=levels)
    assert np.isnan(found.relative["v_s"])
    assert any(text.startswith("v_s does not show") for text in found.advice)


def test_proposed_experiment_shrinks_the_interval_as_predicted():
    mechanism, truth, clean, noisy, levels = case("drive", "lugre", (0, 1), 400.0)
    candidates = [{"duration": 2.0, "force": f"{a}*sin(2*pi*{f}*t)"} for a, f in ((2, 1), (4, 0.5), (5, 2), (8, 1))]
    ranked = rank_experiments(mechanism, truth, candidates, rate_hz=400.0, sigmas=levels, present=clean, target="v_s")
    errors = [item.relative["v_s"] for item in ranked]
    assert errors == sorted(errors)
    best = simulate_recording(mechanism.system, "lugre", truth, [ranked[0].candidate | {"name": "new"}], 400.0)
    both = Recording((*clean.trials, *best.trials), clean.units)
    before = bound(mechanism, clean, truth, sigmas=levels).relative["v_s"]
    assert bound(mechanism, both, truth, sigmas=levels).relative["v_s"] == pytest.approx(errors[0], rel=0.05)
    trials = tuple(
        t.__class__(
            t.name,
            t.t,
            {k: v + levels[k] * np.random.default_rng(7).standard_normal(len(v)) for k, v in t.signals.items()},
        )
        for t in best.trials
    )
    after = maximum_likelihood(mechanism, Recording((*noisy.trials, *trials), clean.units), start=truth)
    assert errors[0] < before
    assert after.std["v_s"] / after.values["v_s"] == pytest.approx(errors[0], rel=0.6)


@pytest.mark.parametrize("amplitude", [4, 30])
def test_present_data_and_an_experiment_tell_together_what_their_recordings_do(amplitude):
    """Whatever the units in which either is searched: viscous friction is, relative to the size of its recording."""
    mechanism, truth, clean, _, levels = case("drive", "coulomb_viscous", (0, 1))
    candidate = {"duration": 2.0, "force": f"{amplitude}*sin(2*pi*t)"}
    (ranked,) = rank_experiments(mechanism, truth, [candidate], rate_hz=200.0, sigmas=levels, present=clean)
    new = simulate_recording(mechanism.system, "coulomb_viscous", truth, [candidate | {"name": "new"}], 200.0)
    together = bound(mechanism, Recording((*clean.trials, *new.trials), clean.units), truth, sigmas=levels)
    assert ranked.relative == pytest.approx(together.relative, rel=0.05)


def test_an_impossible_experiment_comes_last_with_its_reason():
    mechanism, truth, _, _, levels = case("pob", "lugre", (1, 4))
    candidates = [{"duration": 1.0, "theta": f"50*deg*sin(2*pi*{f}*t)"} for f in (1.5, 1.0)]
    ranked = rank_experiments(mechanism, truth, candidates, rate_hz=200.0, sigmas=levels)
    assert "contact lost" in ranked[1].failure
    assert ranked[0].failure == ""


def test_two_contacts_that_a_stiff_coupling_holds_together_move_together_and_an_experiment_tells_them_apart():
    law = law_named({"motor": "coulomb_viscous", "load": "coulomb_viscous"}, "friction")
    mechanism = Mechanism(SYSTEMS["two_mass"](k=2e3), law)
    truth = {"motor.mu_c": 0.1, "motor.sigma_2": 0.01, "load.mu_c": 0.3, "load.sigma_2": 0.02}
    levels = {"theta_m": 5e-3, "theta_l": 5e-3, "tau": 1e-3}
    slow = {"duration": 1.5, "tau": "0.8*sin(4*t)"}
    clean = simulate_trials(mechanism, mechanism.system.values | truth, [slow], 200.0)
    positions = [replace(t, signals={n: t.signals[n] for n in levels}) for t in clean.trials]
    present = Recording(tuple(positions), clean.units)
    found = bound(mechanism, present, truth, sigmas=levels)
    assert found.names == tuple(truth) and set(found.figures()) == {"parameters"}
    assert any(text.startswith("motor.mu_c and load.mu_c move together") for text in found.advice)
    shaken = {"duration": 1.5, "tau": "4*sin(60*t)"}
    ranked = rank_experiments(mechanism, truth, [slow, shaken], rate_hz=400.0, sigmas=levels, target="load.mu_c")
    assert len(ranked) == 2 and ranked[0].relative["load.mu_c"] < ranked[1].relative["load.mu_c"]


def test_an_unknown_target_is_refused():
    mechanism, truth, _, _, levels = case("drive", "dahl", (0, 1))
    with pytest.raises(UserError, match="sigma_0"):
        rank_experiments(
            mechanism, truth, [{"duration": 1.0, "force": "5*sin(6*t)"}], rate_hz=200.0, sigmas=levels, target="mu"
        )


def test_noise_that_is_given_twice_as_large_doubles_the_error():
    mechanism, _, clean, _, levels = case("drive", "dahl", (0, 1))
    noisy = GaussianNoise(0.05)(clean, 3)
    twice = {name: 2 * value for name, value in levels.items()}
    single, double = (
        maximum_likelihood(mechanism, noisy, sigmas=known, thorough=False, profiles=False) for known in (levels, twice)
    )
    assert double.std["mu_c"] == pytest.approx(2 * single.std["mu_c"], rel=0.2)


@pytest.mark.parametrize("level", [0.0, -0.1, float("nan"), float("inf")])
@pytest.mark.parametrize("signal", ["x", "force"])
def test_a_noise_level_that_no_sensor_has_is_refused(signal, level):
    mechanism, truth, _, noisy, _ = case("drive", "dahl", (0,))
    said = rf"impossible noise level: sigmas.{signal} is {level}; allowed: a standard deviation above 0"
    with pytest.raises(UserError, match=said):
        bound(mechanism, noisy, truth, sigmas={signal: level})
    with pytest.raises(UserError, match=said):
        maximum_likelihood(mechanism, noisy, sigmas={signal: level})


@pytest.mark.parametrize(
    ("further", "said"),
    [
        ({"mu": 1.0}, "unknown parameter: values.mu; allowed: M, preload, sigma_0"),
        ({"mu_c": "3"}, "impossible value: values.mu_c is '3'; allowed: a number from 0"),
    ],
    ids=["unknown", "text"],
)
def test_a_value_that_the_bound_would_not_take_is_refused(further, said):
    mechanism, truth, _, noisy, _ = case("drive", "dahl", (0,))
    with pytest.raises(UserError, match=said):
        bound(mechanism, noisy, truth | further)


def test_a_value_of_what_is_not_free_is_held_for_the_bound():
    mechanism, truth, _, noisy, _ = case("drive", "dahl", (0,))
    heavy = bound(mechanism, noisy, truth | {"M": 1.5})
    assert heavy.std == bound(mechanism, noisy, truth, fixed={"M": 1.5}).std
    assert heavy.std["mu_c"] != pytest.approx(bound(mechanism, noisy, truth).std["mu_c"], rel=1e-3)
