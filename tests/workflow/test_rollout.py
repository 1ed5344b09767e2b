"""The fit in motion: a network that creeps at rest is simulated as friction that sticks."""

from __future__ import annotations

import json

import numpy as np
import pytest

from frictionpinn.errors import UserError
from frictionpinn.evaluate.characteristics import mobility
from frictionpinn.evaluate.in_motion import simulate_in_motion
from frictionpinn.evaluate.in_simulation import simulate_model
from frictionpinn.models.rollout import fit_in_motion
from frictionpinn.workflow.experiment import build_data
from frictionpinn.workflow.load import load_run
from frictionpinn.workflow.rollout import load_in_motion
from frictionpinn.workflow.trajectories import build_trajectories, transferred

SWING = {"name": "swing", "duration": 1.0, "theta": "45*deg*sin(2*pi*t)"}


@pytest.fixture(scope="module", params=["bb1", "pe1"])
def run(request, quick, tmp_path_factory):
    folder = tmp_path_factory.mktemp(request.param)
    quick(folder, f"model={request.param}", "rollout=true", epochs=80)
    return folder


def test_the_fit_in_motion_makes_the_simulation_more_faithful(run):
    trained, system, model = load_run(run)
    data = build_data(trained, system)
    (swing,) = build_trajectories(transferred(trained, None, {"pob": [SWING]}), system, data, {"seeds": [0]})
    friction = load_in_motion(run, model)
    sharp = simulate_in_motion(system, friction, swing.path, swing.start)
    blurred = simulate_model(system, model, swing.path, swing.start, 1, "bdf2")
    errors = [float(np.mean((found.F - swing.force) ** 2)) for found in (sharp, blurred)]
    assert errors[0] < 0.25 * errors[1]
    assert errors[0] < 0.1 * np.mean(swing.force**2)


def test_what_was_fitted_stands_in_the_result_in_si_units(run):
    told = json.loads((run / "result.json").read_text())["rollout"]
    assert told["simulations"] > 0 and told["mean_square"] < 50
    assert all(np.isfinite(value) and value >= 0 for value in told["values"].values())


def test_friction_in_motion_opposes_the_motion_and_sticks_at_rest(run):
    _, _, model = load_run(run)
    friction = load_in_motion(run, model)
    v, N = np.array([-0.3, -0.05, 0.05, 0.3]), np.full(4, 12.0)
    settled = np.concatenate([friction.settled(*at) for at in zip(v, N, strict=True)])
    np.testing.assert_allclose(friction(v, N, settled)[1], 0.0, atol=1e-9)
    assert (friction(v, N, settled)[0] * v > 0).all()
    if not friction.memory:
        assert friction(np.array([2e-3]), N[:1], settled[:1])[0] > 0.1


@pytest.mark.parametrize("wrong", [["model=pe2"], ["model=bb1", "ensemble=2"]])
def test_a_model_with_a_past_or_an_ensemble_is_refused_before_it_is_trained(wrong, quick, tmp_path):
    with pytest.raises(UserError, match="without a past"):
        quick(tmp_path / "run", *wrong, "rollout=true", epochs=1)


def test_trials_that_only_rest_are_refused_in_one_line(run):
    trained, system, model = load_run(run)
    if not model.sees_rates:
        model.scales["velocity_noise"] = 1.0  # m/s, above every slip velocity of the trials
        with pytest.raises(UserError, match="no training sample surely slides"):
            fit_in_motion(model, system, build_data(trained, system).select("train"), mobility(system))
