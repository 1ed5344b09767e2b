"""The online estimator: accuracy and honesty of its interval, causality, whatever sensors deliver, mistakes told."""

from __future__ import annotations

import copy
import pickle
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2
from surfaces import case, changing_surface, fitted

from frictionpinn.data.recording import Recording
from frictionpinn.errors import UserError
from frictionpinn.numerics.torch_functions import contact_signals
from frictionpinn.online import OnlineEstimator, tune
from frictionpinn.online.consistency import WINDOW, Consistency, limit
from frictionpinn.physics import LAWS
from frictionpinn.physics.mechanism import Mechanism


def error(found, clean):
    """Mean square error of the force over its mean square."""
    truth = clean.truth["friction_force"]
    return float(np.mean((found["force"] - truth) ** 2) / np.mean(truth**2))


def covered(found, clean):
    """Share of samples whose true force lies in the interval."""
    truth = clean.truth["friction_force"]
    return float(np.mean((truth >= found["low"]) & (truth <= found["high"])))


@pytest.mark.parametrize("system", ["pob", "sdob", "drive", "pendulum", "damper"])
def test_the_force_of_every_system_is_found_within_its_interval(system):
    _, _, clean, noisy = case(system)
    for trial, known in zip(noisy.trials, clean.trials, strict=True):
        found = fitted(system).filter(trial)
        assert error(found, known) < 0.003
        assert covered(found, known) > 0.85


@pytest.mark.parametrize("law", ["dahl", "stribeck"])
def test_other_laws_work_too(law):
    _, _, clean, noisy = case("pob", law)
    for trial, known in zip(noisy.trials, clean.trials, strict=True):
        assert error(fitted("pob", law).filter(trial), known) < 0.01


def test_it_is_far_better_than_the_force_balance_of_the_same_samples():
    mechanism, _, clean, noisy = case("pob")
    for trial, known in zip(noisy.trials, clean.trials, strict=True):
        balance = {"force": contact_signals(mechanism.system, trial.signals)["friction_force"]}
        assert error(fitted("pob").filter(trial), known) < 0.2 * error(balance, known)


def test_sample_by_sample_gives_what_a_whole_trial_gives():
    _, _, _, noisy = case("pob")
    estimator, trial = fitted("pob"), noisy.trials[1]
    whole = estimator.filter(trial)
    estimator.reset()
    for k, t in enumerate(trial.t[:120]):
        reading = estimator.update(float(t), {name: trial.signals[name][k] for name in estimator.signals})
        assert reading.force == whole["force"][k] and reading.low == whole["low"][k]
        assert reading.low <= reading.force <= reading.high and reading.status == "ok"


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda made: pickle.loads(pickle.dumps(made))])
def test_a_copy_goes_on_as_the_estimator_does_and_leaves_it_alone(copied):
    trial, estimator = case("pob")[3].trials[1], fitted("pob")
    estimator.reset()

    def step(of, k):
        return of.update(float(trial.t[k]), {name: trial.signals[name][k] for name in of.signals})

    for k in range(40):
        step(estimator, k)
    twin = copied(estimator)
    ahead = [step(twin, k) for k in range(40, 60)]
    assert ahead == [step(estimator, k) for k in range(40, 60)]


def test_what_is_no_trial_is_told():
    with pytest.raises(UserError, match="no trial: trial is Recording; allowed: one trial of a recording"):
        fitted("pob").filter(case("pob")[3])


def test_nothing_after_a_sample_changes_its_estimate():
    _, _, _, noisy = case("pob")
    estimator, trial = fitted("pob"), noisy.trials[1]
    rng = np.random.default_rng(0)
    spoilt = {
        name: np.append(values[:200], rng.normal(size=len(values) - 200)) for name, values in trial.signals.items()
    }
    before, after = estimator.filter(trial), estimator.filter(replace(trial, signals=spoilt))
    np.testing.assert_array_equal(before["force"][:200], after["force"][:200])
    assert (before["force"][200:] != after["force"][200:]).any()


def test_noise_levels_are_estimated():
    _, _, clean, noisy = case("pob")
    found = tune(case("pob")[0], noisy).sigmas
    for name, level in found.items():
        spread = np.std(np.concatenate([trial.signals[name] for trial in clean.trials]))
        assert level == pytest.approx(0.05 * spread, rel=0.12)


def test_missing_samples_and_uneven_times_are_no_trouble():
    _, _, clean, noisy = case("pob")
    trial, known = noisy.trials[1], clean.trials[1]
    rng = np.random.default_rng(1)
    keep = np.sort(rng.choice(len(trial), int(0.7 * len(trial)), replace=False))
    signals = {name: values[keep].copy() for name, values in trial.signals.items()}
    for values in signals.values():
        values[rng.random(len(values)) < 0.2] = np.nan
    found = fitted("pob").filter(replace(trial, t=trial.t[keep], signals=signals))
    truth = known.truth["friction_force"][keep]
    assert np.mean((found["force"] - truth) ** 2) < 0.01 * np.mean(truth**2)


def test_positions_alone_are_enough():
    mechanism, truth, clean, noisy = case("pob")
    trials = tuple(replace(trial, signals={n: trial.signals[n] for n in ("x", "theta")}) for trial in noisy.trials)
    estimator = OnlineEstimator.fit(mechanism, truth, Recording(trials, dict(noisy.units)))
    assert estimator.signals == ("x", "theta")
    found, force = estimator.filter(trials[1]), clean.trials[1].truth["friction_force"]
    assert np.mean((found["force"] - force)[100:] ** 2) < 0.05 * np.mean(force**2)


def test_the_interval_of_a_first_sample_holds_the_force_as_often_as_it_says():
    estimator, rng, held = fitted("drive"), np.random.default_rng(0), 0
    resting = {"x": 0.0, "v": 0.0, "a": 0.0, "force": 1.0}  # below breakaway: friction is what is applied
    for _ in range(400):
        estimator.reset()
        sample = {name: value + estimator.tuning.sigmas[name] * rng.normal() for name, value in resting.items()}
        reading = estimator.update(0.0, sample)
        held += reading.low <= 1.0 <= reading.high
    assert held > 0.9 * 400


def test_a_long_gap_starts_anew():
    _, _, _, noisy = case("pob")
    estimator, trial = fitted("pob"), noisy.trials[0]
    estimator.reset()
    sample = {name: trial.signals[name][0] for name in estimator.signals}
    first = estimator.update(0.0, sample)
    estimator.update(0.0025, sample)
    again = estimator.update(10.0, sample)
    assert again.status == "restarted" and again._replace(t=0.0, status="ok") == first
    assert estimator.update(10.0025, sample).status == "ok"


@pytest.mark.parametrize("given", [None, 3, [1.0], "x"])
def test_a_sample_that_is_no_table_is_refused(given):
    with pytest.raises(UserError, match="no table of signals: update is"):
        fitted("pob").update(99.0, given)


def test_loss_of_contact_is_told_and_survived():
    estimator = fitted("pob")
    estimator.reset()
    told = set()
    for k in range(120):
        t = k / 400
        theta, omega, alpha = np.sin(14 * t), 14 * np.cos(14 * t), -196 * np.sin(14 * t)
        reading = estimator.update(t, {"x": 0.0, "v": 0.0, "a": 0.0, "theta": theta, "omega": omega, "alpha": alpha})
        told.add(reading.status)
        assert np.isfinite(reading.force)
    assert "contact lost" in told and "ok" in told


@pytest.mark.parametrize("glitch", [1e12, -1e30, np.inf])
def test_a_wild_reading_is_survived(glitch):
    _, truth, _, noisy = case("pob")
    estimator, trial = fitted("pob"), noisy.trials[0]
    follower = OnlineEstimator(estimator.mechanism, truth, estimator.tuning, {"mu_c": 0.01}, estimator.share)
    wild = {name: values.copy() for name, values in trial.signals.items()}
    wild["v"][len(trial.t) // 2] = glitch
    sound, found = (follower.filter(replace(trial, signals=signals)) for signals in (trial.signals, wild))
    later = slice(len(trial.t) // 2 + 40, None)  # a tenth of a second
    assert np.abs(found["mu_c"][later] / sound["mu_c"][later] - 1).max() < 0.02
    assert np.abs(found["force"][later] - sound["force"][later]).max() < 0.1 * np.abs(sound["force"]).max()


def test_a_surface_that_changes_is_followed_and_one_that_does_not_is_left_alone():
    estimator = fitted("pob")
    mechanism, truth, _, _ = case("pob")
    follower = OnlineEstimator(mechanism, truth, estimator.tuning, {"mu_c": 0.01})
    for factor in (1.0, 0.7):
        trial, change = changing_surface(factor)
        mu_c = follower.filter(trial)["mu_c"]
        assert np.abs(mu_c[100:change] / 0.3 - 1).max() < 0.02
        slid = np.cumsum(np.abs(trial.truth["v_slip"]) > 0.01) / 400
        later = slid > slid[change] + 1.0
        assert later.any() and np.abs(mu_c[later] / (0.3 * factor) - 1).max() < 0.05
        assert follower.parameters["mu_c"] == pytest.approx(mu_c[-1]) and 0 < follower.deviations["mu_c"] < 0.05


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        (lambda e: e.update(0.0, {"thetta": 1.0}), "did you mean 'theta'"),
        (lambda e: (e.update(0.1, {}), e.update(0.1, {})), "time does not increase"),
        (lambda e: (e.update(0.1, {}), e.update(0.05, {})), "allowed: above 0.1 s"),
        (lambda e: e.update(np.nan, {}), "not a finite time"),
        (lambda e: e.update("now", {}), "not a finite time"),
        (lambda e: e.update(0.0, {"theta": "high"}), "not a number: theta is 'high'"),
        (lambda e: e.update(0.0, {"theta": np.ones(3)}), "not a number: theta is array"),
        (lambda e: OnlineEstimator(e.mechanism, case("pob")[1] | {"mu_c": -1.0}, e.tuning), "mu_c is -1.0; allowed: 0"),
        (
            lambda e: OnlineEstimator(e.mechanism, case("pob")[1] | {"mu_s": 0.1}, e.tuning),
            r"static below Coulomb friction: parameters\.mu_s is 0\.1; allowed: at least mu_c = ",
        ),
        (lambda e: OnlineEstimator(e.mechanism, case("pob")[1], e.tuning, {"mu_c": "fast"}), "cannot adapt"),
        (lambda e: OnlineEstimator(e.mechanism, {}, e.tuning), "parameter without a finite value"),
        (lambda e: OnlineEstimator(e.mechanism, {"mu": 1.0}, e.tuning), "unknown parameter"),
        (lambda e: OnlineEstimator(e.mechanism, case("pob")[1], e.tuning, {"mu_k": 0.01}), "adapt.mu_k"),
        (lambda e: OnlineEstimator(e.mechanism, case("pob")[1], e.tuning, {"mu_c": -1.0}), "cannot adapt"),
        (lambda e: tune(e.mechanism, Recording((), {})), "no trial to tune"),
    ],
)
def test_mistakes_are_told_in_one_line(wrong, told):
    fitted("pob").reset()
    with pytest.raises(UserError, match=told):
        wrong(fitted("pob"))


def test_a_coordinate_of_which_nothing_is_measured_is_named():
    mechanism, _, _, noisy = case("pob")
    blind = tuple(replace(trial, signals={"x": trial.signals["x"]}) for trial in noisy.trials)
    with pytest.raises(UserError, match="nothing measured of coordinate theta"):
        tune(mechanism, Recording(blind, {}))


def test_effects_on_sensors_are_refused():
    mechanism, truth, _, _ = case("pob")
    late = Mechanism(mechanism.system, LAWS["lugre"](), ("sensor_bias",))
    with pytest.raises(UserError, match="effects on sensors"):
        OnlineEstimator(late, truth, fitted("pob").tuning)


# ---- samples that are not where the filter expects them


@pytest.mark.parametrize("system", ["pob", "sdob", "drive", "pendulum", "damper"])
def test_samples_of_the_system_that_it_was_tuned_for_are_consistent(system):
    _, _, _, noisy = case(system)
    for trial in noisy.trials:
        assert fitted(system).filter(trial)["consistent"].all()


@pytest.mark.parametrize(("system", "signal"), [("pendulum", "theta"), ("pendulum", "omega"), ("pob", "omega")])
def test_a_noise_level_far_too_small_is_told_within_a_few_samples(system, signal):
    mechanism, truth, _, noisy = case(system)
    level = tune(mechanism, noisy).sigmas[signal]
    estimator = OnlineEstimator.fit(mechanism, truth, noisy, sigmas={signal: 1e-4 * level})
    trial = noisy.trials[0]
    assert estimator.filter(trial)["consistent"].mean() < 0.05
    estimator.reset()
    told = [
        estimator.update(t, {n: trial.signals[n][k] for n in estimator.signals}).status
        for k, t in enumerate(trial.t[:200])
    ]
    assert told.count("ok") < 20 and "inconsistent" in told


def test_a_surface_that_changes_is_noticed_within_a_quarter_of_a_second_of_sliding():
    estimator = fitted("pob")
    for factor in (1.0, 0.7):
        trial, change = changing_surface(factor)
        consistent = estimator.filter(trial)["consistent"]
        assert consistent[:change].all()
        assert consistent.all() if factor == 1.0 else not consistent[change + 100 :].any()


def test_a_wild_reading_is_told_until_it_is_a_window_ago():
    _, _, _, noisy = case("pob")
    trial = noisy.trials[0]
    v = trial.signals["v"].copy()
    v[300] = 1e9
    consistent = fitted("pob").filter(trial.with_signals(v=v))["consistent"]
    assert consistent[:300].all() and not consistent[300 : 300 + round(400 * WINDOW)].any()
    assert consistent[300 + round(800 * WINDOW) :].all()


@pytest.mark.parametrize("freedom", [1, 2, 3, 10, 100, 10000])
def test_the_limit_is_that_of_one_in_a_million(freedom):
    exact = chi2.isf(1e-6, freedom)
    assert exact * 0.99 < limit(freedom) < exact * 7 / 6


@pytest.mark.parametrize("signals", [1, 3, 6])
@pytest.mark.parametrize("rate", [20, 100, 1000, 5000])
def test_what_counts_as_inconsistent_does_not_depend_on_the_sampling_rate(rate, signals):
    t = np.arange(10 * rate) / rate
    squares = np.sum(np.random.default_rng(rate).standard_normal((len(t), signals)) ** 2, axis=1)
    for factor, expected in ((1.0, True), (1.7, True), (10.0, False)):
        watch = Consistency()
        told = [watch.add(time, factor**2 * square, signals) for time, square in zip(t, squares, strict=True)]
        assert all(told) if expected else not all(told[:rate])


def test_samples_without_readings_are_no_evidence_and_ones_that_are_no_numbers_are():
    watch = Consistency()
    assert watch.add(0.0, 0.0, 0) and watch.add(0.1, 2.0, 2)
    assert not watch.add(0.15, float("nan"), 2)
    assert watch.add(1.0, 1.0, 2)
