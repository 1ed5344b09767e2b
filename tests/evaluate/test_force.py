"""Force errors and the Coulomb + viscous yardstick, on trials made by hand."""

from __future__ import annotations

import numpy as np
import pytest

from frictionpinn.data.contact import ContactTrial
from frictionpinn.evaluate.force import CoulombViscousFit, force_errors, reference_force


def contact(name="1", n=400, sign=1.0, noise=0.0, truth=True, mu_c=0.3, sigma_2=0.4) -> ContactTrial:
    """A sliding contact with F = mu_c N tanh(v / 1e-3) + sigma_2 v exactly."""
    t = np.arange(n) / 100
    v, N = sign * np.sin(2 * t), 10 + 3 * np.cos(5 * t)
    force = mu_c * N * np.tanh(v / 1e-3) + sigma_2 * v
    seen = force + noise * np.random.default_rng(0).normal(size=n)
    signals = {"v_slip": v, "normal_force": N, "friction_force": seen}
    return ContactTrial(name, t, signals, signals, {}, {"friction_force": force} if truth else {})


class Offset:
    """Predicts the reference plus a constant."""

    def __init__(self, offset):
        self.offset = offset

    def predict_trial(self, trial, source="online"):
        return {"force": reference_force(trial)[0] + self.offset}


def test_errors_are_means_over_all_samples_of_all_trials():
    trials = [contact("a", 100), contact("b", 300)]
    errors = force_errors(Offset(0.5), trials)
    assert errors["mse"] == pytest.approx(0.25) and errors["rmse"] == pytest.approx(0.5)
    assert errors["by_trial"] == pytest.approx({"a": 0.5, "b": 0.5})
    forces = np.concatenate([trial.truth["friction_force"] for trial in trials])
    assert errors["reference_rms"] == pytest.approx(np.sqrt(np.mean(forces**2)))
    assert errors["relative"] == pytest.approx(0.5 / errors["reference_rms"])


def test_a_perfect_model_has_no_error():
    assert force_errors(Offset(0.0), [contact()])["mse"] == 0.0


def test_no_friction_to_compare_with_is_no_division_by_zero():
    assert force_errors(Offset(0.5), [contact(mu_c=0.0, sigma_2=0.0)])["relative"] == float("inf")


def test_the_true_force_is_the_reference_where_it_is_known():
    noisy = contact(noise=1.0)
    assert reference_force(noisy)[1] == "true friction force"
    np.testing.assert_array_equal(reference_force(noisy)[0], noisy.truth["friction_force"])
    measured = contact(noise=1.0, truth=False)
    assert "implied by the equation of motion" in reference_force(measured)[1]
    np.testing.assert_array_equal(reference_force(measured)[0], measured.offline["friction_force"])


@pytest.mark.parametrize("noise", [0.0, 0.2])
def test_the_fit_finds_coulomb_and_viscous_friction(noise):
    fit = CoulombViscousFit([contact(noise=noise, n=2000)])
    assert fit.parameters["mu_c"] == pytest.approx(0.3, rel=0.03)
    assert fit.parameters["sigma_2"] == pytest.approx(0.4, rel=0.1)
    assert force_errors(fit, [contact("other", sign=-1.0)])["relative"] < 0.05


def test_the_fit_is_odd_and_zero_at_rest():
    fit, trial, turned = CoulombViscousFit([contact()]), contact(), contact(sign=-1.0)
    np.testing.assert_allclose(fit.predict_trial(trial)["force"], -fit.predict_trial(turned)["force"], atol=1e-12)
    assert fit.predict_trial(trial)["force"][0] == 0.0


def test_the_sign_of_the_normal_force_does_not_matter():
    trial = contact()
    pulled = ContactTrial(
        "1", trial.t, {**trial.offline, "normal_force": -trial.offline["normal_force"]}, trial.online, {}, trial.truth
    )
    assert CoulombViscousFit([pulled]).parameters == pytest.approx(CoulombViscousFit([trial]).parameters)


def test_a_trial_at_rest_does_not_break_the_fit():
    still = contact()
    rest = {**still.offline, "v_slip": np.zeros(400)}
    fit = CoulombViscousFit([ContactTrial("1", still.t, rest, rest, {}, {})])
    assert np.isfinite(list(fit.parameters.values())).all()
    assert np.isfinite(fit.predict_trial(still)["force"]).all()
