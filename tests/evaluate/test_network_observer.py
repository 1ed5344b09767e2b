"""A network in the equation of motion, corrected by measurement: forgets a wrong start, sees nothing of the future."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import sympy as sp
import torch

from frictionpinn.data.contact import contact_trials
from frictionpinn.data.noise import GaussianNoise
from frictionpinn.data.recording import Recording, Trial
from frictionpinn.evaluate.network_observer import NetworkObserver, _Corrected, applies
from frictionpinn.models import MODELS
from frictionpinn.numerics.paths import InputPath
from frictionpinn.numerics.simulate import Simulator
from frictionpinn.numerics.smoothing import NoSmoothing
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.mechanism import Mechanism
from frictionpinn.physics.system import TIME

DRIVE, T = SYSTEMS["drive"](), np.arange(161) / 400
P = {"mu_c": 3.0, "sigma_2": 1.0, "v_t": 5e-2}
SCALES = {"force": 3.0, "velocity": 0.3, "acceleration": 5.0, "velocity_noise": 0.01, "ratio": 3.0, "viscous": 1.0}


def model_of(window=1):
    torch.manual_seed(0)
    options = {"name": "bb1", "inputs": ["v_slip", "normal_force"], "windows": {"v_slip": [[window, 0]]}}
    options |= {"network": {"width": 8, "depth": 2, "activation": "silu", "odd": True}, "scales": SCALES}
    options |= {"loss": {"force": "normalised"}, "optimizer": {"name": "adam", "lr": 1e-3}}
    return MODELS["bb1"](**options).eval()


def prepared(monkeypatch):
    """A model that is the law, and a noisy trial of a drive with that law."""
    model = model_of()
    law = lambda self, b: {"force": P["mu_c"] * torch.tanh(b["v"] / P["v_t"]) + P["sigma_2"] * b["v"]}  # noqa: E731
    monkeypatch.setattr(type(model), "predict", law)
    mechanism = Mechanism(DRIVE, LAWS["coulomb_viscous"]())
    path = InputPath.from_expressions(mechanism, T, {"force": 6 * sp.sin(14 * TIME)})
    run = Simulator(mechanism).simulate(T, path, P)
    recording = Recording((Trial("1", T, run.signals, {"friction_force": run.F}),), {})
    raw = NoSmoothing(causal=True)
    (trial,) = contact_trials(GaussianNoise(0.01)(recording, 0), DRIVE, raw, raw, ["1"])
    return model, trial


def test_a_wrong_start_is_forgotten(monkeypatch):
    model, trial = prepared(monkeypatch)
    wrong = replace(trial, filtered={**trial.filtered, "v": trial.filtered["v"] + 0.3})
    free, corrected = (_Corrected(DRIVE, model, wrong, gain) for gain in (0.0, 0.2))
    free.run(), corrected.run()
    late = slice(30, None)
    error = [np.sqrt(np.mean((march.y[late, 1] - trial.measured["v"][late]) ** 2)) for march in (free, corrected)]
    assert error[1] < 0.02 and error[1] < error[0]


def test_the_force_is_close_and_causal(monkeypatch):
    model, trial = prepared(monkeypatch)
    observer = NetworkObserver(DRIVE, model, [trial])
    force, truth = observer(trial), trial.truth["friction_force"]
    assert np.mean((force - truth)[5:] ** 2) < 0.02 * np.mean(truth**2)
    cut = {name: np.append(values[:100], 0.5 * values[100:]) for name, values in trial.measured.items()}
    np.testing.assert_array_equal(observer(replace(trial, measured=cut))[:100], force[:100])


def test_it_is_offered_where_it_is_of_use():
    assert applies(DRIVE, model_of()) and not applies(DRIVE, model_of(window=6))
    assert not applies(SYSTEMS["damper"](), model_of())
