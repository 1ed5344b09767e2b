"""The online estimator of mechanisms with several contacts: a force and an interval for each of them."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from omegaconf import OmegaConf

from frictionpinn.data.noise import GaussianNoise
from frictionpinn.data.simulated import simulate_recording
from frictionpinn.errors import UserError
from frictionpinn.numerics.torch_functions import contact_signals
from frictionpinn.online import OnlineEstimator, recursions
from frictionpinn.physics import SYSTEMS
from frictionpinn.physics.contacts import by_parameter, law_named
from frictionpinn.physics.mechanism import Mechanism


@lru_cache
def case(name: str):
    """Estimator with the true parameters, a clean trial and the same with 5 % noise, at 400 Hz."""
    declared = OmegaConf.to_container(OmegaConf.load(f"conf/system/{name}.yaml"), resolve=True)
    made = declared["simulate"]
    mechanism = Mechanism(SYSTEMS[name](**declared["parameters"]), law_named(made["friction"], "friction"))
    trials = [trial | {"duration": 1.5} for trial in (made["trials"][0], made["trials"][-1])]
    clean = simulate_recording(mechanism.system, made["friction"], made["truth"], trials, 400.0)
    noisy = GaussianNoise(0.05)(clean, 0)
    truth = by_parameter(made["truth"], mechanism.law)
    adapt = {f"{contact.name}.mu_c": 0.01 for contact in mechanism.contacts}
    return OnlineEstimator.fit(mechanism, truth, noisy, adapt), clean.trials[1], noisy.trials[1]


@pytest.mark.parametrize("name", ["pob_hinge", "cartpole", "double_pendulum", "two_mass"])
def test_the_force_of_every_contact_is_found_within_its_interval(name):
    estimator, clean, noisy = case(name)
    found = estimator.filter(noisy)
    balance = contact_signals(estimator.mechanism.system, noisy.signals)
    for contact in estimator.contacts:
        truth = clean.truth[f"{contact}.friction_force"]
        error = np.mean((found[f"{contact}.force"] - truth) ** 2)
        assert error < 0.03 * np.mean(truth**2)
        assert error < 0.1 * np.mean((balance[f"{contact}.friction_force"] - truth) ** 2)
        inside = (found[f"{contact}.low"] <= truth) & (truth <= found[f"{contact}.high"])
        assert np.mean(inside) > 0.9
    assert found["consistent"].all()


def test_sample_by_sample_gives_what_a_whole_trial_gives_at_every_contact():
    estimator, _, trial = case("pob_hinge")
    whole = estimator.filter(trial)
    estimator.reset()
    for k, t in enumerate(trial.t[:40]):
        reading = estimator.update(float(t), {name: trial.signals[name][k] for name in estimator.signals})
        assert reading.contacts == ("box", "hinge") and reading.force.shape == (2,)
        for contact in reading.contacts:
            at = reading.at(contact)
            assert at.force == whole[f"{contact}.force"][k] and at.low <= at.force <= at.high
    with pytest.raises(UserError, match="unknown contact: contact is ground"):
        reading.at("ground")


def test_the_friction_of_a_contact_at_rest_is_left_as_it_is():
    estimator, _, _ = case("pob_hinge")
    equations, m = estimator._equations, 2
    X, P = np.zeros(len(estimator._X)), 1e-6 * np.eye(len(estimator._X))
    X[m + 1] = 1.0  # the hinge turns, the box rests
    assert not recursions.slides(equations, X, P, list(estimator.adapt).index("box.mu_c"))
    assert recursions.slides(equations, X, P, list(estimator.adapt).index("hinge.mu_c"))


def test_an_input_that_only_some_trials_have_is_an_input_of_the_estimator_and_0_in_the_others():
    declared = OmegaConf.to_container(OmegaConf.load("conf/system/pob_hinge.yaml"), resolve=True)
    made, estimator = declared["simulate"], case("pob_hinge")[0]
    driven, swung = made["trials"][0] | {"duration": 1.0}, {"duration": 1.0, "initial": {"theta": 1.7}}
    clean = simulate_recording(estimator.mechanism.system, made["friction"], made["truth"], [driven, swung], 400.0)
    assert "tau" in clean.trials[0].signals and "tau" not in clean.trials[1].signals
    noisy = GaussianNoise(0.05)(clean, 0)
    truth = by_parameter(made["truth"], estimator.mechanism.law)
    fitted = OnlineEstimator.fit(estimator.mechanism, truth, noisy)
    assert "tau" in fitted.signals
    for known, trial in zip(clean.trials, noisy.trials, strict=True):
        force = known.truth["hinge.friction_force"]
        assert np.mean((fitted.filter(trial)["hinge.force"] - force) ** 2) < 0.02 * np.mean(force**2)
