"""Networks inside the equation of motion: against the compiled simulator, against the adaptive integrator."""

from __future__ import annotations

import copy

import numpy as np
import pytest
import sympy as sp
import torch

from frictionpinn.evaluate.in_simulation import _March, simulate_model
from frictionpinn.evaluate.instant import WindowedForce, memoryless
from frictionpinn.models import MODELS, FrictionEnsemble
from frictionpinn.numerics.paths import InputPath
from frictionpinn.numerics.simulate import ContactLost, Simulator
from frictionpinn.physics import LAWS, SYSTEMS
from frictionpinn.physics.mechanism import Mechanism
from frictionpinn.physics.system import TIME

T = np.arange(121) / 400
P = {"mu_c": 0.3, "sigma_2": 0.4, "v_t": 5e-3}
SCALES = {"force": 4.0, "velocity": 0.3, "acceleration": 5.0, "velocity_noise": 0.01, "ratio": 0.3, "viscous": 0.4}
LAW = {
    "name": "lugre",
    "start": {"sigma_0": 1e4, "sigma_1": 20.0, "sigma_2": 0.4, "mu_c": 0.3, "mu_s": 0.4, "v_s": 0.1},
}
LAW["bounds"] = {name: [value / 10, value * 10] for name, value in LAW["start"].items()}
CASES = {"pob": {"theta": sp.rad(50) * sp.sin(2 * sp.pi * TIME)}, "pendulum": {"tau": 6 * sp.sin(7 * TIME)}}
CASES["damper"] = {"x": 0.01 * sp.sin(9 * TIME)}


def model_of(name="bb2", windows=((1, 0),), seed=0):
    torch.manual_seed(seed)
    inputs = ["v_slip", "normal_force", "a_frictionless"]
    options = {"name": name, "inputs": inputs, "windows": {"v_slip": [list(w) for w in windows]}, "scales": SCALES}
    options |= {"network": {"width": 8, "depth": 2, "activation": "silu", "odd": True}}
    options |= {"loss": {"force": "normalised", "weight": 1.0}, "optimizer": {"name": "adam", "lr": 1e-3}}
    model = MODELS[name](**options, **({"law": LAW} if name.startswith("pe") else {}))
    spread = torch.tensor([0.2 if sign < 0 else 5.0 for sign in model.features.odd])
    model.network.scale.copy_(spread)
    return model.eval()


class Smooth(torch.nn.Module):
    """Prediction of the law ``coulomb_viscous``, of features (v, N, ...)."""

    def forward(self, batch):
        v, N = batch["x"][:, :1], batch["x"][:, 1:2]
        x = v / P["v_t"]
        return {"force": P["mu_c"] * N * torch.tanh(x + x**3 / 3) + P["sigma_2"] * v}


def as_law(monkeypatch):
    model = model_of()
    monkeypatch.setattr(type(model), "predict", lambda self, batch: Smooth()(batch))
    return model


@pytest.mark.parametrize("system", CASES)
def test_a_model_equal_to_a_law_moves_as_the_law_does(system, monkeypatch):
    mechanism = Mechanism(SYSTEMS[system](), LAWS["coulomb_viscous"]())
    path = InputPath.from_expressions(mechanism, T, CASES[system])
    expected = Simulator(mechanism).simulate(T, path, P)
    result = _March(mechanism.system, as_law(monkeypatch), path, {}, 4).run()
    np.testing.assert_allclose(result.v, expected.v, atol=1e-4)
    np.testing.assert_allclose(result.q, expected.q, atol=1e-5)
    assert np.sqrt(np.mean((result.F - expected.F) ** 2)) < 5e-3 * np.abs(expected.F).max()
    assert set(result.signals) == set(expected.signals)


def swing(system):
    return InputPath.from_expressions(Mechanism(system, LAWS["coulomb"]()), T, CASES["pob"])


def test_the_march_and_the_adaptive_integrator_agree_on_a_network():
    system, model = SYSTEMS["pob"](), model_of()
    assert memoryless(model)
    adaptive = simulate_model(system, model, swing(system), {"v": 0.1}, 4)
    marched = _March(system, model, swing(system), {"v": 0.1}, 4).run()
    np.testing.assert_allclose(marched.F, adaptive.F, atol=1e-3)
    np.testing.assert_allclose(marched.v, adaptive.v, atol=1e-4)


@pytest.mark.parametrize(("name", "windows"), [("bb2", ((6, 1),)), ("pe2", ((1, 0),)), ("pe2", ((1, 0), (6, 2)))])
def test_the_force_in_simulation_is_the_prediction_along_the_simulated_signals(name, windows):
    from frictionpinn.data.contact import ContactTrial, backward_difference
    from frictionpinn.numerics.torch_functions import contact_signals

    system, model = SYSTEMS["pob"](), model_of(name, windows)
    assert not memoryless(model)
    run = simulate_model(system, model, swing(system), {}, 1)
    signals = contact_signals(system, run.signals)
    rates = {key: backward_difference(T, signals[key]) for key in ("normal_force", "a_frictionless")}
    trial = ContactTrial("1", T, signals, signals, {**rates, "v_slip": signals["a_slip"]})
    expected = model.predict_trial(trial)["force"]
    np.testing.assert_allclose(run.F[8:], expected[8:], atol=2e-3 * np.abs(expected).max())


def test_halving_the_steps_changes_the_motion_in_second_order():
    system, model = SYSTEMS["pob"](), model_of("pe2")
    runs = [_March(system, model, swing(system), {}, substeps).run().q for substeps in (1, 2, 4)]
    coarse, fine = np.abs(runs[0] - runs[1]).max(), np.abs(runs[1] - runs[2]).max()
    assert fine < coarse / 2.5


def test_features_of_a_past_are_those_of_the_whole_signal():
    model, rng = model_of("bb2", ((1, 0), (6, 1), (9, 3))), np.random.default_rng(0)
    past = {name: rng.normal(size=40) for name in model.features.inputs}
    force = WindowedForce(model, 1, 1 / 400)
    expected = model.features(np.arange(40) / 400, past)
    for k in (0, 3, 39):
        seen = force.of_past(past, k) + force.now({name: values[k : k + 1] for name, values in past.items()})[0]
        np.testing.assert_allclose(seen, expected[k], atol=1e-9)
    held = {name: values[:1] for name, values in past.items()}
    same = model.features(np.arange(40) / 400, {name: np.full(40, values[0]) for name, values in past.items()})
    np.testing.assert_allclose(force.constant(held)[0], same[-1], atol=1e-9)


@pytest.mark.parametrize("name", ["bb1", "pe1"])
def test_the_force_of_an_ensemble_is_the_mean_of_its_members_forces_each_by_itself(name, monkeypatch):
    """As one batched program it is the same to seven digits and takes several times as long."""
    members = [model_of(name, ((1, 0), (5, 1)), seed) for seed in range(3)]
    together = FrictionEnsemble(copy.deepcopy(members))
    monkeypatch.setattr(FrictionEnsemble, "each", None)
    force, alone = WindowedForce(together, 1, 1 / 400), [WindowedForce(member, 1, 1 / 400) for member in members]
    x, rate = np.random.default_rng(0).normal(size=(2, 4, len(members[0].features.odd)))
    now, rates = ({"v_slip": each[:, 0], "normal_force": np.full(4, 9.0)} for each in (x, rate))
    expected = np.mean([one(x, rate, now, rates) for one in alone], axis=0)
    np.testing.assert_allclose(force(x, rate, now, rates), expected, rtol=1e-12)


def test_loss_of_contact_is_told():
    system = SYSTEMS["pob"]()
    path = InputPath.from_expressions(
        Mechanism(system, LAWS["coulomb"]()), T, {"theta": sp.rad(50) * sp.cos(3 * sp.pi * TIME)}
    )
    with pytest.raises(ContactLost, match="contact lost"):
        simulate_model(system, model_of("pe2"), path, {}, 1)
