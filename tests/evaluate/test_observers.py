"""Observers of an evaluation: causal, better than the force balance, with parameters from the training trials."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from omegaconf import OmegaConf

from frictionpinn.data.contact import contact_trials
from frictionpinn.data.noise import GaussianNoise
from frictionpinn.data.simulated import simulate_recording
from frictionpinn.evaluate.observers import Known, identify, observers
from frictionpinn.numerics.smoothing import NoSmoothing
from frictionpinn.physics import SYSTEMS


@lru_cache
def prepared(system: str):
    config = OmegaConf.to_container(OmegaConf.load(f"conf/system/{system}.yaml"), resolve=True)
    built, truth = SYSTEMS[system](**config["parameters"]), config["simulate"]["truth"]
    trials = [spec | {"duration": 1.0} for spec in config["simulate"]["trials"][1:4]]
    noisy = GaussianNoise(0.05)(simulate_recording(built, "lugre", truth, trials, 400.0), 0)
    raw = NoSmoothing(causal=True)
    return built, truth, noisy, contact_trials(noisy, built, raw, raw, noisy.names)


def errors(candidate, trials):
    return np.mean([np.mean((candidate.online(trial) - trial.truth["friction_force"]) ** 2) for trial in trials])


def test_identified_parameters_are_as_good_as_the_truth_and_far_better_than_the_force_balance():
    system, truth, noisy, trials = prepared("drive")
    found = identify(system, "lugre", noisy)
    assert set(found.parameters) == {"sigma_0", "sigma_1", "sigma_2", "mu_c", "mu_s", "v_s", "alpha"}
    known = {"identified": found, "observer_truth": Known("truth", "lugre", truth)}
    table = observers(system, noisy, known)
    balance = np.mean([np.mean((t.online["friction_force"] - t.truth["friction_force"]) ** 2) for t in trials])
    assert errors(table["identified"], trials) < 1.5 * errors(table["observer_truth"], trials)
    assert errors(table["identified"], trials) < 0.3 * balance
    assert table["identified"].simulate is not None and table["observer_truth"].simulate is None
    inside = []
    for trial in trials:
        (low, high), force = table["identified"].interval(trial), trial.truth["friction_force"]
        inside.append(np.mean((low <= force) & (force <= high)))
    assert np.mean(inside) > 0.75  # one draw of the noise: what the parameters are off by stays the same throughout


def test_an_observer_of_a_damper_does_not_see_the_force_that_it_is_to_tell():
    system, truth, noisy, _ = prepared("damper")
    (candidate,) = observers(system, noisy, {"observer_truth": Known("truth", "lugre", truth)}).values()
    assert "force" not in candidate.online.estimator.signals


def test_a_law_that_cannot_be_identified_is_left_out_with_a_word(monkeypatch, caplog):
    from frictionpinn.evaluate import observers as module
    from frictionpinn.identify import likelihood

    system, _, noisy, _ = prepared("drive")
    monkeypatch.setattr(likelihood, "followed", lambda *args, **options: [])
    assert module.identify(system, "lugre", noisy) is None
    assert "no observer with identified parameters" in caplog.text
