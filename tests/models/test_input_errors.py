"""Errors of what a simulation takes from the measured motion: their sizes, and where there are none."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from frictionpinn.physics import SYSTEMS


def test_what_smoothing_leaves_is_found_by_smoothing_again(data):
    from frictionpinn.data.input_noise import input_noise
    from frictionpinn.numerics.kalman import KalmanSmoother

    system, train = SYSTEMS["pob"](), data.select("train")
    told = input_noise(data.recording, system, KalmanSmoother(), train)
    slip = np.concatenate([t.offline["v_slip"] - t.truth["v_slip"] for t in train])
    assert told["start_error"] == pytest.approx(np.sqrt(np.mean(slip**2)), rel=0.6)
    assert told["first_error"] > told["start_error"]  # a smoother sees one side of a trial's first sample
    assert 0 < told["input_error"] < 0.2
    noise = np.concatenate([t.seen["v_slip"] - t.truth["v_slip"] for t in train])
    assert told["slip_noise"] == pytest.approx(np.sqrt(np.mean(noise**2)), rel=0.1)


def test_errors_that_are_larger_near_the_ends_of_a_trial_are_known_to_be():
    from frictionpinn.data.input_noise import ends

    rng, size = np.random.default_rng(0), 1 + 3 * np.exp(-np.minimum(np.arange(400), np.arange(400)[::-1]) / 10)
    profile, inside = ends([0.1 * size * rng.standard_normal(400) for _ in range(400)])
    assert inside == pytest.approx(0.1, rel=0.02)
    assert 20 < len(profile) < 150
    np.testing.assert_allclose(profile[:20], size[:20], rtol=0.2)


def test_errors_of_the_inputs_have_the_size_that_smoothing_leaves():
    from frictionpinn.models.input_errors import InputErrors

    scales = {"input_error": 0.2, "start_error": 0.1, "first_error": 0.3, "start_time": 0.2, "step": 0.01,
              "input_step": 0.01}  # fmt: skip
    errors = InputErrors([[300, 200], [500]], [0.6, 0.8], [4.0, 2.0], scales)
    torch.manual_seed(0)
    made = []
    for _ in range(400):
        with torch.no_grad():
            errors.inputs.normal_()
            errors.starts.fill_(1.0)
            errors.places.fill_(-1.0)
            made.append(errors.along().numpy())
    spread = np.std(made, axis=0)
    assert spread[[0, 499, 500, 999]].mean() == pytest.approx(0.8, rel=0.1)
    assert spread[[1, 498, 501, 998]].mean() == pytest.approx(0.4, rel=0.1)
    assert spread[10:400].mean() == pytest.approx(0.2, rel=0.05)
    anew = torch.tensor([1.0, 0.5, 1.0], dtype=torch.float64)
    np.testing.assert_allclose(errors.at_starts(anew).detach(), [[0.3, -0.06], [0.05, -0.01], [0.3, -0.06]], rtol=1e-6)
    errors.forget()
    assert errors.squares().item() == 0.0


def test_a_force_that_moves_a_contact_is_as_noisy_as_it_was_measured():
    from frictionpinn.workflow.build import build_system
    from frictionpinn.workflow.experiment import build_data, build_model
    from frictionpinn.workflow.options import composed

    options = ["experiment=memory", "model=bb2", "system=drive", "data.rate_hz=100", "data.training_trials=2"]
    cfg = composed("train", [*options, "noise.level=0.05"])
    system = build_system(cfg["system"])
    data = build_data(cfg, system)
    model = build_model(cfg, system, data)
    noise = 0.05 * np.std(np.concatenate([trial.signals["force"] for trial in data.recording.trials]))  # N, on 1 kg
    assert model.through == "motion" and len(model.errors.starts) >= 2 and model.errors.places is None
    assert model.scales["input_error"] == pytest.approx(noise, rel=0.15)
    assert model.scales["start_error"] > 0


def test_errors_of_an_acceleration_whose_position_is_measured_keep_their_lack_of_a_slow_part():
    from frictionpinn.data.input_noise import shape

    rng, h = np.random.default_rng(0), np.hanning(17) / np.hanning(17).sum()
    errors = [np.diff(np.convolve(rng.standard_normal(2017), h, "valid"), 2) for _ in range(4)]
    kernel, every = shape(errors)
    made = np.convolve(rng.standard_normal(20000), kernel, "valid")
    assert every == 1.0 and np.std(made) == pytest.approx(1.0, rel=0.1)
    alike = [np.mean(made[k:] * made[: len(made) - k]) for k in range(8)]
    wanted = [np.mean([np.mean(e[k:] * e[: len(e) - k]) / np.mean(e**2) for e in errors]) for k in range(8)]
    np.testing.assert_allclose(alike, wanted, atol=0.15)
    assert abs(kernel.sum()) < 0.1 * np.abs(kernel).sum()


def test_how_far_a_measured_position_is_off_the_smoothed_one_is_the_noise_of_the_slip(data):
    from frictionpinn.data.input_noise import input_noise
    from frictionpinn.data.noise import GaussianNoise
    from frictionpinn.numerics.kalman import KalmanSmoother

    system, train = SYSTEMS["pob"](), data.select("train")
    for trial in train:
        np.testing.assert_allclose(trial.off_position, trial.measured["x"] - trial.smoothed["x"], atol=1e-12)
    told = input_noise(data.recording, system, KalmanSmoother(), train, positions=True)
    assert told["position_noise"] == pytest.approx(GaussianNoise(level=0.05).levels(data.recording)["x"], rel=0.15)
    assert told["start_time"] > 0 and told["assumed"] == 0.0
